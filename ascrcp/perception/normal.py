"""Surface normals and the first estimate of the axis direction from them (thesis eq. 3-4, 3-6)."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import RecognitionError
from ascrcp.core.geometry import Array

_CELL = 0.4  # side of the cubes whose points make one normal [m]; rock is rough below this
_MIN_POINTS = 10
_WIDTH = 0.15  # cosine to the axis beyond which a normal (face, vehicle) hardly counts


def estimate_normals(points: NDArray[np.float32]) -> tuple[Array, Array]:
    """Compute one normal per occupied cube: the smallest eigenvector of its covariance (eq. 3-4).

    Args:
        points: Points [m], shape (n, 3).

    Returns:
        Unit normals, sign arbitrary, shape (m, 3), and their flatness 0..1, shape (m,).
    """
    low = points.min(axis=0)
    cell = ((points - low) / np.float32(_CELL)).astype(np.int64)
    span = cell.max(axis=0) + 1
    key = (cell[:, 0] * span[1] + cell[:, 1]) * span[2] + cell[:, 2]
    size = int(span.prod())
    # about the cube's own middle, so that squares do not cancel
    local = points.astype(float) - low - (cell + 0.5) * _CELL
    count = np.bincount(key, minlength=size)
    full = np.flatnonzero(count >= _MIN_POINTS)
    n = count[full].astype(float)
    mean = np.stack([np.bincount(key, local[:, i], size)[full] / n for i in range(3)], -1)
    covariance = np.empty((len(full), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            square = np.bincount(key, local[:, i] * local[:, j], size)[full] / n
            covariance[:, i, j] = covariance[:, j, i] = square - mean[:, i] * mean[:, j]
    values, vectors = np.linalg.eigh(covariance)
    flatness = 1.0 - np.sqrt(np.maximum(values[:, 0], 0.0) / np.maximum(values[:, 1], 1e-12))
    return vectors[:, :, 0], np.maximum(flatness, 0.0)


def direction_from_normals(normals: Array, flatness: Array, max_yaw_deg: float) -> Array:
    """Find the direction square to the most normals (plane through the unit vectors, eq. 3-6).

    Reweighted, because the face and vehicles send normals along the axis.

    Args:
        normals: Unit normals, shape (m, 3).
        flatness: Their weights, shape (m,).
        max_yaw_deg: Largest angle to base X [deg] that is believed.

    Returns:
        Unit direction with positive x, shape (3,).

    Raises:
        RecognitionError: If too few normals agree, or the direction is not roughly base X.
    """
    if len(normals) < 50:
        raise RecognitionError("no tunnel found: the cloud is too sparse to see surfaces in it")
    d = np.array([1.0, 0.0, 0.0])
    width = 4.0 * _WIDTH
    for _ in range(12):
        along = normals @ d
        weight = flatness / (1.0 + (along / width) ** 2) ** 2
        _, vectors = np.linalg.eigh((normals * weight[:, None]).T @ normals)
        d = vectors[:, 0] * np.sign(vectors[0, 0])
        width = max(_WIDTH, width * 0.7)
    angle = np.degrees(np.arccos(min(1.0, abs(float(d[0])))))
    if not angle <= max_yaw_deg:
        raise RecognitionError(
            f"no tunnel found: the surfaces run {angle:.0f} deg off base X, allowed {max_yaw_deg:.0f} deg"
        )
    return d
