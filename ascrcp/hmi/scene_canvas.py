"""The 3-D picture: a cloud drawn chunk by chunk, path and sprayed part over it, the arm on top."""

import numpy as np
from PySide6.QtCore import QByteArray, QDataStream, QPointF, Qt
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPainterPath, QPaintEvent, QPen, QResizeEvent
from PySide6.QtWidgets import QWidget

from ascrcp.core.errors import DeviceError
from ascrcp.core.geometry import Array
from ascrcp.hmi.camera import NEAR, Camera
from ascrcp.hmi.cloud import CloudPainter, SplatCloud
from ascrcp.hmi.preparation import Prepared
from ascrcp.hmi.scene_part import (
    ArmLine,
    arrow_wings,
    label_table,
    path_segments,
    project_lines,
    unsolved_points,
    wall_hits,
)
from ascrcp.hmi.theme import Screen, colour_fields, rgb
from ascrcp.session.snapshot import Scene

SPRAYED_PX = 5
"""Width of the sprayed band on the wall [px]."""
SPRAYED_ALPHA = 90
NOW_PX = 4
"""Width of the pass under way [px]."""
DRAG_DEG_PX = 0.3
"""Degrees the view turns for a pixel dragged; the buttons do the same without dragging."""
GHOST_DASH = (3.0, 2.0)


def make_painter(screen: Screen, allow_gl: bool = True) -> CloudPainter:
    """Return the cloud's painter: with OpenGL where a context can be made, else without."""
    if not allow_gl:
        return SplatCloud(screen.view.chunk_drawn)
    try:
        from ascrcp.hmi.cloud_gl import GlCloud  # loads libGL, absent on a bare machine

        return GlCloud(screen.view.chunk_gl)
    except (DeviceError, ImportError, AttributeError):  # no context, no libGL (PyOpenGL says AttributeError)
        return SplatCloud(screen.view.chunk_drawn)


ELEMENT = np.dtype([("kind", ">i4"), ("x", ">f8"), ("y", ">f8")])
"""A point of a QPainterPath as QDataStream writes it: 0 moves there, 1 draws a line to it."""


def lines_of(pairs: Array) -> QPainterPath:
    """Return lines between pixels, shape (k, 2, 2), as one path.

    Read from a stream: 2,000 lines are no objects of Python's, and take 0.2 ms instead of 1.
    """
    count = 2 * len(pairs)
    data = bytearray(4 + count * ELEMENT.itemsize + 8)  # how many; points; where it began, rule of filling
    data[:4] = count.to_bytes(4, "big")
    points = np.frombuffer(data, ELEMENT, count, offset=4)
    points["kind"][1::2] = 1
    points["x"], points["y"] = pairs.reshape(-1, 2).T
    path = QPainterPath()
    if count:
        QDataStream(QByteArray(bytes(data))) >> path
    return path


