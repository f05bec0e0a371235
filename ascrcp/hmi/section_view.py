"""The section at one station: what was scanned there, with design, arch and overbreak lines."""

import math

import numpy as np
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QImage, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from ascrcp.core.geometry import Array
from ascrcp.hmi import quantity
from ascrcp.hmi.preparation import Prepared, cut, wall_offset
from ascrcp.hmi.scene_part import label_table
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen

HALF_M = 0.04
"""Points so far to both sides of the station belong to the section [m]."""
LINE_POINTS = 60
EDGE_M = 0.6
"""Free space about the design line [m]."""
TEXT_PX, LINE_PX = 15, 22
FOOT_PX = 4 * LINE_PX + 6
"""Legend and figures below the section [px]."""


class SectionView(QWidget):
    """One section, seen towards the face: left is left."""

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self.setObjectName("section_view")
        self._language = Language.EN
        self._prepared: Prepared | None = None
        self._station = math.nan
        self._still: QImage | None = None
        self._lines: list[Array] = []  # design, arch and overbreak line of the profile
        self.set_theme(screen)

    def set_language(self, language: Language) -> None:
        """Write names in a language."""
        self._language = language
        self._forget()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen, self._table = screen, label_table(screen.look.scene)
        self._forget()

    def draw(self, prepared: Prepared) -> None:
        """Take another wall."""
        self._prepared = prepared
        surface = prepared.scene.surface
        if surface is not None:
            along = np.linspace(0.0, surface.profile.length, LINE_POINTS)
            lines = (0.0, surface.profile.arch_line, surface.profile.overbreak_line)
            self._lines = [surface.profile.point(along, offset) for offset in lines]
        self._forget()

    def choose_station(self, station: float) -> None:
        """Show the section at a station [m]."""
        if station != self._station:
            self._station = station
            self._forget()

    def worst(self) -> float:
        """Largest depth beyond the overbreak line in the section [m]; negative inside it, NaN unknown."""
        if self._prepared is None or self._prepared.scene.surface is None:
            return math.nan
        offset = wall_offset(self._prepared, self._station)
        if offset is None or not np.isfinite(offset).any():
            return math.nan
        return float(np.nanmax(offset)) - self._prepared.scene.surface.profile.overbreak_line

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Copy the kept picture."""
        if self._still is None or self._still.size() != self.size():
            self._still = self._draw()
        painter = QPainter(self)
        painter.drawImage(0, 0, self._still)
        painter.end()

    def _forget(self) -> None:
        self._still = None
        self.update()

    def _draw(self) -> QImage:
        colours = self._screen.look.colours
        still = QImage(self.size(), QImage.Format.Format_RGB32)
        still.fill(QColor(colours.void))
        prepared = self._prepared
        surface = prepared.scene.surface if prepared is not None else None
        if prepared is None or surface is None or not math.isfinite(self._station):
            return still
        outline = self._lines[0]
        low, high = outline.min(axis=0) - EDGE_M, outline.max(axis=0) + EDGE_M
        width, height = still.width(), still.height() - FOOT_PX
        scale = min(width / (high[0] - low[0]), height / (high[1] - low[1]))
        middle = (low + high) / 2

        def place(yz: Array) -> Array:
            x = width / 2 - scale * (yz[:, 0] - middle[0])
            return np.stack([x, height / 2 - scale * (yz[:, 1] - middle[1])], -1)

        painter = QPainter(still)
        font = QFont(self.font())
        font.setPixelSize(TEXT_PX)
        painter.setFont(font)
        looks = (
            ("line_design", self._screen.look.scene.design, Qt.PenStyle.SolidLine),
            ("line_arch", self._screen.look.scene.arch, Qt.PenStyle.DashLine),
            ("line_overbreak", self._screen.look.scene.overbreak, Qt.PenStyle.DashDotLine),
        )
        for row, ((key, colour, style), line) in enumerate(zip(looks, self._lines, strict=True)):
            pen = QPen(QColor(colour), 1, style)
            painter.setPen(pen)
            pixels = place(line)
            painter.drawPolyline(QPolygonF([QPointF(x, y) for x, y in pixels.tolist()]))
            self._write_legend(painter, row, key, pen, height)
        self._write_figures(painter, height)
        painter.end()
        points, labels = cut(prepared, self._station, HALF_M)
        self._splat(still, place(points.astype(float)), self._table[labels])  # over the lines: 10 cm are 3 px
        return still

    def _splat(self, image: QImage, pixels: Array, colours: np.ndarray) -> None:
        """Paint points as squares of 2 px into a picture."""
        height, width = image.height(), image.width()
        canvas = np.asarray(image.bits()).view(np.uint32).reshape(height, width)
        xy = np.rint(pixels).astype(np.int32)
        inside = (xy >= 0).all(axis=1) & (xy[:, 0] < width - 1) & (xy[:, 1] < height - FOOT_PX)
        x, y = xy[inside].T
        dots = np.full((len(x), 4), 255, np.uint8)
        dots[:, :3] = colours[inside, ::-1]  # Qt's 32-bit pixels lie as blue, green, red
        values = dots.view(np.uint32)[:, 0]
        for dx in (0, 1):
            for dy in (0, 1):
                canvas[y + dy, x + dx] = values

    def _write_legend(self, painter: QPainter, row: int, key: str, pen: QPen, top: int) -> None:
        y = top + LINE_PX * (row + 0.5)
        painter.setPen(pen)
        painter.drawLine(QLineF(8, y, 48, y))
        painter.setPen(QColor(self._screen.look.colours.text))
        left = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(56, y - 11, self.width() - 60, 22), left, say(key, self._language))

    def _write_figures(self, painter: QPainter, top: int) -> None:
        worst = self.worst()
        beyond = say("section_worst", self._language).format(depth=quantity.DEPTH.show(worst))
        text = beyond if worst > 0.0 else say("section_calm", self._language)
        if not math.isfinite(worst):
            text = quantity.NOTHING
        painter.setPen(QColor(self._screen.look.colours.text))
        left = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(8, top + 3 * LINE_PX, self.width() - 12, LINE_PX), left, text)
