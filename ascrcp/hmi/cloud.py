"""The cloud as a picture, chunk by chunk: what both ways of drawing it share, and the one without OpenGL."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QImage

from ascrcp.hmi.camera import Camera, is_inside

SPLAT_PX = 2
FADE = 0.4
"""Share of its brightness the farthest point loses, so that depth can be seen."""
LEAST_DEPTH = 0.1
"""Depth of a picture is taken to be at least this [m]."""
SAMPLE = 4000
"""Points by which nearest and farthest are judged: the first, being an even sample."""


class CloudPainter(Protocol):
    """Draws a cloud a chunk at a time, so that no call takes long."""

    def take(self, points: NDArray[np.float32], labels: NDArray[np.uint8], table: NDArray[np.uint8]) -> None:
        """Take another cloud: points (n, 3), labels (n,), red green blue by label (256, 3)."""

    def begin(self, camera: Camera, width: int, height: int, void: tuple[int, int, int]) -> None:
        """Begin a picture anew."""

    def add(self) -> bool:
        """Draw the next chunk; return whether there are more."""

    def image(self) -> QImage:
        """Return the picture so far."""

    def close(self) -> None:
        """Give back what is not Python's."""


def depth_range(points: NDArray, camera: Camera, width: int, height: int) -> tuple[float, float]:
    """Return the depths of the nearest and the farthest point seen [m], by a sample."""
    pixels, depth = camera.project(points[:SAMPLE], width, height)
    seen = is_inside(pixels, depth, width, height)
    if not seen.any():
        return 0.0, LEAST_DEPTH
    nearest, farthest = float(depth[seen].min()), float(depth[seen].max())
    return nearest, max(farthest, nearest + LEAST_DEPTH)


def brightness(depth: NDArray, near: float, far: float) -> NDArray:
    """Return how bright points at depths are, from 1 at the nearest to 1 - FADE at the farthest."""
    return np.asarray(1.0 - FADE * np.clip((depth - near) / (far - near), 0.0, 1.0))


class SplatCloud:
    """The cloud drawn by NumPy: squares of 2 px, near over far by a depth for each pixel."""

    def __init__(self, chunk: int) -> None:
        self._chunk = chunk
        self._points = np.zeros((0, 3), np.float32)
        self._labels = np.zeros(0, np.uint8)
        self._table = np.zeros((256, 3), np.uint8)
        self._next = 0
        self._pixels = np.zeros((1, 1, 4), np.uint8)
        self._depth = np.zeros(1, np.float32)
        self._range = (0.0, 1.0)
        self._camera: Camera | None = None

    def take(self, points: NDArray[np.float32], labels: NDArray[np.uint8], table: NDArray[np.uint8]) -> None:
        """Take another cloud."""
        self._points, self._labels = points, labels
        self._table = table[:, ::-1]  # Qt's 32-bit pixels lie as blue, green, red

    def begin(self, camera: Camera, width: int, height: int, void: tuple[int, int, int]) -> None:
        """Begin a picture anew."""
        self._camera, self._next = camera, 0
        if self._pixels.shape[:2] != (height, width):
            self._pixels = np.empty((height, width, 4), np.uint8)
            self._depth = np.empty(width * height, np.float32)
        self._pixels.view(np.uint32).fill(np.array([*void[::-1], 255], np.uint8).view(np.uint32)[0])
        self._depth.fill(np.inf)
        self._range = depth_range(self._points, camera, width, height)

    def add(self) -> bool:
        """Draw the next chunk; return whether there are more."""
        assert self._camera is not None
        chunk = slice(self._next, self._next + self._chunk)
        self._next = min(chunk.stop, len(self._points))
        self._splat(self._points[chunk], self._table[self._labels[chunk]], self._camera)
        return self._next < len(self._points)

    def image(self) -> QImage:
        """Return the picture so far."""
        height, width = self._pixels.shape[:2]
        return QImage(self._pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32).copy()

    def close(self) -> None:
        """Nothing to give back."""

    def _splat(self, points: NDArray, colours: NDArray[np.uint8], camera: Camera) -> None:
        height, width = self._pixels.shape[:2]
        pixels, depth = camera.project(points, width, height)
        inside = is_inside(pixels, depth, width, height)
        xy = np.floor(pixels[inside] - (SPLAT_PX - 1) / 2).astype(np.int32)
        far = depth[inside].astype(np.float32)
        order = np.argsort(far)[::-1]  # far first: the nearest is written last
        shaded = np.full((len(order), 4), 255, np.uint8)
        shaded[:, :3] = (colours[inside] * brightness(far, *self._range)[:, None])[order]
        values = shaded.view(np.uint32)[:, 0]
        image = self._pixels.view(np.uint32).reshape(-1)
        xy, far = xy[order], far[order]
        # all pixels of a point before those of the next, or a far point's corner would cover a near one's
        dx, dy = np.tile(np.arange(SPLAT_PX), SPLAT_PX), np.repeat(np.arange(SPLAT_PX), SPLAT_PX)
        column = np.clip(xy[:, 0, None] + dx, 0, width - 1)
        row = np.clip(xy[:, 1, None] + dy, 0, height - 1)
        place = (row * width + column).reshape(-1)
        far, values = np.repeat(far, SPLAT_PX**2), np.repeat(values, SPLAT_PX**2)
        won = far < self._depth[place]
        self._depth[place[won]] = far[won]
        image[place[won]] = values[won]
