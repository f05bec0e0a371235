"""Rotations and homogeneous transforms, eq. 2-1 to 2-4 of the thesis, over batches."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError

Array = NDArray[np.float64]

AXES = {"x": 0, "y": 1, "z": 2}


def rotation(axis: str, angle: float | Array) -> Array:
    """Compute elementary rotations (eq. 2-2 to 2-4).

    Args:
        axis: "x", "y" or "z".
        angle: Angles [rad], shape (...).

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    angle = np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    i = AXES[axis]
    j, k = (i + 1) % 3, (i + 2) % 3
    R = np.zeros((*angle.shape, 3, 3))
    R[..., i, i] = 1.0
    R[..., j, j] = R[..., k, k] = c
    R[..., j, k], R[..., k, j] = -s, s
    return R


def transform(R: Array | None = None, p: Array | None = None) -> Array:
    """Build homogeneous transforms from rotations (..., 3, 3) and translations (..., 3) [m]."""
    shape = np.broadcast_shapes(
        np.shape(R)[:-2] if R is not None else (), np.shape(p)[:-1] if p is not None else ()
    )
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = np.eye(3) if R is None else R
    if p is not None:
        T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse_transform(T: Array) -> Array:
    """Invert rigid transforms, shape (..., 4, 4): T_b_a from T_a_b."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def apply_transform(T_a_b: Array, points: Array) -> Array:
    """Carry points of frame b, shape (n, 3) [m], into frame a with one transform (4, 4)."""
    return points @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def check_transform(T: Array, tolerance: float = 1e-6) -> Array:
    """Return T as float64 (..., 4, 4), or raise if it is not a batch of finite rigid transforms.

    Raises:
        InputError: Wrong shape, not finite, not orthonormal, a mirror, or a bad last row.
    """
    T = np.asarray(T, dtype=float)
    if T.shape[-2:] != (4, 4):
        raise InputError(f"a pose must have shape (..., 4, 4), not {T.shape}")
    if not np.isfinite(T).all():
        raise InputError("a pose must be finite, but it holds NaN or infinity")
    R = T[..., :3, :3]
    defect = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0)
    if defect <= tolerance and not (np.linalg.det(R) > 0).all():
        raise InputError("a pose's upper left 3x3 must be a rotation, but it mirrors: determinant -1, not +1")
    if not defect <= tolerance:
        raise InputError(
            f"a pose's upper left 3x3 must be a rotation (orthonormal to {tolerance:g}, "
            f"determinant +1); the worst entry is off by {defect:.2g}"
        )
    if not np.abs(T[..., 3, :] - [0, 0, 0, 1]).max(initial=0.0) <= tolerance:
        raise InputError("a pose's last row must be 0 0 0 1")
    return T


def wrap_angle(angle: float | Array) -> Array:
    """Wrap angles to (-pi, pi]."""
    return np.pi - (np.pi - np.asarray(angle)) % (2 * np.pi)


def angle_between(a: Array, b: Array) -> Array:
    """Angle between unit vectors (..., 3) [rad], accurate near zero."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def unit(v: Array) -> Array:
    """Scale vectors (..., 3) to length one."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
