"""Trends of the last minutes: values noted at every refresh, drawn a few times a second."""

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout

from ascrcp.hmi.panel import Panel, make_label, set_text
from ascrcp.hmi.quantity import Quantity
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.session.snapshot import Snapshot

if TYPE_CHECKING:
    from ascrcp.hmi.trend_plot import TrendPlot

SAMPLES = 360
"""Values kept of each: more could not be told apart on the panel."""
INTERVALS = 4
"""Of the vertical axis, about."""
STEPS = (1.0, 2.0, 5.0, 10.0)
KEPT = 3.0
"""The axis is left as it is until the values would fill less than this part of it, or leave it."""
LEGEND_PX = 170
LOOK_MS = 50


class Recorder:
    """Job time, joints, targets and nozzle error of the last minutes, evenly thinned."""

    def __init__(self, span_s: float) -> None:
        self.span_s = span_s
        self._step_s = span_s / SAMPLES
        self.rows: deque[tuple[float, tuple[float, ...], tuple[float, ...], float]] = deque(
            maxlen=SAMPLES + 1
        )

    def note(self, snapshot: Snapshot) -> bool:
        """Take a snapshot if the last one taken is old enough; return whether it was."""
        t = snapshot.t_s
        if self.rows and t < self.rows[-1][0]:
            self.rows.clear()  # another session
        if self.rows and t - self.rows[-1][0] < self._step_s:
            return False
        while self.rows and t - self.rows[0][0] > self.span_s:
            self.rows.popleft()
        self.rows.append((t, snapshot.q, snapshot.q_target, snapshot.tip_error_mm))
        return True

    def joint(self, index: int) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Return (time, value) of a joint's actual place and of its target."""
        actual = [(t, q[index]) for t, q, _, _ in self.rows if index < len(q)]
        target = [(t, w[index]) for t, _, w, _ in self.rows if index < len(w)]
        return actual, target

    def tip(self) -> list[tuple[float, float]]:
        """Return (time, nozzle error [mm])."""
        return [(t, error) for t, _, _, error in self.rows]


@dataclass(frozen=True)
class Curves:
    """What a trend draws.

    Attributes:
        title: Above the curves.
        unit: How the values are shown.
        actual, target: Points (time [s], value); NaN breaks a line.
        now_s: Right end of the axis [s].
    """

    title: str
    unit: Quantity
    actual: list[tuple[float, float]]
    target: list[tuple[float, float]]
    now_s: float


@dataclass(frozen=True)
class Axis:
    """The vertical axis, in shown units: round ends and round steps.

    Attributes:
        low, high: Its ends.
        step: From one line to the next.
    """

    low: float
    high: float
    step: float

    def ticks(self) -> list[float]:
        """Return where its lines are."""
        return [self.low + k * self.step for k in range(round((self.high - self.low) / self.step) + 1)]


def find_axis(curves: Curves, before: Axis | None = None) -> Axis:
    """Return an axis that shows all values; the one before while it still suits, so that it stands still."""
    values = [v for _, v in (*curves.actual, *curves.target) if math.isfinite(v)]
    unit = curves.unit
    least = 10.0**-unit.decimals  # of the shown number: a joint at rest is a line, not noise
    low, high = (unit.scale * min(values), unit.scale * max(values)) if values else (0.0, least)
    wide = KEPT * max(high - low, INTERVALS * least)
    if before is not None and before.low <= low and high <= before.high <= before.low + wide:
        return before
    rough = max((high - low) / INTERVALS, least)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(s * power for s in STEPS if s * power >= rough * (1.0 - 1e-9))
    first, last = math.floor(low / step), math.ceil(high / step)
    return Axis(first * step, max(last, first + 2) * step, step)


class TrendView(Panel):
    """Title and legend above the plot; the plot itself is made when it is first drawn, or before.

    Its library takes 0.2 s to load, the plot 20 ms to make: an application does both right after its
    start (`make_soon`), while nothing moves.
    """

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self._screen = screen
        self._plot: TrendPlot | None = None
        self._loading: threading.Thread | None = None
        self.title = make_label("title")
        self.legend = QLabel()
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.legend.setProperty("role", "small")
        self.legend.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.legend.setWordWrap(True)
        self.legend.setFixedWidth(LEGEND_PX)
        row = QHBoxLayout()
        row.addWidget(self.title, 1)
        row.addWidget(self.legend)
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(6, 2, 4, 0)
        self._column.setSpacing(0)
        self._column.addLayout(row)
        self._column.addStretch()

    def set_language(self, language: Language) -> None:
        """Write the legend in a language."""
        super().set_language(language)
        chart = self._screen.look.chart
        entries = (("trend_actual", chart.actual, "━"), ("trend_target", chart.target, "╍"))
        self.legend.setText(
            "&nbsp;&nbsp;".join(
                f'<span style="color:{colour}">{mark}</span> {say(key, language)}'
                for key, colour, mark in entries
            )
        )

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen = screen
        self.set_language(self.language)
        if self._plot is not None:
            self._plot.set_theme(screen)

    def draw(self, curves: Curves) -> None:
        """Take other curves."""
        set_text(self.title, curves.title)
        self._make().draw(curves)

    def make_soon(self) -> None:
        """Load the library in a thread, then make the plot."""
        if self._loading is None:
            self._loading = threading.Thread(target=load_plot, name="ascrcp-plot", daemon=True)
            self._loading.start()
        if self._loading.is_alive():
            QTimer.singleShot(LOOK_MS, self, self.make_soon)
        else:
            self._make()

    def close_loading(self) -> None:
        """Wait for the thread, if there is one: it may not outlive the window."""
        if self._loading is not None:
            self._loading.join()

    def _make(self) -> "TrendPlot":
        if self._plot is None:
            self._plot = load_plot()(self._screen)
            self._column.takeAt(self._column.count() - 1)
            self._column.addWidget(self._plot.widget, 1)
            self._plot.widget.show()  # at once, for a picture taken before the next event
            self._column.activate()
        return self._plot


def load_plot() -> "type[TrendPlot]":
    """Load the plot and its library."""
    from ascrcp.hmi.trend_plot import TrendPlot

    return TrendPlot
