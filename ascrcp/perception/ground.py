"""Ground off: find the floor plane below the tunnel so that clusters no longer hang together on it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.perception.parameter import GroundParameters

_CELL = 0.5  # side of the squares whose lowest point speaks for them [m]
_BAND = 0.10  # a square agrees with the plane if its lowest point is this near [m]
_SLOPE_STEP = 0.01  # grid of slopes tried first
_LOWER = 0.65  # of the cloud's height: the floor lies there even if the whole crown is mirrored; placeholder
_SURFACE = 4  # points at one height of a square that make it a surface; placeholder
_AIR = (0.3, 1.3)  # above a floor there is air [m]; placeholder
_OPEN = 0.25  # share of these squares that must be floor with air above; synthetic headings
_MAX_BELOW = 0.2  # share of the squares that may hold something clearly below the floor; placeholder


def find_ground(points: NDArray[np.float32], parameters: GroundParameters) -> Array | None:
    """Find the floor as z = a x + b y + c.

    The lowest point of each square votes for a height under every slope allowed; the best is then
    fitted by least squares. Standing water mirrors the wall, so that points lie below the floor: if the
    lowest do not agree, every height at which a square holds points may vote, below the crown. A tunnel
    seen without its floor gives None, since a vault is not flat.

    Args:
        points: Points in the base frame [m], shape (n, 3).
        parameters: Tilt allowed, share of the squares that must agree.

    Returns:
        (a, b, c), or None if there is no floor in the cloud.
    """
    low, square = _lowest(points)
    plane = _fit(low, square, len(low), parameters)
    if plane is not None and np.mean(low[:, 2] - _height(low, plane) < -2 * _BAND) <= _MAX_BELOW:
        return plane
    bottom, top = float(points[:, 2].min()), float(points[:, 2].max())
    lower = points[points[:, 2] < bottom + _LOWER * (top - bottom)]
    if not len(lower):
        return None
    low, square = _levels(lower)
    squares = len(np.unique(square))
    plane = _fit(low, square, squares, parameters)
    return plane if plane is not None and _is_open(low, square, plane, squares) else None


def _is_open(low: Array, square: NDArray[np.int64], plane: Array, squares: int) -> bool:
    """Whether there is air above a plane: squares of the wall agree on any plane, but go on upward."""
    height = low[:, 2] - _height(low, plane)
    on, above = np.abs(height) < _BAND, (height > _AIR[0]) & (height < _AIR[1])
    free = np.setdiff1d(square[on], square[above])
    return len(free) >= _OPEN * squares


def _fit(low: Array, square: NDArray[np.int64], squares: int, parameters: GroundParameters) -> Array | None:
    """Fit the plane most of the squares agree on; None if too few do.

    Args:
        low: Points that may be floor [m], shape (m, 3).
        square: Square of each, shape (m,).
        squares: How many squares hold points.
        parameters: Tilt allowed, share of the squares that must agree.
    """
    if len(low) < 20:
        return None
    plane = _vote(low, parameters)
    for _ in range(3):
        near = np.abs(low[:, 2] - _height(low, plane)) < _BAND
        if near.sum() < 10:
            return None
        design = np.column_stack([low[near, :2], np.ones(int(near.sum()))])
        plane = np.linalg.lstsq(design, low[near, 2], rcond=None)[0]
    agree = np.abs(low[:, 2] - _height(low, plane)) < _BAND
    tilt = np.degrees(np.arctan(np.hypot(plane[0], plane[1])))
    if not (
        tilt <= parameters.max_tilt_deg and len(np.unique(square[agree])) >= parameters.min_share * squares
    ):
        return None
    return plane


def is_ground(points: NDArray[np.float32], plane: Array | None, clearance: float) -> NDArray[np.bool_]:
    """Mark points on, just above or below the floor, shape (n,)."""
    if plane is None:
        return np.zeros(len(points), dtype=bool)
    return np.asarray(points[:, 2] < _height(points, plane.astype(np.float32)) + np.float32(clearance))


def _height(points: NDArray[Any], plane: NDArray[Any]) -> NDArray[Any]:
    return plane[0] * points[:, 0] + plane[1] * points[:, 1] + plane[2]


def _squares(points: NDArray[np.float32]) -> NDArray[np.int64]:
    """Number the square of the plan each point lies in, shape (n,)."""
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / _CELL).astype(np.int64)
    return np.asarray(cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1])


def _lowest(points: NDArray[np.float32]) -> tuple[Array, NDArray[np.int64]]:
    """Lowest point of every square, shape (m, 3), and its square."""
    key = _squares(points)
    lowest = np.full(int(key.max()) + 1, np.inf, dtype=np.float32)
    np.minimum.at(lowest, key, points[:, 2])
    index = np.flatnonzero(points[:, 2] == lowest[key])
    square, first = np.unique(key[index], return_index=True)
    return points[index[first]].astype(float), square


def _levels(points: NDArray[np.float32]) -> tuple[Array, NDArray[np.int64]]:
    """One point of every height at which a square holds any, shape (m, 3), and its square."""
    key = _squares(points)
    level = np.floor((points[:, 2] - points[:, 2].min()) / _BAND).astype(np.int64)
    _, first, count = np.unique(key * (level.max() + 1) + level, return_index=True, return_counts=True)
    first = first[count >= _SURFACE]  # fewer is dust
    return points[first].astype(float), key[first]


def _vote(low: Array, parameters: GroundParameters) -> Array:
    limit = float(np.tan(np.radians(parameters.max_tilt_deg)))
    slopes = np.arange(-limit, limit + _SLOPE_STEP, _SLOPE_STEP)
    best, plane = -1, np.zeros(3)
    for a in slopes:
        for b in slopes[::2]:
            level = low[:, 2] - a * low[:, 0] - b * low[:, 1]
            bins = np.bincount(np.clip((level - level.min()) / _BAND, 0, 2000).astype(np.int64))
            top = int(bins.argmax())
            if bins[top] > best:
                best, plane = int(bins[top]), np.array([a, b, level.min() + (top + 0.5) * _BAND])
    return plane
