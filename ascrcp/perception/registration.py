"""Register a second scan onto the first: two clouds of one wall -> transform with its quality.

Point to plane, reweighted: what changed between the scans (sprayed wall, people, the machine itself)
lies far off its plane and loses its weight.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ascrcp.core.errors import RecognitionError
from ascrcp.core.geometry import Array, check_transform, rotation
from ascrcp.perception.survey import RegistrationParameters

_NEIGHBOURS = 12  # for a normal
_NARROWING = 0.6  # of the pairing distance in each step
_TUKEY = 4.0
_FLOOR = 0.002  # residuals are not believed to be finer than this [m]
_CONVERGED = 2e-5  # a smaller move ends the iteration [m, rad]
_SAME = 0.10  # a point lies on the first scan if it is nearer than this [m]


@dataclass(frozen=True)
class Registration:
    """Where the second scan lies in the frame of the first.

    Attributes:
        T_first_second: Carries points of the second scan into the frame of the first, shape (4, 4).
        residual: Median distance of the points that did not change from the first scan's planes [m].
        share: Share of the second scan's points that lie on the first scan.
        position_sigma: Largest standard deviation of the position, at the points' middle [m].
        rotation_sigma: Largest standard deviation of the rotation [rad].
        converged: Whether the last step was small.
    """

    T_first_second: Array
    residual: float
    share: float
    position_sigma: float
    rotation_sigma: float
    converged: bool


def register(
    first: NDArray[np.float32],
    second: NDArray[np.float32],
    parameters: RegistrationParameters,
    start: Array | None = None,
) -> Registration:
    """Find the rigid motion that lays the second scan onto the first.

    Args:
        first: Points of the first scan [m], shape (n, 3).
        second: Points of the second, shape (m, 3); best the parts nobody worked on.
        parameters: Cubes, pairing distance, limits.
        start: First guess of T_first_second, shape (4, 4); identity by default.

    Returns:
        The transform with its quality.

    Raises:
        RecognitionError: The scans do not show the same wall, or leave a direction open.
    """
    T = np.eye(4) if start is None else check_transform(start).copy()
    anchor = mean_points(first, parameters.voxel)
    moving = mean_points(second, parameters.voxel)
    if min(len(anchor), len(moving)) < 500:
        raise RecognitionError("registration: too few points in one of the scans")
    normal, flat = _normals(anchor)
    anchor, normal = anchor[flat], normal[flat]
    if len(moving) > parameters.points:
        moving = moving[:: int(np.ceil(len(moving) / parameters.points))]
    middle = moving.mean(axis=0)
    tree = cKDTree(anchor)
    reach, converged = parameters.reach, False
    spread = np.full(6, np.inf)
    for _ in range(parameters.iterations):
        at = moving @ T[:3, :3].T + T[:3, 3]
        _, owner = tree.query(at, distance_upper_bound=max(reach, _SAME))
        paired = owner < len(anchor)
        if paired.sum() < 500:
            break
        n = normal[owner[paired]]
        off = np.sum((at[paired] - anchor[owner[paired]]) * n, axis=1)
        scale = max(_FLOOR, 1.4826 * float(np.median(np.abs(off))))
        weight = np.maximum(0.0, 1.0 - (off / (_TUKEY * scale)) ** 2) ** 2
        lever = at[paired] - (middle @ T[:3, :3].T + T[:3, 3])
        design = np.hstack([n, np.cross(lever, n)])
        information = (design * weight[:, None]).T @ design
        if not np.linalg.cond(information) < 1e8:
            raise RecognitionError(
                "registration: what both scans show leaves a direction open (a smooth tube slides along "
                "itself); the face or the arches must be in both"
            )
        move = -np.linalg.solve(information, design.T @ (weight * off))
        inverse = np.linalg.inv(information)
        spread = np.sqrt(np.diag(inverse) * np.sum(weight * off**2) / max(1.0, weight.sum()))
        T = _moved(T, move, middle @ T[:3, :3].T + T[:3, 3])
        converged = float(np.abs(move).max()) < _CONVERGED and reach <= _SAME
        if converged:
            break
        reach = max(_SAME, reach * _NARROWING)
    residual, share = _quality(tree, anchor, normal, moving @ T[:3, :3].T + T[:3, 3])
    found = Registration(
        T, residual, share, float(spread[:3].max()), float(spread[3:].max()), bool(converged)
    )
    _check(found, parameters)
    return found


def _check(found: Registration, parameters: RegistrationParameters) -> None:
    if not found.share >= parameters.min_share:
        raise RecognitionError(
            f"registration: only {100 * found.share:.0f} % of the second scan lies on the first, "
            f"needed {100 * parameters.min_share:.0f} %; are they of one wall?"
        )
    if not found.residual <= parameters.max_residual:
        raise RecognitionError(
            f"registration: the scans agree to {1000 * found.residual:.0f} mm only, "
            f"allowed {1000 * parameters.max_residual:.0f} mm"
        )


def mean_points(points: NDArray[np.float32], size: float) -> Array:
    """Average the points of every occupied cube, which averages the ranging noise, shape (k, 3)."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.zeros((0, 3))
    low = points.min(axis=0)
    cell = ((points - low) / np.float32(size)).astype(np.int64)
    span = cell.max(axis=0) + 1
    key = (cell[:, 0] * span[1] + cell[:, 1]) * span[2] + cell[:, 2]
    _, owner = np.unique(key, return_inverse=True)
    count = np.bincount(owner)
    local = points - low
    return np.stack([np.bincount(owner, local[:, k]) / count for k in range(3)], axis=-1) + low


def _normals(points: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Unit normals from the nearest neighbours, shape (n, 3), and where these lie on a plane, (n,)."""
    _, near = cKDTree(points).query(points, k=_NEIGHBOURS)
    local = points[near] - points[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.swapaxes(local, 1, 2) @ local)
    return vectors[:, :, 0], np.asarray(values[:, 0] < 0.1 * values[:, 1])


def _moved(T: Array, move: Array, middle: Array) -> Array:
    """Apply a small move (translation, rotation vector) about a point."""
    R = rotation("z", float(move[5])) @ rotation("y", float(move[4])) @ rotation("x", float(move[3]))
    out = np.eye(4)
    out[:3, :3] = R @ T[:3, :3]
    out[:3, 3] = R @ (T[:3, 3] - middle) + middle + move[:3]
    u, _, v = np.linalg.svd(out[:3, :3])  # rounding must not add up
    out[:3, :3] = u @ v
    return out


def _quality(tree: cKDTree, anchor: Array, normal: Array, at: Array) -> tuple[float, float]:
    distance, owner = tree.query(at, distance_upper_bound=_SAME)
    on = np.isfinite(distance)
    if not on.any():
        return np.inf, 0.0
    off = np.abs(np.sum((at[on] - anchor[owner[on]]) * normal[owner[on]], axis=1))
    still = off < _TUKEY * max(_FLOOR, 1.4826 * float(np.median(off)))
    return float(np.median(off[still])), float(on.mean())
