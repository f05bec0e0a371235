"""Machine code of the nearest point: points on some nodes of a grid -> distance of every node to the nearest.

An exact transform in two steps, each line of nodes by itself (Felzenszwalb and Huttenlocher, Theory of
Computing 2012): the lower envelope of the parabolas that stand on a line's nodes. Callers use `obstacle.py`.
"""

import math

import numpy as np
from numba import float32, float64, int32, int64
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_compiler import array_of, part, whole

Points = NDArray[np.int32]

FREE = -1
"""Stands for no point."""


@part
def _find_envelope(square: Array, hull: NDArray[np.int64], begin: Array) -> int:
    """Find which parabolas are the lowest somewhere along a line.

    Args:
        square: Squared distance at each node of the line, infinite where no point is known, shape (n,).
        hull: Takes the nodes on which these parabolas stand, rising, shape (n,).
        begin: Takes where each begins to be the lowest, shape (n,).

    Returns:
        How many there are.
    """
    count = 0
    for node in range(len(square)):
        if square[node] == np.inf:
            continue
        at = -np.inf
        while count:
            last = hull[count - 1]
            at = (square[node] - square[last] + node * node - last * last) / (2.0 * (node - last))
            if at > begin[count - 1]:
                break
            count -= 1
        hull[count], begin[count] = node, at if count else -np.inf
        count += 1
    return count


@part
def _scan_row(owner: Points, square: Array, nearest: Points) -> None:
    """Find for every node of a row (n,) the nearest node of the row that has a point."""
    for is_back in range(2):
        last = FREE
        for i in range(len(owner)):
            node = len(owner) - 1 - i if is_back else i
            if owner[node] != FREE:
                last = node
            if not is_back:
                square[node], nearest[node] = np.inf, FREE
            if last != FREE and (node - last) ** 2 < square[node]:
                square[node], nearest[node] = (node - last) ** 2, owner[last]


@whole(array_of(int32, 3))
def spread_across(owner: Points) -> tuple[NDArray[np.float32], Points]:
    """Spread points over the second and third axis of a grid.

    Args:
        owner: The point that stands on each node, `FREE` for none, shape (ns, ny, nz).

    Returns:
        Squared distance in cells, infinite where a plane across the first axis has no point, and the
        nearest point, each (ns, ny, nz).
    """
    ns, ny, nz = owner.shape
    found, who = np.empty(owner.shape, np.float32), np.empty(owner.shape, np.int32)
    square, nearest = np.empty((ny, nz)), np.empty((ny, nz), np.int32)
    line, hull, begin = np.empty(ny), np.empty(ny, np.int64), np.empty(ny)
    for i in range(ns):
        for j in range(ny):
            _scan_row(owner[i, j], square[j], nearest[j])
        for k in range(nz):
            for j in range(ny):
                line[j] = square[j, k]
            count, at = _find_envelope(line, hull, begin), 0
            for j in range(ny):
                while at + 1 < count and begin[at + 1] < j:
                    at += 1
                found[i, j, k], who[i, j, k] = np.inf, FREE
                if count:
                    found[i, j, k] = (j - hull[at]) ** 2 + line[hull[at]]
                    who[i, j, k] = nearest[hull[at], k]
    return found, who


@whole(
    array_of(int64, 1),
    array_of(float32, 3),
    array_of(int32, 3),
    array_of(float64, 2),
    array_of(float64, 1),
    float64,
    array_of(float32, 3, is_written=True),
)
def spread_along(
    planes: NDArray[np.int64],
    across: NDArray[np.float32],
    who: Points,
    points: Array,
    low: Array,
    cell: float,
    field: NDArray[np.float32],
) -> Points:
    """Spread points over the first axis as well and measure the distance to the nearest.

    Args:
        planes: Where on the second axis, shape (m,).
        across, who: What `spread_across` found, shape (ns, ny, nz).
        points: The points [m], shape (n, 3).
        low: First node [m], shape (3,).
        cell: Spacing of the nodes [m].
        field: Takes the distances of these planes' nodes [m], shape (ns, ny, nz).

    Returns:
        The nearest point of each node of the planes, shape (m, ns, nz).
    """
    ns, nz = across.shape[0], across.shape[2]
    found = np.empty((len(planes), ns, nz), np.int32)
    line, hull, begin = np.empty(ns), np.empty(ns, np.int64), np.empty(ns)
    for m in range(len(planes)):
        j = planes[m]
        for k in range(nz):
            for i in range(ns):
                line[i] = across[i, j, k]
            count, at = _find_envelope(line, hull, begin), 0
            for i in range(ns):
                while at + 1 < count and begin[at + 1] < i:
                    at += 1
                point = who[hull[at], j, k]
                x, y, z = low[0] + cell * i, low[1] + cell * j, low[2] + cell * k
                square = (points[point, 0] - x) ** 2 + (points[point, 1] - y) ** 2
                field[i, j, k] = math.sqrt(square + (points[point, 2] - z) ** 2)
                found[m, i, k] = point
    return found
