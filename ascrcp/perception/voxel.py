"""Voxel filter: even density from a cloud that is dense near the lidar (thesis 3.3.1)."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.perception.parameter import VoxelParameters

_BITS = 22  # table of 4 M slots: a few collisions keep a point too many, never one too few
_LEAST_GROWTH = 1.05
_THREADS = 2  # NumPy lets go of Python's lock in every step below
_ALONE = 200_000  # fewer points are not worth a second thread

_Key = NDArray[np.unsignedinteger[Any]]


def voxel(points: NDArray[np.float32], parameters: VoxelParameters) -> NDArray[np.float32]:
    """Keep one measured point per voxel, growing the voxels until few enough are left.

    A measured point is kept rather than the voxel's mean, which would round off the edges of arches.

    Args:
        points: Points [m], shape (n, 3).
        parameters: Edge of the voxels [m] and the largest number of points.

    Returns:
        The points kept, in their order, shape (m, 3).
    """
    size = parameters.size
    kept = points[first_of_each(points, size)]
    while len(kept) > parameters.max_points:
        # the points lie on surfaces: their number falls with the square of the edge
        size *= max(_LEAST_GROWTH, float(np.sqrt(1.05 * len(kept) / parameters.max_points)))
        kept = kept[first_of_each(kept, size)]
    return kept


def first_of_each(points: NDArray[np.float32], size: float) -> NDArray[np.int64]:
    """Choose one point of every occupied voxel in O(n): a hash table, no sorting.

    Two threads thin one half each, then what both kept is thinned once more; which points are kept
    depends on nothing but the points.

    Args:
        points: Points [m], shape (n, 3).
        size: Edge of the voxels [m].

    Returns:
        Rising indices of the points that stand for their voxels, shape (m,).
    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    low = [float(column.min()) for column in points.T]
    # odd spans spread neighbouring layers over the table
    span = [int((float(c.max()) - lo) / size) + 2 | 1 for c, lo in zip(points.T, low, strict=True)]
    wide = span[0] * span[1] * span[2] >= 1 << 32

    def thin(begin: int, end: int) -> tuple[NDArray[np.int64], _Key]:
        key = _keys(points[begin:end], size, low, span, np.uint64 if wide else np.uint32)
        fresh = np.ones(len(key), dtype=bool)
        np.not_equal(key[1:], key[:-1], out=fresh[1:])  # along a scan line neighbours share a voxel
        index = np.flatnonzero(fresh)
        key = key[index]
        first = _first(key)
        return index[first] + begin, key[first]

    if len(points) < _ALONE:
        return thin(0, len(points))[0]
    edge = [len(points) * i // _THREADS for i in range(_THREADS + 1)]
    with ThreadPoolExecutor(_THREADS) as pool:
        parts = list(pool.map(thin, edge[:-1], edge[1:]))
    index, key = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return np.asarray(index[_first(key)])


def _keys(
    points: NDArray[np.float32], size: float, low: list[float], span: list[int], kind: type[Any]
) -> _Key:
    """Number each point's voxel, shape (n,)."""
    scale = np.float32(1.0 / size)
    key = np.zeros(len(points), dtype=kind)
    for column, start, count in zip(points.T, low, span, strict=True):
        key *= kind(count)
        key += ((column - np.float32(start)) * scale).astype(np.int32).astype(kind)
    return key


def _first(key: _Key) -> NDArray[np.bool_]:
    """Mark the first point of each key, shape (n,)."""
    # the low bits keep neighbours in the cloud neighbours in the table, which the cache likes
    slot = (key & key.dtype.type((1 << _BITS) - 1)).astype(np.int32)
    number = np.arange(len(key), dtype=np.int32)
    table = np.empty(1 << _BITS, dtype=np.int32)
    table[slot[::-1]] = number[::-1]
    owner = table.take(slot)
    return np.asarray((owner == number) | (key.take(owner) != key))
