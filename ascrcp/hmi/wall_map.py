"""The unrolled wall as a map: overbreak or thickness, arches, regions, the nozzle, the chosen section.

Left of the picture is left of the tunnel seen towards the face, up is into the tunnel.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array, inverse_transform
from ascrcp.hmi import quantity
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, colour_scale, rgb
from ascrcp.session.snapshot import Scene, WallLayer

MARGIN_LEFT, MARGIN_RIGHT, MARGIN_TOP, MARGIN_BOTTOM = 46, 112, 26, 26
"""Around the map: stations at the left, scale at the right, names above and below [px]."""
SIGNED_M = 0.4
"""The scale of offsets runs so far both ways [m]."""
LAYER_M = 0.3
"""The scale of thickness runs to here [m]."""
FONT_PX = 15
ARCH_COLUMNS = 60
SHOWN_BEFORE_M = 1.0
"""So much of the sprayed part is shown before the part to spray [m]."""


@dataclass(frozen=True)
class WallView:
    """What of the wall is shown: stations and arc lengths, both rising [m]."""

    station: tuple[float, float]
    along: tuple[float, float]


def window_of(surface: Surface) -> WallView:
    """Return the part of a wall worth showing: what is to be sprayed and a little before it."""
    s0, s1 = surface.unsprayed
    low = max(float(surface.station[0]), s0 - SHOWN_BEFORE_M)
    high = min(float(surface.station[-1]), s1)
    if not high - low >= 0.2:
        low, high = float(surface.station[0]), float(surface.station[-1])
    return WallView((low, high), (0.0, surface.profile.length))


def paint_values(
    layer: WallLayer, view: WallView, table: NDArray[np.uint8], span: tuple[float, float], unknown: str
) -> QImage:
    """Return the shown part of a layer as a picture, one pixel a cell, left of the tunnel at the left."""
    rows = (layer.station >= view.station[0]) & (layer.station <= view.station[1])
    values = np.asarray(layer.values[rows], np.float32)[::-1, ::-1]  # up is into the tunnel, left is left
    low, high = span
    index = (values - np.float32(low)) * np.float32((len(table) - 1) / (high - low))
    np.clip(index, 0.0, len(table) - 1.0, out=index)
    index[np.isnan(index)] = len(table)
    colours = np.full((len(table) + 1, 4), 255, np.uint8)
    colours[:-1, :3], colours[-1, :3] = table[:, ::-1], rgb(unknown)[::-1]
    picture = np.take(colours.view(np.uint32)[:, 0], index.astype(np.int32))
    height, width = picture.shape
    return QImage(picture.data, width, height, 4 * width, QImage.Format.Format_RGB32).copy()


class WallMap(QWidget):
    """The map; a touch chooses the section.

    Signals:
        chosen: Station touched [m].
    """

    chosen = Signal(float)

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self.setObjectName("wall_map")
        self._screen, self._language = screen, Language.EN
        self._scene = Scene()
        self._layer = "offset"
        self._view: WallView | None = None
        self._still: QImage | None = None
        self._picture: QImage | None = None  # the values alone: kept when only names change
        self._T_tunnel_base: Array = np.eye(4)
        self._nozzle: tuple[float, float] | None = None
        self.station = math.nan

    def set_language(self, language: Language) -> None:
        """Write names in a language."""
        self._language = language
        self._forget()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen, self._picture = screen, None
        self._forget()

    def draw_scene(self, scene: Scene) -> None:
        """Take another wall."""
        self._scene = scene
        surface = scene.surface
        self._view = None if surface is None or len(surface.station) < 2 else window_of(surface)
        if surface is not None:
            self._T_tunnel_base = inverse_transform(surface.axis.T_base_tunnel)
        self._nozzle, self._picture = None, None
        self._forget()

    def choose_layer(self, name: str) -> None:
        """Show "offset", "predicted" or "achieved"."""
        self._layer, self._picture = name, None
        self._forget()

    def choose_station(self, station: float) -> None:
        """Mark a section [m]."""
        if station != self.station:
            self.station = station
            self.update()

    def show_nozzle(self, position: tuple[float, ...], direction: tuple[float, ...]) -> None:
        """Mark where the jet meets the wall; a nozzle not known is not drawn."""
        place = self._find_nozzle(position, direction)
        if place != self._nozzle:
            self._nozzle = place
            self.update()

    def layer(self, name: str) -> WallLayer | None:
        """Return a map the scene holds, None if it does not."""
        surface = self._scene.surface
        if name == "offset":
            return None if surface is None else WallLayer(surface.station, surface.along, surface.offset)
        return self._scene.predicted if name == "predicted" else self._scene.achieved

    def nozzle_station(self) -> float:
        """Station at which the jet meets the wall [m], NaN unknown."""
        return self._nozzle[0] if self._nozzle is not None else math.nan

    def mousePressEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Choose the section touched."""
        view, area = self._view, self._area()
        if view is not None and area.contains(event.position()):
            share = (area.bottom() - event.position().y()) / area.height()
            self.chosen.emit(view.station[0] + share * (view.station[1] - view.station[0]))

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Copy the kept picture, then mark section and nozzle on it."""
        if self._still is None or self._still.size() != self.size():
            self._still = self._draw_still()
        painter = QPainter(self)
        painter.drawImage(0, 0, self._still)
        if self._view is not None:
            self._mark(painter)
        painter.end()

    def _find_nozzle(
        self, position: tuple[float, ...], direction: tuple[float, ...]
    ) -> tuple[float, float] | None:
        surface = self._scene.surface
        if surface is None or not all(map(math.isfinite, (*position, *direction))):
            return None
        hit = self._T_tunnel_base[:3, :3] @ (np.asarray(position) + np.asarray(direction))
        s, y, z = (hit + self._T_tunnel_base[:3, 3]).tolist()
        along, _ = surface.profile.locate(np.array([[y, z]]))
        return round(s, 2), round(float(along[0]), 2)

    def _forget(self) -> None:
        self._still = None
        self.update()

    def _area(self) -> QRectF:
        return QRectF(
            MARGIN_LEFT,
            MARGIN_TOP,
            max(1.0, self.width() - MARGIN_LEFT - MARGIN_RIGHT),
            max(1.0, self.height() - MARGIN_TOP - MARGIN_BOTTOM),
        )

    def _place(self, station: float, along: float) -> QPointF:
        view, area = self._view, self._area()
        assert view is not None
        across = (along - view.along[0]) / (view.along[1] - view.along[0])
        up = (station - view.station[0]) / (view.station[1] - view.station[0])
        return QPointF(area.right() - across * area.width(), area.bottom() - up * area.height())

    def _draw_still(self) -> QImage:
        colours = self._screen.look.colours
        still = QImage(self.size(), QImage.Format.Format_RGB32)
        still.fill(QColor(colours.void))
        painter = QPainter(still)
        font = QFont(self.font())
        font.setPixelSize(FONT_PX)
        painter.setFont(font)
        painter.setPen(QColor(colours.text))
        layer = self.layer(self._layer)
        if self._view is None or layer is None:
            key = "wall_none" if self._view is None else "wall_no_layer"
            painter.drawText(still.rect(), Qt.AlignmentFlag.AlignCenter, say(key, self._language))
        else:
            self._draw_map(painter, layer, self._view)
        painter.end()
        return still

    def _draw_map(self, painter: QPainter, layer: WallLayer, view: WallView) -> None:
        chart, area = self._screen.look.chart, self._area()
        signed = self._layer == "offset"
        table = colour_scale(chart.signed if signed else chart.layer)
        span = (-SIGNED_M, SIGNED_M) if signed else (0.0, LAYER_M)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        picture = self._picture or paint_values(layer, view, table, span, chart.unknown)
        self._picture = picture
        painter.drawImage(area, picture)
        painter.setClipRect(area)
        surface = self._scene.surface
        assert surface is not None
        self._draw_findings(painter, surface)
        painter.setClipping(False)
        painter.setPen(QPen(QColor(self._screen.look.colours.border), 1))
        painter.drawRect(area)
        self._draw_axes(painter, view)
        self._draw_scale(painter, table, span)

    def _draw_findings(self, painter: QPainter, surface: Surface) -> None:
        scene, dark = self._screen.look.scene, QColor("#000000")
        s0, _ = surface.unsprayed
        painter.setPen(QPen(dark, 2, Qt.PenStyle.DashLine))
        painter.drawLine(QLineF(self._place(s0, 0.0), self._place(s0, surface.profile.length)))
        along = np.linspace(0.0, surface.profile.length, ARCH_COLUMNS)
        height = surface.profile.point(along)[:, 1]
        height = height - height.max()  # an arch's station is that of its crown
        for arch in surface.arches:
            lean = math.tan(math.radians(arch.lean_deg))
            middle = arch.station + lean * height
            edges = [
                self._place(float(s) + side * arch.width / 2, float(a))
                for side, order in ((-1, slice(None)), (1, slice(None, None, -1)))
                for s, a in zip(middle[order], along[order], strict=True)
            ]
            fill = QColor(scene.arch)
            fill.setAlpha(150)
            painter.setBrush(fill)
            painter.setPen(QPen(dark, 1))
            painter.drawPolygon(QPolygonF(edges))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        taken: list[QRectF] = []
        for region in surface.overbreak:
            box = self._region_box(surface, region.station, region.angle_deg)
            painter.setPen(QPen(dark, 3))
            painter.drawRect(box)
            taken.append(box)
        for box, region in zip(tuple(taken), surface.overbreak, strict=True):
            taken.append(self._write_depth(painter, box, region.max_depth_m, taken))

    def _region_box(
        self, surface: Surface, station: tuple[float, float], angle_deg: tuple[float, float]
    ) -> QRectF:
        along = np.linspace(0.0, surface.profile.length, 400)
        low, high = np.interp(np.radians(angle_deg), surface.profile.angle(along), along)
        return QRectF(self._place(station[1], high), self._place(station[0], low))

    def _write_depth(self, painter: QPainter, box: QRectF, depth: float, taken: list[QRectF]) -> QRectF:
        """Write a depth by its region, above, below or beside, where it covers no other; return its place."""
        text = "+" + quantity.DEPTH.show(depth)
        area = self._area()
        label = QRectF(0, 0, painter.fontMetrics().horizontalAdvance(text) + 10, FONT_PX + 8)
        rows, columns = label.height() + 3, 0.5 * (box.width() + label.width()) + 3
        places = [(0.0, side * (0.5 * (box.height() + label.height()) + 3)) for side in (-1, 1)]
        places += [(side * columns, row * rows) for row in (0, 1, -1, 2, -2) for side in (1, -1)]
        for dx, dy in places:
            label.moveCenter(QPointF(box.center().x() + dx, box.center().y() + dy))
            label.moveLeft(min(max(label.left(), area.left()), area.right() - label.width()))
            if area.contains(label) and not any(label.intersects(other) for other in taken):
                break
        painter.fillRect(label, QColor(self._screen.look.colours.panel))
        painter.setPen(QColor(self._screen.look.colours.text))
        painter.drawText(label, Qt.AlignmentFlag.AlignCenter, text)
        return QRectF(label)

    def _draw_axes(self, painter: QPainter, view: WallView) -> None:
        area, language = self._area(), self._language
        painter.setPen(QColor(self._screen.look.colours.text))
        step = next(
            s for s in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0) if (view.station[1] - view.station[0]) / s <= 8
        )
        first = math.ceil(view.station[0] / step)
        for number in range(first, math.floor(view.station[1] / step) + 1):
            y = self._place(number * step, 0.0).y()
            painter.drawLine(QLineF(area.left() - 5, y, area.left(), y))
            box = QRectF(0, y - 10, MARGIN_LEFT - 8, 20)
            right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            painter.drawText(box, right, f"{number * step:.1f}")
        below = QRectF(area.left(), area.bottom() + 3, area.width(), MARGIN_BOTTOM - 4)
        for flag, key in (
            (Qt.AlignmentFlag.AlignLeft, "wall_left"),
            (Qt.AlignmentFlag.AlignHCenter, "wall_crown"),
            (Qt.AlignmentFlag.AlignRight, "wall_right"),
        ):
            painter.drawText(below, flag, say(key, language))
        painter.drawText(QRectF(area.left(), 2, area.width(), MARGIN_TOP - 4), Qt.AlignmentFlag.AlignLeft,
                         say("wall_face", language))  # fmt: skip

    def _draw_scale(self, painter: QPainter, table: NDArray[np.uint8], span: tuple[float, float]) -> None:
        area = self._area()
        bar = QRectF(area.right() + 12, area.top() + 22, 18, max(20.0, area.height() - 60))
        column = np.ascontiguousarray(table[::-1, None])
        painter.drawImage(bar, QImage(column.data, 1, len(table), 3, QImage.Format.Format_RGB888).copy())
        painter.setPen(QColor(self._screen.look.colours.text))
        painter.drawRect(bar)
        left = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        for share in (0.0, 0.5, 1.0):
            value = span[0] + share * (span[1] - span[0])
            number = f"{1000 * value:+.0f} mm" if span[0] < 0 else f"{1000 * value:.0f} mm"
            y = bar.bottom() - share * bar.height()
            painter.drawText(QRectF(bar.right() + 5, y - 11, 76, 22), left, number)
        key = "wall_scale_offset" if span[0] < 0 else "wall_scale_layer"
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(self.width() - 240, 0, 236, MARGIN_TOP), right, say(key, self._language))
        box = QRectF(bar.left(), bar.bottom() + 14, 18, 16)
        painter.fillRect(box, QColor(self._screen.look.chart.unknown))
        painter.drawRect(box)
        place = QRectF(box.right() + 5, box.top() - 3, 80, 22)
        painter.drawText(place, left, say("wall_unknown", self._language))

    def _mark(self, painter: QPainter) -> None:
        view, colours = self._view, self._screen.look
        assert view is not None
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if view.station[0] <= self.station <= view.station[1]:
            line = QLineF(self._place(self.station, view.along[0]), self._place(self.station, view.along[1]))
            painter.setPen(QPen(QColor(colours.colours.void), 5))
            painter.drawLine(line)
            painter.setPen(QPen(QColor(colours.colours.focus), 3))
            painter.drawLine(line)
        if self._nozzle is not None and view.station[0] <= self._nozzle[0] <= view.station[1]:
            at = self._place(*self._nozzle)
            for colour, width in (("#000000", 6), (colours.scene.arm, 3)):
                painter.setPen(QPen(QColor(colour), width))
                painter.drawEllipse(at, 12, 12)
                painter.drawLine(QLineF(at.x() - 18, at.y(), at.x() + 18, at.y()))
                painter.drawLine(QLineF(at.x(), at.y() - 18, at.x(), at.y() + 18))
