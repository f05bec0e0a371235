"""The semi-automatic page: the operator's stick moves the nozzle along the plan (thesis 6.1.2)."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QPushButton, QVBoxLayout

from ascrcp.core.errors import RefusedError
from ascrcp.devices.joystick import REST, StickState
from ascrcp.hmi.contract import Session
from ascrcp.hmi.nozzle_panel import NozzlePanel
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.quantity import PROGRESS
from ascrcp.hmi.stick_pad import StickPad
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, set_look
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Mode, Step

LEVER_STEP = 0.1
"""Of full flow, one press on the spray buttons; placeholder."""
HINT_PX = 44
"""Two lines [px], so that the pad stays where it is."""
BUTTONS = (
    ("semi_finish", "semi_area", "semi_jog", "semi_axis"),
    ("semi_spray_more", "semi_spray_less", "semi_spray_none"),
)
"""By columns, from the top."""


class SemiAutomaticPage(Page):
    """The pad at the left, what the stick does in the middle, its commands at the right.

    While this page is in front the screen is the stick, if none other is configured; it says so every
    `stick_ms`, so that a screen that hangs has let go (fault F29).
    """

    key = "semi"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
        self._session = session
        self._lever = 0.0
        self._is_lifting = self._is_stick = self._is_front = self._is_jog = False
        self.pad = StickPad(screen)
        self.hint = make_label("small", wrap=True, centred=True)
        self.hint.setFixedHeight(HINT_PX)
        self.status = make_label("number", wrap=True)
        self.enabled, self.lever, self.stick = (make_label("value") for _ in range(3))
        self.note = make_label("small", wrap=True)
        self.nozzle = NozzlePanel()
        self.buttons: dict[str, QPushButton] = {
            name: make_button("view", name=name) for column in BUTTONS for name in column
        }
        self._lay_out()
        for name, press in (
            ("semi_finish", session.finish_steering),
            ("semi_area", session.leave_area),
            ("semi_jog", self._press_jog),
            ("semi_axis", self._turn_axis),
            ("semi_spray_less", lambda: self._dose(-LEVER_STEP)),
            ("semi_spray_none", lambda: self._dose(-1.0)),
            ("semi_spray_more", lambda: self._dose(LEVER_STEP)),
        ):
            self.buttons[name].clicked.connect(lambda _=False, press=press: press())

    def _lay_out(self) -> None:
        left = QVBoxLayout()
        left.addWidget(self.pad, 1)
        left.addWidget(self.hint)
        told = Panel()
        middle = QVBoxLayout(told)
        middle.setContentsMargins(8, 6, 8, 6)
        middle.addWidget(self.status)
        for label in (self.enabled, self.stick, self.lever, self.note):
            middle.addWidget(label)
        column = QVBoxLayout()
        column.setSpacing(6)
        column.addWidget(told, 1)
        column.addWidget(self.nozzle)
        keys = QGridLayout()
        keys.setSpacing(6)
        for place, column_names in enumerate(BUTTONS):
            for line, name in enumerate(column_names):
                keys.addWidget(self.buttons[name], line, place)
        keys.setRowStretch(max(map(len, BUTTONS)), 1)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        row.addLayout(left, 32)
        row.addLayout(column, 44)
        row.addLayout(keys, 24)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.nozzle.set_language(language)
        for name in ("semi_finish", "semi_area", "semi_spray_less", "semi_spray_none", "semi_spray_more"):
            self.buttons[name].setText(say(name, language))
        self.note.setText(f"{say('semi_steps', language)} {say('semi_keys', language)}")
        self._write_axis()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self.pad.set_theme(screen)

    def note_snapshot(self, snapshot: Snapshot) -> None:
        """Say that there is a stick even while another page is in front, where nobody else says so."""
        self._is_stick = snapshot.screen_stick
        is_idle = not snapshot.job.jogging and snapshot.job.active is not Step.RUN
        if self._is_stick and not self._is_front and is_idle:
            self._session.put_stick(REST)
        self._is_front = False  # `show_snapshot` follows where it is

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Set the stick, show what it does."""
        self._is_front = True
        job, language = snapshot.job, self.language
        is_jog = job.jogging
        is_steered = is_jog or snapshot.steer is not None
        self._is_jog = is_jog
        self.keep_stick()
        self.pad.setEnabled(self._is_stick)
        hint = "semi_other_stick" if not self._is_stick else "semi_pad_jog" if is_jog else "semi_pad_plan"
        set_text(self.hint, say(hint, language))
        self.nozzle.show_snapshot(snapshot)
        steer = snapshot.steer
        set_text(self.status, say("semi_idle", language) if steer is None else steer.value[language])
        set_text(
            self.enabled, say("semi_key_held" if snapshot.armed and is_steered else "semi_key_free", language)
        )
        set_look(self.enabled, "normal" if snapshot.armed and is_steered else "muted")
        lost = (snapshot.stick.lost and is_steered) or not job.has_joystick
        set_text(self.stick, say("semi_stick_lost" if lost else "semi_stick_ok", language))
        share = self._lever if self._is_stick else snapshot.stick.lever
        set_text(self.lever, say("semi_lever", language).format(share=PROGRESS.show(share)))
        jog = self.buttons["semi_jog"]
        set_text_of(jog, say("semi_end_jog" if is_jog else "semi_jog", language))
        jog.setEnabled(is_jog or self._session.jog_refusal() is None)
        self.buttons["semi_finish"].setEnabled(is_steered)
        can_leave = job.mode is Mode.SEMI_AUTOMATIC and Step.LOAD in job.done
        self.buttons["semi_area"].setEnabled(can_leave and job.active is None and not is_jog)
        self.buttons["semi_axis"].setEnabled(is_jog and self._is_stick)
        for name in ("semi_spray_less", "semi_spray_none", "semi_spray_more"):
            self.buttons[name].setEnabled(self._is_stick and job.mode is Mode.SEMI_AUTOMATIC and not is_jog)
        self._name_directions(is_jog)

    def keep_stick(self) -> None:
        """Say what the pad does now."""
        if self._is_stick and self._is_front:
            self._session.put_stick(self._state(self._is_jog))

    def leave(self) -> None:
        """Let go of the stick: whoever looks at another page does not steer."""
        self.pad.let_go()
        self._is_front = False
        if self._is_stick:
            self._session.put_stick(REST)

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Dose by Page up and Page down."""
        if event.key() == Qt.Key.Key_PageUp:
            self._dose(LEVER_STEP)
        elif event.key() == Qt.Key.Key_PageDown:
            self._dose(-LEVER_STEP)
        else:
            super().keyPressEvent(event)

    def _state(self, is_jog: bool) -> StickState:
        """Return what the pad and the lever say: left and up on the pad are positive for the arm."""
        lifts = is_jog and self._is_lifting
        return StickState(
            along=-self.pad.across,
            across=0.0 if lifts else self.pad.upward,
            lift=self.pad.upward if lifts else 0.0,
            lever=0.0 if is_jog else self._lever,
            deadman=self.pad.is_held,
            lost=False,
            reason="",
        )

    def _name_directions(self, is_jog: bool) -> None:
        up, down = ("semi_up", "semi_down") if is_jog and self._is_lifting else ("semi_in", "semi_out")
        self.pad.set_names(*(say(key, self.language) for key in ("semi_right", "semi_left", up, down)))

    def _dose(self, change: float) -> None:
        self._lever = round(min(1.0, max(0.0, self._lever + change)), 3)

    def _turn_axis(self) -> None:
        self._is_lifting = not self._is_lifting
        self._write_axis()

    def _write_axis(self) -> None:
        key = "semi_axis_up" if self._is_lifting else "semi_axis_in"
        self.buttons["semi_axis"].setText(say(key, self.language))

    def _press_jog(self) -> None:
        if self._session.snapshot().job.jogging:
            self._session.finish_steering()
            return
        try:
            self._session.start_jog("nozzle")
        except RefusedError as error:  # the state changed between drawing and pressing
            reason = self._session.jog_refusal()
            set_text(self.status, str(error) if reason is None else reason.value[self.language])


def set_text_of(button: QPushButton, text: str) -> None:
    """Write a button's text; costs little when it has it already."""
    if button.text() != text:
        button.setText(text)
