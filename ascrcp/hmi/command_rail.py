"""The right edge, the same on every page: general commands, who has control, e-stop mirror, reset, stop."""

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QVBoxLayout

from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, set_look
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Mode

RAIL_PX = 190
NOTE_PX = 72
"""Four lines [px], so that reset above stays where it is in both languages."""


def control_holder(snapshot: Snapshot) -> str:
    """Return the key of who has the arm: the platform, the stick, nobody."""
    job = snapshot.job
    if snapshot.estop or job.stopped:
        return "holder_nobody"
    if job.jogging or (job.mode is Mode.SEMI_AUTOMATIC and snapshot.steer is not None):
        return "holder_stick"
    return "holder_platform" if job.active is not None and job.active.moves else "holder_rest"


class CommandRail(Panel):
    """Commands that hold in every state.

    Stop acts on press, not on release. Quit asks by a second press on the same button, never by a
    dialog: the first press has already stopped the arm.
    """

    stop = Signal()
    reset = Signal()
    cancel = Signal()
    language_switched = Signal()
    theme_switched = Signal()
    quit_asked = Signal()
    quit_confirmed = Signal()

    def __init__(self, screen: Screen) -> None:
        super().__init__(framed=False)
        self._screen = screen
        self.setFixedWidth(RAIL_PX)
        self._confirm = QTimer(self)
        self._confirm.setSingleShot(True)
        self._confirm.setInterval(round(1000 * screen.quit_confirm_s))
        self._confirm.timeout.connect(self._write_quit)
        self.quit_button = make_button("plain", name="quit")
        self.language_button = make_button("plain", name="language")
        self.theme_button = make_button("plain", name="theme")
        self.cancel_button = make_button("plain", name="cancel")
        self.reset_button = make_button("reset", name="reset")
        self.stop_button = make_button("stop", name="stop")
        self.holder = make_label("holder", centred=True)
        self.estop = make_label("estop", centred=True)
        self.note = make_label("small", wrap=True)
        self.note.setFixedHeight(NOTE_PX)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(6)
        for widget in (self.quit_button, self.language_button, self.theme_button, self.cancel_button):
            column.addWidget(widget)
        column.addStretch()
        column.addWidget(self.holder)
        column.addWidget(self.estop)
        column.addWidget(self.reset_button)
        column.addWidget(self.note)
        column.addWidget(self.stop_button)  # last: no text above it can move it
        self.stop_button.pressed.connect(self.stop)
        self.reset_button.clicked.connect(self.reset)
        self.cancel_button.clicked.connect(self.cancel)
        self.language_button.clicked.connect(self.language_switched)
        self.theme_button.clicked.connect(self.theme_switched)
        self.quit_button.clicked.connect(self._press_quit)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.stop_button.setText(say("stop", language))
        self.reset_button.setText(say("reset", language))
        self.cancel_button.setText(say("cancel", language))
        self.language_button.setText(say("language", language))
        self.note.setText(f"{say('stop_keys', language)}. {say('software_stop', language)}")
        self.set_theme(self._screen)
        self._write_quit()

    def set_theme(self, screen: Screen) -> None:
        """Name the theme the switch leads to."""
        self._screen = screen
        self.theme_button.setText(say(f"theme_{screen.other_theme}", self.language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the e-stop's mirror; offer cancel and reset only where they do something."""
        set_text(self.estop, say("estop_pressed" if snapshot.estop else "estop_released", self.language))
        set_look(self.estop, "danger" if snapshot.estop else "calm")
        set_text(
            self.holder, f"{say('holder', self.language)}\n{say(control_holder(snapshot), self.language)}"
        )
        is_busy = snapshot.job.active is not None or snapshot.job.jogging
        self.cancel_button.setEnabled(is_busy)
        self.reset_button.setEnabled(not snapshot.estop and (snapshot.job.stopped or bool(snapshot.causes)))

    def _press_quit(self) -> None:
        if self._confirm.isActive():
            self._confirm.stop()
            self.quit_confirmed.emit()
            return
        self._confirm.start()
        self._write_quit()
        self.quit_asked.emit()

    def _write_quit(self) -> None:
        is_armed = self._confirm.isActive()
        self.quit_button.setText(say("quit_again" if is_armed else "quit", self.language))
        set_look(self.quit_button, "confirm" if is_armed else "plain")
