"""Vehicles, people and muck in a scan: what stands in the heading and is neither dust nor the arm itself."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation, label
from scipy.spatial import cKDTree

from ascrcp.core.flow import Label, Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.room import Room

INSIDE = 0.3
"""Points this far inside the wall that are neither floor nor face belong to a body [m]."""

CELL = 0.2
"""Side of the cells that are joined into bodies [m]."""

DENSITY = 4
"""Cells with fewer points than this hold dust: what it returns is thin and spread through the air."""

POINTS = 30
"""Fewer points than this in one piece are no body."""

WIDTH = 0.25
"""A body is wider than this in the level [m]; falling water is not. That of even points with the same
variance: a few of the dust beside a falling stream do not make it wide."""

OWN_MARGIN = 0.35
"""Points this near the arm where it scanned are the arm's own [m]: hoses and cables are not modelled."""

THIN = 0.06
"""Points are thinned to one in a cube of this side [m] before their neighbours are looked at: nearer ones
would show the lidar's noise and no surface."""

NEIGHBOURS = 12
"""Of a point that tell whether it lies on a surface."""

FLAT = 0.3
"""Least over largest deviation of a point's neighbours, below which they lie on a surface: there 0.05 to
0.2, in the dust round a lidar 0.3 to 0.6 (synthetic headings of 0.3 to 3 million points)."""

SURE = 0.5
"""Share of a piece's points in cells that show a surface: of bodies more than 0.8, of dust less than 0.5
(the same headings); placeholder."""

NOISE = 1.5
"""Where the wall itself shows more than that over this (median), so much more is allowed: a noisy lidar."""

WALL_M = 0.5
"""Of the wall either side of the edge of the sprayed part are looked at for that [m]."""

WALL_EVERY = 10
"""One in so many of its points, thinned, is asked."""


def find_bodies(surface: Surface, room: Room, arm: Arm, scan_q: ArrayLike) -> Array:
    """Find points of bodies: well inside the wall, on surfaces, in one piece, not the arm's own.

    Args:
        surface: Recognised heading.
        room: Tells how far inside the wall a point is.
        arm: The arm that carried the lidar.
        scan_q: Its joints then.

    Returns:
        Tunnel frame [m], shape (n, 3).
    """
    T = inverse_transform(surface.axis.T_base_tunnel)
    points = surface.points[surface.labels == Label.OTHER].astype(float)
    local = apply_transform(T, points)
    keep = room.inside(local) > INSIDE
    keep[keep] = ~_is_own(points[keep], arm, np.asarray(scan_q, dtype=float))
    local = local[keep]
    if not len(local):
        return local
    wall = surface.points[np.isin(surface.labels, (Label.SPRAYED, Label.BAY, Label.OVERBREAK))].astype(float)
    wall = apply_transform(T, wall)
    edge = wall[np.abs(wall[:, 0] - surface.unsprayed[0]) < WALL_M]
    cells, index = _cells(local, local.min(axis=0), CELL)
    dense = np.bincount(index, minlength=int(np.prod(cells))).reshape(cells) >= DENSITY
    solid = _has_surface(local, edge, cells)
    dense &= binary_dilation(solid, np.ones((3, 3, 3)))  # edges and corners too
    piece = label(dense, np.ones((3, 3, 3)))[0].reshape(-1)[index]
    size = np.bincount(piece)
    share = 1.0 / np.maximum(size, 1)
    size[0] = 0
    spread = [np.bincount(piece, (x - (share * np.bincount(piece, x))[piece]) ** 2) for x in local[:, :2].T]
    width = np.sqrt(12.0 * share * np.maximum(*spread))
    sure = share * np.bincount(piece, solid.reshape(-1)[index]) > SURE
    return np.asarray(local[((size >= POINTS) & (width > WIDTH) & sure)[piece]])


def _cells(points: Array, low: Array, side: float) -> tuple[tuple[int, ...], NDArray[np.int64]]:
    """Sort points (n, 3) into cubes: how many there are along each axis, and the cube of each, (n,)."""
    cell = np.floor((points - low) / side).astype(np.int64)
    shape = tuple((cell.max(axis=0) + 1).tolist())
    return shape, np.ravel_multi_index(tuple(cell.T), shape)


def _has_surface(points: Array, wall: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mark the cells of points (n, 3) most of whose points lie on a surface, at least as flat as the wall.

    What dust returns fills the air before the lidar, densely where it is near; thinned, it is as deep as
    it is wide.
    """
    thin = _thin(points)
    limit = max(FLAT, NOISE * float(np.median(_depth(_thin(wall), WALL_EVERY))) if len(wall) else 0.0)
    index = np.ravel_multi_index(tuple(np.floor((thin - points.min(axis=0)) / CELL).astype(int).T), shape)
    size = int(np.prod(shape))
    flat = np.bincount(index, _depth(thin) < limit, minlength=size)
    most = flat > 0.5 * np.bincount(index, minlength=size)
    return np.asarray(most & (flat >= DENSITY)).reshape(shape)


def _thin(points: Array) -> Array:
    _, index = _cells(points, points.min(axis=0), THIN)
    return np.asarray(points[np.unique(index, return_index=True)[1]])


def _depth(points: Array, every: int = 1) -> Array:
    """Least over largest deviation of the nearest neighbours of points (n, 3), of one in so many; (m,)."""
    count = min(NEIGHBOURS, len(points))
    _, near = cKDTree(points).query(points[::every], k=[*range(1, count + 1)], workers=2)
    off = points[near] - points[near].mean(axis=1, keepdims=True)
    variance = np.linalg.eigvalsh(np.swapaxes(off, 1, 2) @ off)
    return np.sqrt(np.maximum(variance[:, 0], 0.0) / np.maximum(variance[:, 2], 1e-12))


def _is_own(points: Array, arm: Arm, q: Array) -> NDArray[np.bool_]:
    """Mark base-frame points (n, 3) that lie on the arm itself at joints q."""
    start, end = (ends[0] for ends in make_body(arm).segments(q[None]))
    own = np.zeros(len(points), dtype=bool)
    for a, b, capsule in zip(start, end, arm.description.capsules, strict=True):
        along = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
        off = points - (a + along[:, None] * (b - a))
        own |= np.linalg.norm(off, axis=1) < capsule.radius + OWN_MARGIN
    return own
