"""The 3-D view without OpenGL: a NumPy point splat and QPainter lines, same colours and camera."""

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen, QResizeEvent
from PySide6.QtWidgets import QWidget

from ascrcp.core.geometry import Array
from ascrcp.hmi.camera import NEAR, Camera, is_inside
from ascrcp.hmi.scene_part import ArmLine, brightness, label_table, path_segments, unsolved_points
from ascrcp.hmi.theme import SceneColours, colour_fields
from ascrcp.session.snapshot import Scene

SPLAT_PX = 2


def splat(points: NDArray, colours: NDArray[np.uint8], camera: Camera, image: NDArray[np.uint8]) -> None:
    """Paint points into a picture, near over far.

    Args:
        points: Base frame [m], shape (n, 3).
        colours: Blue, green, red of each point, shape (n, 3).
        camera: Where from.
        image: Blue, green, red, unused; painted in place, shape (height, width, 4).
    """
    height, width = image.shape[:2]
    pixels, depth = camera.project(points, width, height)
    inside = is_inside(pixels, depth, width, height)
    if not inside.any():
        return
    xy, depth, colours = pixels[inside], depth[inside], colours[inside]
    xy = np.floor(xy - (SPLAT_PX - 1) / 2).astype(np.int32)
    bright = brightness(depth, np.ones(len(depth), np.bool_))
    order = np.argsort(np.rint(65535.0 * bright).astype(np.uint16), kind="stable")  # far first
    shaded = np.full((len(order), 4), 255, np.uint8)
    shaded[:, :3] = (colours * bright[:, None])[order]
    # all pixels of a point before those of the next, or a far point's corner would cover a near one's
    dx, dy = np.tile(np.arange(SPLAT_PX), SPLAT_PX), np.repeat(np.arange(SPLAT_PX), SPLAT_PX)
    column = np.clip(xy[order, 0, None] + dx, 0, width - 1)
    row = np.clip(xy[order, 1, None] + dy, 0, height - 1)
    image.view(np.uint32).reshape(-1)[row * width + column] = shaded.view(np.uint32)


class DrawnView(QWidget):
    """Draws the scene into a picture that is kept until scene, camera or size change; the arm on top."""

    def __init__(self, colours: SceneColours, void: str, camera: Camera) -> None:
        super().__init__()
        self._table = label_table(colours)[:, ::-1]  # Qt's 32-bit pixels lie as blue, green, red
        self._pens = {name: QColor(value) for name, value in colour_fields(colours).items()}
        self._void = QColor(void)
        self._camera = camera
        self._scene = Scene()
        self._done = -1
        self._drawn = -1
        self._arm: ArmLine | None = None
        self._still: QImage | None = None

    def look(self, camera: Camera) -> None:
        """Take another camera."""
        self._camera = camera
        self._forget()

    def draw_scene(self, scene: Scene) -> None:
        """Take another scene."""
        self._scene = scene
        self._forget()

    def draw_progress(self, point: int) -> None:
        """Mark the path as done up to a planned point; -1 for nothing."""
        if point < self._done:
            self._forget()
        self._done = point
        self.update()

    def draw_arm(self, arm: ArmLine) -> None:
        """Put the arm where it is now."""
        self._arm = arm
        self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802
        """Draw anew in another size."""
        super().resizeEvent(event)
        self._forget()

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Copy the kept picture, then draw the arm over it."""
        still = self._still or self._draw_still()
        self._draw_done(still)
        painter = QPainter(self)
        painter.drawImage(0, 0, still)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self._arm is not None:
            self._line(painter, self._arm.chain, "arm", 5)
            self._dots(painter, self._arm.chain, "joint", 4.0)
            if self._arm.spray is not None:
                self._line(painter, self._arm.spray, "spray", 2 if not self._arm.spraying else 6)
        painter.end()

    def _forget(self) -> None:
        self._still = None
        self._drawn = -1
        self.update()

    def _draw_still(self) -> QImage:
        width, height = max(1, self.width()), max(1, self.height())
        pixels = np.empty((height, width, 4), np.uint8)
        pixels[:] = (self._void.blue(), self._void.green(), self._void.red(), 255)
        scene = self._scene
        splat(scene.points, self._table[scene.labels], self._camera, pixels)
        image = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32).copy()
        painter = QPainter(image)
        segments = path_segments(scene)
        self._pairs(painter, scene.path[segments], "path", 1)
        self._dots(painter, unsolved_points(scene), "path_unsolved", 3.0)
        painter.end()
        self._still = image
        return image

    def _draw_done(self, image: QImage) -> None:
        """Draw only what was added to the done part since the last time."""
        if self._done <= self._drawn:
            return
        segments = path_segments(self._scene)
        fresh = segments[(segments[:, 1] > self._drawn) & (segments[:, 1] <= self._done)]
        painter = QPainter(image)
        self._pairs(painter, self._scene.path[fresh], "path_done", 3)
        painter.end()
        self._drawn = self._done

    def _project(self, points: Array) -> tuple[list[QPointF], list[bool]]:
        pixels, depth = self._camera.project(points, self.width(), self.height())
        return [QPointF(x, y) for x, y in pixels.tolist()], (depth > NEAR).tolist()

    def _line(self, painter: QPainter, points: Array, colour: str, width: int) -> None:
        pairs = np.stack([points[:-1], points[1:]], 1)
        self._pairs(painter, pairs, colour, width)

    def _pairs(self, painter: QPainter, pairs: Array, colour: str, width: int) -> None:
        if not len(pairs):
            return
        painter.setPen(QPen(self._pens[colour], width))
        points, seen = self._project(pairs.reshape(-1, 3))
        for i in range(0, len(points), 2):
            if seen[i] and seen[i + 1]:
                painter.drawLine(points[i], points[i + 1])

    def _dots(self, painter: QPainter, points: Array, colour: str, radius: float) -> None:
        if not len(points):
            return
        painter.setPen(QPen(self._pens[colour], 1))
        painter.setBrush(self._pens[colour])
        for point, seen in zip(*self._project(points), strict=True):
            if seen:
                painter.drawEllipse(point, radius, radius)
