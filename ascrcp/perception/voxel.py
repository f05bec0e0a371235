"""Voxel filter: even density from a cloud that is dense near the lidar (thesis 3.3.1)."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.perception.parameter import VoxelParameters

_BITS = 22  # table of 4 M slots: a few collisions keep a point too many, never one too few
_GROWTH = 1.25


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
        size *= _GROWTH
        kept = kept[first_of_each(kept, size)]
    return kept


def first_of_each(points: NDArray[np.float32], size: float) -> NDArray[np.bool_]:
    """Mark one point of every occupied voxel in O(n): a hash table, no sorting.

    Args:
        points: Points [m], shape (n, 3).
        size: Edge of the voxels [m].

    Returns:
        Whether each point stands for its voxel, shape (n,).
    """
    if not len(points):
        return np.zeros(0, dtype=bool)
    low = points.min(axis=0)
    cell = ((points - low) * np.float32(1.0 / size)).astype(np.int32)
    span = cell.max(axis=0).astype(np.int64) + 1
    key = (cell[:, 0].astype(np.int64) * span[1] + cell[:, 1]) * span[2] + cell[:, 2]
    # Fibonacci hashing: the upper bits of a product with 2^64 / golden ratio
    slot = ((key.view(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(64 - _BITS)).astype(np.int32)
    number = np.arange(len(points), dtype=np.int32)
    table = np.empty(1 << _BITS, dtype=np.int32)
    table[slot[::-1]] = number[::-1]
    owner = table[slot]
    return np.asarray((owner == number) | (key[owner] != key))
