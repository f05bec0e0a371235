"""The commissioning page: locked by a PIN; one part at a time."""

import hashlib
import hmac

from PySide6.QtWidgets import QHBoxLayout, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from ascrcp.control.config import ControlConfig
from ascrcp.core.config import load
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.devices.machine_link import load_can_config
from ascrcp.hmi.bus_part import BusPart
from ascrcp.hmi.contract import Session
from ascrcp.hmi.editor_part import EditedFile, EditorPart
from ascrcp.hmi.fault_part import FaultPart
from ascrcp.hmi.move_part import MovePart
from ascrcp.hmi.number_pad import NumberPad
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.quantity import show_duration
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, set_look
from ascrcp.hmi.zero_part import ZeroPart
from ascrcp.kinematics import load_arm
from ascrcp.session.snapshot import Snapshot

TRIES = 3
"""Wrong PINs before one has to wait; placeholder."""
WAIT_S = 30.0
"""How long then; placeholder."""
PAD_PX = 420


def edited_machine(name: str) -> tuple[EditedFile, ...]:
    """Return the files that describe a machine, each with its reader."""
    return (
        EditedFile(CONFIG / "machines" / f"{name}.yaml", lambda path: load_arm(str(path))),
        EditedFile(CONFIG / "control" / f"{name}.yaml", lambda path: load(path, ControlConfig)),
        EditedFile(CONFIG / "devices" / "can.yaml", load_can_config),
    )


def edited_profiles() -> tuple[EditedFile, ...]:
    """Return the profile files, each with its reader."""
    return tuple(EditedFile(path, load_profile) for path in sorted((CONFIG / "profiles").glob("*.yaml")))


class SetupPage(Page):
    """A pad for the PIN; behind it a row of parts."""

    key = "setup"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
        self._screen, self._is_open = screen, False
        self._wrong, self._wait, self._idle = 0, 0, 0
        self.mover = MovePart(session)
        self.parts: dict[str, Panel] = {
            "setup_bus": BusPart(),
            "setup_zero": ZeroPart(session.arm.joints),
            "setup_move": self.mover,
            "setup_machine": EditorPart(edited_machine(session.arm.name)),
            "setup_profile": EditorPart(edited_profiles()),
            "setup_rig": FaultPart(session),
        }
        self.buttons: dict[str, QPushButton] = {}
        self.pad = NumberPad(is_secret=True)
        self.title = make_label("number", centred=True)
        self.lock_button = make_button("view", name="setup_lock")
        self.stack = QStackedWidget()
        self.outer = QStackedWidget()
        self._lay_out()
        self.pad.entered.connect(self._enter)
        self.lock_button.clicked.connect(self.lock)
        self.choose("setup_bus")

    def _lay_out(self) -> None:
        gate, inside = QWidget(), QWidget()
        column = QVBoxLayout(gate)
        column.addStretch()
        column.addWidget(self.title)
        row = QHBoxLayout()
        row.addStretch()
        self.pad.setFixedWidth(PAD_PX)
        row.addWidget(self.pad)
        row.addStretch()
        column.addLayout(row)
        column.addStretch()
        rows = QVBoxLayout(inside)
        rows.setContentsMargins(0, 0, 0, 0)
        rows.setSpacing(6)
        keys = QHBoxLayout()
        keys.setSpacing(6)
        for key, part in self.parts.items():
            button = make_button("view", name=key, checkable=True)
            button.clicked.connect(lambda _=False, key=key: self.choose(key))
            keys.addWidget(button, 1)
            self.buttons[key] = button
            self.stack.addWidget(part)
        keys.addWidget(self.lock_button, 1)
        rows.addLayout(keys)
        rows.addWidget(self.stack, 1)
        self.outer.addWidget(gate)
        self.outer.addWidget(inside)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self.outer)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        for key, part in self.parts.items():
            part.set_language(language)
            self.buttons[key].setText(say(key, language))
        self.pad.set_language(language)
        self.lock_button.setText(say("setup_lock", language))
        self._write()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the part in front; lock when nothing was pressed for long."""
        refreshes = 1000.0 / self._screen.refresh_ms
        if self._wait > 0:
            self._wait -= 1
            self._write()
        if not self._is_open:
            return
        self._idle += 1
        if self._idle > self._screen.lock_s * refreshes and not snapshot.job.jogging:
            self.lock()
            return
        part = self.stack.currentWidget()
        if isinstance(part, (BusPart, ZeroPart, MovePart, EditorPart)):
            part.show_snapshot(snapshot)

    def keep_stick(self) -> None:
        """Hold the joint test's buttons, if it is in front."""
        if self._is_open and self.stack.currentWidget() is self.mover:
            self.mover.keep_stick()

    def choose(self, key: str) -> None:
        """Bring a part to the front."""
        if self.stack.currentWidget() is self.mover and key != "setup_move":
            self.mover.leave()
        self._idle = 0
        self.stack.setCurrentWidget(self.parts[key])
        for name, button in self.buttons.items():
            button.setChecked(name == key)

    def open(self) -> None:
        """Show the parts: the PIN was right."""
        self._is_open, self._wrong, self._idle = True, 0, 0
        self.outer.setCurrentIndex(1)

    def lock(self) -> None:
        """Ask for the PIN again."""
        self.leave()
        self._is_open = False
        self.outer.setCurrentIndex(0)
        self._write()

    def leave(self) -> None:
        """End a joint test when another page comes to the front."""
        if self._is_open and self.stack.currentWidget() is self.mover:
            self.mover.leave()

    def _enter(self, pin: str) -> None:
        self.pad.show_text("")
        if self._wait > 0:
            return
        if hmac.compare_digest(hashlib.sha256(pin.encode()).hexdigest(), self._screen.pin_sha256):
            self.open()
        else:
            self._wrong += 1
            if self._wrong % TRIES == 0:
                self._wait = round(WAIT_S * 1000.0 / self._screen.refresh_ms)
        self._write()

    def _write(self) -> None:
        left = show_duration(self._wait * self._screen.refresh_ms / 1000.0)
        if self._wait > 0:
            text = say("pin_wait", self.language).format(time=left)
        else:
            text = say("pin_wrong" if self._wrong else "pin_title", self.language)
        set_text(self.title, text)
        set_look(self.title, "danger" if self._wrong else "calm")
        self.pad.enter.setEnabled(self._wait == 0)
