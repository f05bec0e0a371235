"""Commissioning: move one joint slowly while a button is held, through the session's own jog."""

from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout

from ascrcp.core.errors import RefusedError
from ascrcp.devices.joystick import LOST, REST, StickState
from ascrcp.hmi import quantity
from ascrcp.hmi.contract import Session
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.kinematics import JointInfo
from ascrcp.session.snapshot import Snapshot

DEFLECTION = 0.6
"""Of the stick while a button is held: slow; the jog's own speed limit holds besides; placeholder."""


class MovePart(Panel):
    """Choose a joint, begin, hold a button: the screen is the stick, let go and it is centred."""

    def __init__(self, session: Session) -> None:
        super().__init__(framed=False)
        self._session, self._joint = session, session.arm.joints[0]
        self._is_stick, self._held, self._state = False, 0, REST
        self.hint = make_label("value", wrap=True)
        self.place, self.status = make_label("number"), make_label("message", wrap=True)
        self.buttons: dict[int, QPushButton] = {}
        row = QHBoxLayout()
        for joint in session.arm.joints:
            button = make_button("view", name=f"move_{joint.number}", checkable=True)
            button.setText(str(joint.number))
            button.clicked.connect(lambda _=False, joint=joint: self._choose(joint))
            row.addWidget(button)
            self.buttons[joint.number] = button
        self.begin_button = make_button("plain", name="move_begin")
        self.minus, self.plus = (
            make_button("plain", name="move_minus"),
            make_button("plain", name="move_plus"),
        )
        keys = QHBoxLayout()
        for button in (self.begin_button, self.minus, self.plus):
            keys.addWidget(button, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.hint)
        column.addLayout(row)
        column.addWidget(self.place)
        column.addLayout(keys)
        column.addWidget(self.status)
        column.addStretch()
        self.begin_button.clicked.connect(self._press_begin)
        self._choose(self._joint)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.hint.setText(say("move_text", language))
        self.minus.setText(say("move_minus", language))
        self.plus.setText(say("move_plus", language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Set the stick as the buttons are held, and show where the joint is."""
        job, language = snapshot.job, self.language
        self._is_stick = snapshot.screen_stick
        if self._is_stick:
            held = int(self.plus.isDown()) - int(self.minus.isDown())
            # the enable key counts only from a centred stick (fault F24): deflect one refresh later
            along = DEFLECTION * held if held == self._held else 0.0
            self._held = held
            self._state = StickState(along=along, deadman=held != 0, lost=False, reason="")
            self.keep_stick()
        reason = self._session.jog_refusal()
        self.begin_button.setText(say("move_end" if job.jogging else "move_begin", language))
        self.begin_button.setEnabled(job.jogging or reason is None)
        for button in (self.minus, self.plus):
            button.setEnabled(job.jogging)
        for button in self.buttons.values():
            button.setEnabled(not job.jogging)
        is_refused = reason is not None and not job.jogging
        why = reason.value[language] if reason is not None else ""
        set_text(self.status, say("move_refused", language).format(reason=why) if is_refused else "")
        unit = quantity.LENGTH if self._joint.prismatic else quantity.ANGLE
        index = self._joint.number - 1
        value = snapshot.q[index] if index < len(snapshot.q) else float("nan")
        name = (self._joint.name, self._joint.name_zh)[language]
        set_text(self.place, f"{self._joint.number} {name}: {unit.show(value)}")

    def keep_stick(self) -> None:
        """Say what the buttons do; a button let go since the last refresh holds nothing any more."""
        if self._is_stick:
            is_held = self.minus.isDown() or self.plus.isDown()
            self._session.put_stick(self._state if is_held else REST)

    def leave(self) -> None:
        """End the test and take the screen's stick away."""
        if self._session.snapshot().job.jogging:
            self._session.finish_steering()
        if self._is_stick:
            self._session.put_stick(LOST)

    def _choose(self, joint: JointInfo) -> None:
        self._joint = joint
        for number, button in self.buttons.items():
            button.setChecked(number == joint.number)

    def _press_begin(self) -> None:
        if self._session.snapshot().job.jogging:
            self._session.finish_steering()
            return
        try:
            self._session.start_jog("joint", self._joint.number)
        except RefusedError as error:  # the state changed between drawing and pressing
            set_text(self.status, say("move_refused", self.language).format(reason=error))
