"""Take poses apart for the closed forms: (N, 4, 4) -> twelve components, checked and rigid to rounding."""

import numpy as np

from ascrcp.core.geometry import Array, check_transform

RIGID = 1e-13
"""How far from a rotation rounding leaves a product of rotations; beyond it the nearest one is taken."""


def split_poses(T: Array) -> Array:
    """Check poses and lay out their components one after the other, [row, column, pose].

    A pose read from text is a rotation to a few digits only. The closed forms answer for the nearest
    one, so that their solutions can be held to rounding.

    Args:
        T: Poses, shape (N, 4, 4).

    Returns:
        First three rows, each component contiguous, shape (3, 4, N).

    Raises:
        InputError: A pose that is not finite or not rigid.
    """
    parts = np.ascontiguousarray(T.reshape(-1, 16).T).reshape(4, 4, -1)
    if not _defect(parts) <= RIGID:
        check_transform(T)
        parts[:3, :3] = _nearest_rotation(T[:, :3, :3]).transpose(1, 2, 0)
    return parts[:3]


def _defect(parts: Array) -> float:
    """Largest miss of x.x = y.y = 1, x.y = 0, z = x cross y and the last row (4, 4, N).

    NaN where anything is not finite.
    """
    x, y, z = (parts[:3, j] for j in range(3))
    worst = np.abs(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] - 1.0)
    misses = [
        y[0] * y[0] + y[1] * y[1] + y[2] * y[2] - 1.0,
        x[0] * y[0] + x[1] * y[1] + x[2] * y[2],
        *(x[i - 2] * y[i - 1] - x[i - 1] * y[i - 2] - z[i] for i in range(3)),
        *(parts[3, j] for j in range(3)),
        parts[3, 3] - 1.0,
    ]
    for miss in misses:
        np.maximum(worst, np.abs(miss, out=miss), out=worst)
    return float(worst.max(initial=0.0)) if np.isfinite(parts[:3, 3]).all() else float("nan")


def _nearest_rotation(R: Array) -> Array:
    """Orthonormalise near-rotations (N, 3, 3) by two Newton steps of the polar decomposition."""
    for _ in range(2):
        R = 0.5 * R @ (3.0 * np.eye(3) - np.swapaxes(R, 1, 2) @ R)
    return R
