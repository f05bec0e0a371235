"""How far apart the points of a path are, and which of them are key points of the layered graph."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.geometry import Array

NEAREST = 0.05
"""Distances between points count as at least this [m]: table rows may coincide."""

STAND_OFF = 1.0
"""Nozzle to wall [m] (design.md section 1): carries a turn of the nozzle to the wall."""


def distances(T: Array, far: float) -> Array:
    """Distance from the pose before, infinite at the first and where the nozzle jumps farther than far.

    The nozzle's way or that of the point sprayed at, whichever is longer: in a pocket the nozzle turns
    almost on the spot.

    Args:
        T: Poses, shape (n, 4, 4).
        far: Largest way of the nozzle that is sprayed through [m].

    Returns:
        Distances [m], shape (n,).
    """
    nozzle = T[:, :3, 3]
    wall = nozzle + STAND_OFF * T[:, :3, 0]
    way, sprayed = (np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (nozzle, wall))
    return np.concatenate([[np.inf], np.where(way <= far, np.maximum(way, sprayed), np.inf)])


def find_keys(distance: Array, spacing: float) -> NDArray[np.int64]:
    """Pick key points: the ends of every uncut stretch and one per spacing between; rising (k,)."""
    n = len(distance)
    keys, since = [0], 0.0
    for i in range(1, n):
        cut = not np.isfinite(distance[i])
        since += 0.0 if cut else float(distance[i])
        next_cut = i == n - 1 or not np.isfinite(distance[i + 1])
        if cut or next_cut or since >= spacing:
            keys.append(i)
            since = 0.0
    return np.array(keys, dtype=np.int64)


def sum_stretches(marked: NDArray[np.bool_], value: ArrayLike, gaps: Array) -> Array:
    """Sum a value over the stretch that each point stands in: all marked or all not, of one stroke.

    Args:
        marked: Shape (n,).
        value: Shape (n,).
        gaps: Distance from the point before [m], infinite where a stroke begins, shape (n,).

    Returns:
        The sum over its stretch at every point, shape (n,).
    """
    stretch = np.cumsum(np.diff(marked, prepend=False) | ~np.isfinite(gaps))
    return np.asarray(np.bincount(stretch, value)[stretch])