class SceneCanvas(QWidget):
    """Keeps the cloud's picture until scene, camera, size or colours change.

    `advance` is called at every refresh: it draws one more chunk of the cloud, so that a view that
    turns shows an even sample and one at rest fills up.
    """

    def __init__(self, screen: Screen, camera: Camera, painter: CloudPainter | None = None) -> None:
        super().__init__()
        self.painter = painter or make_painter(screen)
        self.camera = camera
        self._prepared: Prepared | None = None
        self._scene = Scene()
        self._hits: Array = np.zeros((0, 3))
        self._segments = path_segments(self._scene)
        self._done, self._drawn = -1, -1
        self._now = self._segments[:0]
        self._arm: ArmLine | None = None
        self._ghost: ArmLine | None = None
        self._still: QImage | None = None
        self._layer: QImage | None = None
        self._is_stale, self._has_more = True, False
        self._held: QPointF | None = None
        self.set_theme(screen)

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        colours = screen.look.scene
        self._table = label_table(colours)
        self._pens = {name: QColor(value) for name, value in colour_fields(colours).items()}
        self._void = rgb(screen.look.colours.void)
        self._send_cloud()

    def look(self, camera: Camera) -> None:
        """Take another camera."""
        self.camera = camera
        self._forget()

    def draw_scene(self, prepared: Prepared) -> None:
        """Take another scene."""
        self._prepared, self._scene = prepared, prepared.scene
        self._segments, self._hits = path_segments(self._scene), wall_hits(self._scene)
        self._send_cloud()

    def draw_progress(self, point: int, pass_index: int = -1) -> None:
        """Mark the path as done up to a planned point, and the pass under way; -1 for nothing."""
        if point < self._done:
            self._layer = None
        self._done = point
        passes = self._scene.path_pass
        of_pass = passes[self._segments[:, 0]] == pass_index if len(passes) else slice(0, 0)
        self._now = self._segments[of_pass]
        self.update()

    def draw_arm(self, arm: ArmLine) -> None:
        """Put the arm where it is now."""
        self._arm = arm
        self.update()

    def draw_ghost(self, arm: ArmLine | None) -> None:
        """Put the dry run's arm, None for none."""
        self._ghost = arm
        self.update()

    @property
    def is_complete(self) -> bool:
        """Whether every point of the cloud is in the picture."""
        return not (self._is_stale or self._has_more)

    def advance(self) -> None:
        """Draw one more chunk of the cloud if there is one."""
        if self.is_complete:
            return
        if self._is_stale:
            self.painter.begin(self.camera, max(1, self.width()), max(1, self.height()), self._void)
            self._is_stale = False
        self._has_more = self.painter.add()
        self._still = self.painter.image()
        self.update()

    def complete(self) -> None:
        """Draw all of the cloud now: for pictures."""
        while not self.is_complete:
            self.advance()

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802
        """Draw anew in another size."""
        super().resizeEvent(event)
        self._forget()

    def mousePressEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Take hold of the view."""
        self._held = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Turn with the finger."""
        if self._held is not None:
            moved, self._held = event.position() - self._held, event.position()
            self.look(self.camera.turn(-DRAG_DEG_PX * moved.x()))

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Copy the kept pictures, then draw the arm over them."""
        if self._still is None:
            self.advance()
        layer = self._layer or self._draw_layer()
        self._draw_done(layer)
        painter = QPainter(self)
        if self._still is not None:
            painter.drawImage(0, 0, self._still)
        painter.drawImage(0, 0, layer)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._draw_now(painter)
        if self._arm is not None:
            self._draw_arm(painter, self._arm, is_ghost=False)
        if self._ghost is not None:
            self._draw_arm(painter, self._ghost, is_ghost=True)
        painter.end()

    def _send_cloud(self) -> None:
        if self._prepared is not None:
            self.painter.take(self._prepared.points, self._prepared.labels, self._table)
        self._forget()

    def _forget(self) -> None:
        self._is_stale, self._layer = True, None
        self.update()

    def _draw_layer(self) -> QImage:
        layer = QImage(max(1, self.width()), max(1, self.height()), QImage.Format.Format_ARGB32_Premultiplied)
        layer.fill(0)
        painter = QPainter(layer)
        lines = project_lines(self._scene.path[self._segments], self.camera, layer.width(), layer.height())
        painter.setPen(QPen(self._pens["path"], 1))
        painter.drawPath(lines_of(lines))
        painter.setPen(QPen(self._pens["path"], 2))
        painter.drawPath(lines_of(arrow_wings(lines)))
        self._dots(painter, unsolved_points(self._scene), "path_unsolved", 3.0)
        painter.end()
        self._layer, self._drawn = layer, -1
        return layer

    def _draw_done(self, layer: QImage) -> None:
        """Draw only what was added to the done part since the last time: band on the wall, path."""
        if self._done <= self._drawn:
            return
        fresh = self._segments[(self._segments[:, 1] > self._drawn) & (self._segments[:, 1] <= self._done)]
        painter = QPainter(layer)
        if len(self._hits):
            band = QColor(self._pens["path_done"])
            band.setAlpha(SPRAYED_ALPHA)
            painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_DestinationOver)
            self._lines(painter, self._hits[fresh], QPen(band, SPRAYED_PX))
            painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        self._lines(painter, self._scene.path[fresh], QPen(self._pens["path_done"], 2))
        painter.end()
        self._drawn = self._done

    def _draw_now(self, painter: QPainter) -> None:
        """Draw the pass under way: what is done of it and what is left, over all others."""
        is_done = self._now[:, 1] <= self._done
        for part, colour in ((self._now[~is_done], "path"), (self._now[is_done], "path_done")):
            if len(part):
                self._lines(painter, self._scene.path[part], QPen(self._pens[colour], NOW_PX))

    def _draw_arm(self, painter: QPainter, arm: ArmLine, is_ghost: bool) -> None:
        pen = QPen(self._pens["target" if is_ghost else "arm"], 4 if is_ghost else 6)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        if is_ghost:
            pen.setDashPattern(GHOST_DASH)
        self._lines(painter, np.stack([arm.chain[:-1], arm.chain[1:]], 1), pen)
        self._dots(painter, arm.chain, "joint", 4.0)
        self._lines(painter, arm.spray[None], QPen(self._pens["spray"], 6 if arm.spraying else 2))

    def _lines(self, painter: QPainter, lines: Array, pen: QPen) -> None:
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        painter.setPen(pen)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawPath(lines_of(project_lines(lines, self.camera, self.width(), self.height())))

    def _dots(self, painter: QPainter, points: Array, colour: str, radius: float) -> None:
        if not len(points):
            return
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(self._pens[colour])
        pixels, depth = self.camera.project(points, self.width(), self.height())
        for x, y in pixels[depth > NEAR].tolist():
            painter.drawEllipse(QPointF(x, y), radius, radius)
