"""The top row: mode choice, what the platform is doing, progress, and the simulation banner."""

import math

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QButtonGroup, QHBoxLayout, QProgressBar, QPushButton, QVBoxLayout

from ascrcp.core.event import Reaction
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.quantity import PROGRESS, show_duration
from ascrcp.hmi.text import MODE_NAME, STEP_NAME, Language, say
from ascrcp.hmi.theme import Screen, set_look
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Mode, Step

_PROGRESS_STEPS = 1000


def platform_state(snapshot: Snapshot, is_frozen: bool = False) -> tuple[str, str]:
    """Return the key of the state's text and its look; the most serious state wins."""
    job = snapshot.job
    rows = (
        (is_frozen, "frozen", "danger"),
        (snapshot.estop, "estop", "danger"),
        (job.stopped, "stopped", "abnormal"),
        (snapshot.reaction is Reaction.STOP, "holding", "abnormal"),
        (job.jogging or (job.active is not None and job.active.moves), "moving", "normal"),
        (job.active is not None, "computing", "normal"),
        (Step.RUN in job.done, "finished", "calm"),
    )
    return next(((key, look) for is_so, key, look in rows if is_so), ("ready", "calm"))


class FrozenWatch:
    """Notices that snapshots stand still; virtual time may, time on a machine may not."""

    def __init__(self, patience: int) -> None:
        """Args: patience: refreshes that may show the same instant."""
        self._patience = patience
        self._t_s, self._same = math.nan, 0

    def is_frozen(self, snapshot: Snapshot) -> bool:
        """Return whether the snapshots have shown one instant for too long; called at every refresh."""
        self._same = self._same + 1 if snapshot.t_s == self._t_s else 0
        self._t_s = snapshot.t_s
        return not snapshot.lockstep and self._same > self._patience


class StatusPanel(Panel):
    """Mode buttons, state word, stage, progress with remaining time, simulation banner."""

    mode_chosen = Signal(object)

    def __init__(self, screen: Screen) -> None:
        super().__init__(framed=False)
        self._watch = FrozenWatch(round(screen.frozen_ms / screen.refresh_ms))
        self.modes: dict[Mode, QPushButton] = {}
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        group = QButtonGroup(self)
        for mode in Mode:
            button = make_button("mode", name=mode.value)
            button.setCheckable(True)
            button.setFixedWidth(170)
            button.clicked.connect(lambda _=False, mode=mode: self.mode_chosen.emit(mode))
            group.addButton(button)
            row.addWidget(button)
            self.modes[mode] = button
        self.state = make_label("state", centred=True)
        row.addWidget(self.state, 5)
        column = QVBoxLayout()
        column.setSpacing(4)
        self.stage = make_label("value", wrap=True)
        self.bar = QProgressBar()
        self.bar.setRange(0, _PROGRESS_STEPS)
        column.addStretch()
        column.addWidget(self.stage)
        column.addWidget(self.bar)
        column.addStretch()
        row.addLayout(column, 4)
        self.banner = make_label("banner", centred=True, width=150)
        row.addWidget(self.banner)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        for mode, button in self.modes.items():
            button.setText(MODE_NAME[mode][language])
        self.banner.setText(say("simulation", language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw mode, state and progress."""
        job, language = snapshot.job, self.language
        key, look = platform_state(snapshot, self._watch.is_frozen(snapshot))
        set_text(self.state, say(key, language))
        set_look(self.state, look)
        self.banner.setVisible(snapshot.simulated)
        self.modes[job.mode].setChecked(True)
        for button in self.modes.values():
            button.setEnabled(job.active is None and not job.jogging)
        if job.active is None:
            set_text(self.stage, say("at_rest", language))
            self.bar.setValue(0)
            self.bar.setFormat("")
            return
        stage = snapshot.stage[language] or STEP_NAME[job.active][language]
        set_text(self.stage, stage)
        fraction = snapshot.progress if math.isfinite(snapshot.progress) else 0.0
        self.bar.setValue(round(_PROGRESS_STEPS * max(0.0, min(1.0, fraction))))
        left = show_duration(snapshot.remaining_s)
        self.bar.setFormat(
            f"{PROGRESS.show(snapshot.progress)}   {say('remaining', language).format(time=left)}"
        )
