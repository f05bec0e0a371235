"""Euclidean clusters: the largest is the tunnel; people, vehicles and dust fall off (thesis 3.3.2)."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ascrcp.core.errors import RecognitionError
from ascrcp.perception.parameter import ClusterParameters

_MAX_CELLS = 30_000_000  # the grid grows coarser before it takes more memory than this


def cluster(points: NDArray[np.float32], parameters: ClusterParameters) -> NDArray[np.int32]:
    """Label points that hang together, by labelling an occupancy grid instead of the points: O(n).

    Two points nearer than half of `reach` always belong together, two farther apart than `reach`
    times 1.7 never do unless points lie between them.

    Args:
        points: Points [m], shape (n, 3).
        parameters: Reach and smallest tunnel.

    Returns:
        Cluster of each point, 0 for the largest, then by falling size, shape (n,).

    Raises:
        RecognitionError: If the largest cluster is too small to be a tunnel.
    """
    if len(points) < parameters.min_points:
        raise RecognitionError(
            f"no tunnel found: only {len(points)} points lie near the machine above the floor, "
            f"at least {parameters.min_points} are needed"
        )
    low = points.min(axis=0)
    size = parameters.reach / 2.0
    extent = points.max(axis=0) - low
    while np.prod(np.floor(extent / size) + 1) > _MAX_CELLS:
        size *= 1.2
    cell = ((points - low) / np.float32(size)).astype(np.int32)
    grid = np.zeros(cell.max(axis=0) + 1, dtype=bool)
    grid[cell[:, 0], cell[:, 1], cell[:, 2]] = True
    labels, count = label(grid, structure=np.ones((3, 3, 3), dtype=bool))
    owner = labels[cell[:, 0], cell[:, 1], cell[:, 2]]
    sizes = np.bincount(owner, minlength=count + 1)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(len(sizes), dtype=np.int32)
    rank[order] = np.arange(len(sizes), dtype=np.int32)
    if sizes[order[0]] < parameters.min_points:
        raise RecognitionError(
            f"no tunnel found: the largest connected part has {sizes[order[0]]} points, "
            f"at least {parameters.min_points} are needed"
        )
    return rank[owner]
