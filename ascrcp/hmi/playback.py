"""The dry run: the loaded joint sequence played on the screen before anything moves."""

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QGridLayout, QSlider

from ascrcp.core.flow import JointSequence
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.quantity import show_duration
from ascrcp.hmi.text import Language, say
from ascrcp.session.snapshot import Scene, Snapshot

PACE = 20.0
"""Seconds of the sequence played in one second."""
SKIP_S = 15.0
"""One press of a skip button [s]."""


def pose_at(sequence: JointSequence, t_s: float) -> tuple[tuple[float, ...], bool]:
    """Return the joints [rad, m] at one instant of a sequence, and whether concrete flows then."""
    after = int(np.clip(np.searchsorted(sequence.t, t_s), 1, max(1, len(sequence.t) - 1)))
    if len(sequence.t) < 2:
        return tuple(sequence.q[0].tolist()), bool(sequence.spraying[0])
    t0, t1 = float(sequence.t[after - 1]), float(sequence.t[after])
    share = min(1.0, max(0.0, (t_s - t0) / (t1 - t0)))
    q = (1.0 - share) * sequence.q[after - 1] + share * sequence.q[after]
    return tuple(q.tolist()), bool(sequence.spraying[after - 1])


class PlaybackBar(Panel):
    """Play, pause, end, and a slider over the whole sequence.

    Signals:
        posed: Joints to draw and whether concrete flows, or None when the dry run has ended.
    """

    posed = Signal(object)

    def __init__(self, refresh_ms: int) -> None:
        super().__init__(framed=False)
        self._step_s = PACE * refresh_ms / 1000.0
        self._sequence: JointSequence | None = None
        self._is_playing, self._is_shown, self._may = False, False, False
        self.t_s = 0.0
        self.play_button = make_button("plain", name="dry_run_play")
        self.end_button = make_button("plain", name="dry_run_end")
        self.slider = QSlider(Qt.Orientation.Horizontal)
        self.slider.setObjectName("dry_run_slider")
        self.slider.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.slider.setRange(0, 1000)
        self.slider.setPageStep(50)
        self.time = make_label("small", centred=True)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(4)
        grid.addWidget(self.play_button, 0, 0)
        grid.addWidget(self.end_button, 0, 1)
        grid.addWidget(self.slider, 1, 0, 1, 2)
        grid.addWidget(self.time, 2, 0, 1, 2)
        self.play_button.clicked.connect(self._press_play)
        self.end_button.clicked.connect(self.end)
        self.slider.valueChanged.connect(self._slide)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.end_button.setText(say("dry_run_end", language))
        self._write()

    def show_scene(self, scene: Scene) -> None:
        """Take the loaded sequence."""
        if scene.sequence is not self._sequence:
            self._sequence = scene.sequence
            self.end()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Play on; end when the arm begins to move."""
        active = snapshot.job.active
        may = self._sequence is not None and not (active is not None and active.moves)
        if may != self._may:
            self._may = may
            self._write()
        if not may and self._is_shown:
            self.end()
        if self._is_playing:
            self._go(self.t_s + self._step_s)

    def end(self) -> None:
        """Leave the dry run."""
        was_shown = self._is_shown
        self._is_playing = self._is_shown = False
        self.t_s = 0.0
        self._write()
        if was_shown:
            self.posed.emit(None)

    def _press_play(self) -> None:
        if self._sequence is not None and self.t_s >= self._sequence.duration:
            self.t_s = 0.0
        self._is_playing = not self._is_playing
        self._is_shown = True
        self._go(self.t_s)

    def _slide(self, value: int) -> None:
        if self._sequence is not None and self._may:
            self._is_shown = True
            self._go(self._sequence.duration * value / self.slider.maximum())

    def _go(self, t_s: float) -> None:
        sequence = self._sequence
        if sequence is None:
            return
        self.t_s = min(t_s, sequence.duration)
        if self.t_s >= sequence.duration:
            self._is_playing = False
        self._write()
        self.posed.emit(pose_at(sequence, self.t_s))

    def _write(self) -> None:
        language, sequence = self.language, self._sequence
        self.play_button.setText(say("dry_run_pause" if self._is_playing else "dry_run_play", language))
        for widget in (self.play_button, self.slider):
            widget.setEnabled(self._may)
        self.end_button.setEnabled(self._is_shown)
        if sequence is None or not self._may:
            set_text(self.time, "")
            share = 0.0
        else:
            now, whole = show_duration(self.t_s), show_duration(sequence.duration)
            set_text(self.time, say("dry_run_time", language).format(now=now, whole=whole))
            share = self.t_s / sequence.duration if sequence.duration > 0 else 0.0
        self.slider.blockSignals(True)
        self.slider.setValue(round(share * self.slider.maximum()))
        self.slider.blockSignals(False)
