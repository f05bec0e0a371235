"""The steps of the job as a strip of buttons, each saying its state or why it may not start."""

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton

from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import STEP_NAME, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import STEPS, JobState, Refusal, Step

SHOWN = (*STEPS, Step.RESCAN)
REASON_PX = 36
"""Room for two lines of a reason under each button [px]."""


def step_state(job: JobState, step: Step) -> str:
    """Return "active", "done" or "todo"."""
    if job.active is step:
        return "active"
    return "done" if step in job.done else "todo"


class StepStrip(Panel):
    """Five buttons, in the order of the thesis (6.1.2), one to scan again, and why each greyed one is."""

    pressed = Signal(object)

    def __init__(self, refusal: Callable[[Step], Refusal | None]) -> None:
        """Args: refusal: why a step may not start now, None if it may."""
        super().__init__(framed=False)
        self._refusal = refusal
        self.buttons: dict[Step, QPushButton] = {}
        self.reasons: dict[Step, QLabel] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(6)
        for column, step in enumerate(SHOWN):
            button = make_button("step", name=step.value)
            button.clicked.connect(lambda _=False, step=step: self.pressed.emit(step))
            reason = make_label("reason", wrap=True)
            reason.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignHCenter)
            reason.setFixedHeight(REASON_PX)
            grid.addWidget(button, 0, column)
            grid.addWidget(reason, 1, column)
            grid.setColumnStretch(column, 1)
            self.buttons[step], self.reasons[step] = button, reason
        self.buttons[Step.RESCAN].setShortcut(QKeySequence(f"Alt+{len(SHOWN)}"))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Follow the state machine."""
        for number, step in enumerate(SHOWN, 1):
            state = step_state(snapshot.job, step)
            reason = None if state == "active" else self._refusal(step)
            button = self.buttons[step]
            text = f"{number}  {STEP_NAME[step][self.language]}\n{say(state, self.language)}"
            if button.text() != text:
                button.setText(text)
            button.setEnabled(state != "active" and reason is None)
            is_next = state == "todo" and reason is None
            set_look(button, "ready" if is_next else state)
            set_text(self.reasons[step], "" if reason is None else reason.value[self.language])
