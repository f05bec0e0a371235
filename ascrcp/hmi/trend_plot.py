"""The plot of a trend, by pyqtgraph: two curves over the last minutes.

Both axes stand still while they can: then only the curves are drawn anew, 0.5 ms instead of 4 (measured).
"""

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QFont, QPen
from PySide6.QtWidgets import QSizePolicy

from ascrcp.hmi.quantity import show_duration
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.trend import Axis, Curves, find_axis

LEFT_PX, BOTTOM_PX = 74, 24
TEXT_PX = 14
ROOM = 0.04
"""Beyond the ends of the axes, so that their numbers are not cut off; twice as much upright."""
SPANS = 3
"""Parts the time is divided in."""


class TrendPlot:
    """Actual and target over time, to look at: nothing in it can be pressed or dragged.

    Attributes:
        widget: What shows it.
    """

    def __init__(self, screen: Screen) -> None:
        self.widget = pg.PlotWidget()
        self.widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self._axis: Axis | None = None
        self._unit = ""
        item = self.widget.getPlotItem()
        item.setMenuEnabled(False)
        item.hideButtons()
        self._box = item.getViewBox()
        self._box.setMouseEnabled(False, False)
        self._box.disableAutoRange()
        span_s = screen.trend_s
        self._box.setXRange(-span_s, 0.0, padding=ROOM)
        self._left, self._bottom = item.getAxis("left"), item.getAxis("bottom")
        self._left.setWidth(LEFT_PX)
        self._bottom.setHeight(BOTTOM_PX)
        font = QFont(self.widget.font())
        font.setPixelSize(TEXT_PX)
        for axis in (self._left, self._bottom):
            axis.setStyle(tickFont=font, tickLength=0)
        self._left.setGrid(70)
        times = [-span_s * k / SPANS for k in range(SPANS + 1)]
        self._bottom.setTicks([[(t, f"-{show_duration(-t)}" if t else "0:00") for t in times]])
        self.widget.setInteractive(False)
        self.widget.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.widget.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._target, self._actual = item.plot(), item.plot()
        self.set_theme(screen)

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        colours, chart = screen.look.colours, screen.look.chart
        self.widget.setBackground(QColor(colours.void))
        for axis in (self._left, self._bottom):
            axis.setPen(QColor(chart.grid))
            axis.setTextPen(QColor(colours.text))
        self._target.setPen(_pen(chart.target, Qt.PenStyle.DashLine))
        self._actual.setPen(_pen(chart.actual, Qt.PenStyle.SolidLine))

    def draw(self, curves: Curves) -> None:
        """Take other curves."""
        axis = find_axis(curves, self._axis if curves.unit.unit == self._unit else None)
        if axis != self._axis or curves.unit.unit != self._unit:
            self._axis, self._unit = axis, curves.unit.unit
            shown = [(v, curves.unit.show(v / curves.unit.scale)) for v in axis.ticks()]
            self._left.setTicks([shown])
            self._box.setYRange(axis.low, axis.high, padding=2.0 * ROOM)
        for curve, points in ((self._target, curves.target), (self._actual, curves.actual)):
            table = np.array(points, dtype=float).reshape(-1, 2)
            t, values = table[:, 0] - curves.now_s, curves.unit.scale * table[:, 1]
            curve.setData(t, values, connect="finite")


def _pen(colour: str, style: Qt.PenStyle) -> QPen:
    return pg.mkPen(QColor(colour), width=2, style=style)
