"""Trends of the last minutes: values noted at every refresh, drawn a few times a second."""

import math
from collections import deque
from dataclasses import dataclass

from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from ascrcp.hmi.quantity import Quantity, show_duration
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.session.snapshot import Snapshot

SAMPLES = 360
"""Values kept of each: more could not be told apart on the panel."""
TEXT_PX = 15
LEFT_PX, BOTTOM_PX, TOP_PX = 78, 24, 26
LEAST_SPAN = 1e-3
"""Smallest range of the vertical axis [rad, m, mm]: a joint at rest is a line, not noise."""
TICKS = 3


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
        span_s: Its length [s].
    """

    title: str
    unit: Quantity
    actual: list[tuple[float, float]]
    target: list[tuple[float, float]]
    now_s: float
    span_s: float


def value_range(curves: Curves) -> tuple[float, float]:
    """Return the ends of the vertical axis: all values with a little room."""
    values = [v for _, v in (*curves.actual, *curves.target) if math.isfinite(v)]
    if not values:
        return 0.0, 1.0
    low, high = min(values), max(values)
    room = max(0.1 * (high - low), LEAST_SPAN / curves.unit.scale * 10)
    return low - room, high + room


class TrendView(QWidget):
    """Two curves with their axes, painted by hand: cheaper than a plot widget."""

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self.setObjectName("trend")
        self._screen, self._language = screen, Language.EN
        self._curves: Curves | None = None

    def set_language(self, language: Language) -> None:
        """Write the legend in a language."""
        self._language = language
        self.update()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen = screen
        self.update()

    def draw(self, curves: Curves) -> None:
        """Take other curves."""
        self._curves = curves
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Paint axes, curves and legend."""
        look = self._screen.look
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(look.colours.void))
        font = QFont(self.font())
        font.setPixelSize(TEXT_PX)
        painter.setFont(font)
        curves = self._curves
        if curves is not None:
            area = QRectF(LEFT_PX, TOP_PX, self.width() - LEFT_PX - 10, self.height() - TOP_PX - BOTTOM_PX)
            low, high = value_range(curves)
            self._draw_axes(painter, area, curves, low, high)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            for points, colour, width, style in (
                (curves.target, look.chart.target, 2, Qt.PenStyle.DashLine),
                (curves.actual, look.chart.actual, 2, Qt.PenStyle.SolidLine),
            ):
                painter.setPen(QPen(QColor(colour), width, style))
                self._draw_curve(painter, area, curves, points, low, high)
        painter.end()

    def _draw_axes(self, painter: QPainter, area: QRectF, curves: Curves, low: float, high: float) -> None:
        look, language = self._screen.look, self._language
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        for tick in range(TICKS):
            share = tick / (TICKS - 1)
            y = area.bottom() - share * area.height()
            painter.setPen(QPen(QColor(look.chart.grid), 1))
            painter.drawLine(QLineF(area.left(), y, area.right(), y))
            painter.setPen(QColor(look.colours.text))
            painter.drawText(
                QRectF(0, y - 11, LEFT_PX - 6, 22), right, curves.unit.show(low + share * (high - low))
            )
        span = say("trend_span", language).format(time=show_duration(curves.span_s))
        painter.drawText(QRectF(area.left(), area.bottom() + 2, area.width(), BOTTOM_PX), right, span)
        left = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(8, 0, area.width(), TOP_PX), left, curves.title)
        legend = [("trend_actual", look.chart.actual, "━")]
        if curves.target:
            legend.append(("trend_target", look.chart.target, "╍"))
        x = self.width() - 10.0
        for key, colour, mark in reversed(legend):
            text = f"{mark} {say(key, language)}"
            wide = painter.fontMetrics().horizontalAdvance(text) + 16
            x -= wide
            painter.setPen(QColor(colour))
            painter.drawText(QRectF(x, 0, wide, TOP_PX), left, text)

    def _draw_curve(
        self,
        painter: QPainter,
        area: QRectF,
        curves: Curves,
        points: list[tuple[float, float]],
        low: float,
        high: float,
    ) -> None:
        across, up = area.width() / curves.span_s, area.height() / (high - low)
        begin = curves.now_s - curves.span_s
        piece: list[QPointF] = []
        for t, value in (*points, (math.nan, math.nan)):
            if math.isfinite(value) and t >= begin:
                piece.append(QPointF(area.left() + across * (t - begin), area.bottom() - up * (value - low)))
            elif piece:
                painter.drawPolyline(QPolygonF(piece))
                piece = []
