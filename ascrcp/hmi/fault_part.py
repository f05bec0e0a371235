"""Commissioning, simulated rig only: plant faults and see what the platform does."""

from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QPushButton, QVBoxLayout

from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import DBC
from ascrcp.hmi.contract import Session
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.simulation.rig import FaultKind

KINDS: tuple[FaultKind, ...] = ("drop", "repeat", "corrupt", "freeze", "shift", "range")
OF_READINGS = ("freeze", "shift", "range")
"""Faults that only a joint's sensor can have."""
SHIFT = 5.0
"""Planted shift of a reading [deg, mm on the wire]: a jump the platform must see; placeholder."""
COLUMNS = 5


class FaultPart(Panel):
    """Choose a frame, press a fault; heal all takes everything back."""

    def __init__(self, session: Session) -> None:
        super().__init__(framed=False)
        self._site = session.site
        layouts = Codec(DBC).by_name.values()
        self._frames = [layout.name for layout in layouts if "Command" not in layout.name]
        self._frame = self._frames.index("JointPosition1")
        self._planted: dict[str, FaultKind] = {}
        self.hint, self.status = make_label("value", wrap=True), make_label("message", wrap=True)
        self.frame = make_label("number", centred=True)
        self.previous, self.next = (
            make_button("view", name="rig_previous"),
            make_button("view", name="rig_next"),
        )
        self.previous.setText("◀")
        self.next.setText("▶")
        row = QHBoxLayout()
        row.addWidget(self.previous, 1)
        row.addWidget(self.frame, 3)
        row.addWidget(self.next, 1)
        grid = QGridLayout()
        self.buttons: dict[str, QPushButton] = {}
        for index, key in enumerate((*KINDS, "estop", "release", "heal")):
            button = make_button("view", name=f"rig_{key}")
            grid.addWidget(button, index // COLUMNS, index % COLUMNS)
            self.buttons[key] = button
        for kind in KINDS:
            self.buttons[kind].clicked.connect(lambda _=False, kind=kind: self._plant(kind))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.hint)
        column.addLayout(row)
        column.addLayout(grid)
        column.addWidget(self.status)
        column.addStretch()
        self.previous.clicked.connect(lambda: self._choose(-1))
        self.next.clicked.connect(lambda: self._choose(1))
        if self._site is not None:
            self.buttons["estop"].clicked.connect(self._site.press_estop)
            self.buttons["release"].clicked.connect(self._site.release_estop)
            self.buttons["heal"].clicked.connect(self._heal)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        for key, button in self.buttons.items():
            button.setText(say(f"rig_{key}", language))
        self.hint.setText(say("rig_none" if self._site is None else "rig_text", language))
        self._write()

    def _choose(self, step: int) -> None:
        self._frame = (self._frame + step) % len(self._frames)
        self._write()

    def _plant(self, kind: FaultKind) -> None:
        if self._site is not None:
            self._planted[self._frames[self._frame]] = kind
            self._site.plant_fault(kind, self._frames[self._frame], SHIFT)
        self._write()

    def _heal(self) -> None:
        if self._site is not None:
            self._site.clear_faults()
        self._planted.clear()
        self._write()

    def _write(self) -> None:
        language, frame = self.language, self._frames[self._frame]
        set_text(self.frame, say("rig_frame", language).format(name=frame))
        for key, button in self.buttons.items():
            fits = key not in OF_READINGS or frame.startswith("Joint")
            button.setEnabled(self._site is not None and fits)
        told = [
            say("rig_planted", language).format(
                kind=say(f"rig_{kind}", language).replace("\n", " "), frame=name
            )
            for name, kind in self._planted.items()
        ]
        set_text(self.status, "; ".join(told) or say("rig_healed", language))
