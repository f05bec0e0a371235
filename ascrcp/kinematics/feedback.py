"""Collision feedback: what comes too near and who can help it (third paper, sections 2.2 and 3).

Links before the wrist give way by self-motion: their weight is raised (3.1). Wrist and nozzle are tied to
the planned pose: the pose itself is tilted within what the process allows, and the tilt spread over the
neighbouring points in steps (3.2, the lever). The lever turns about the sprayed point of the wall, not
about the gun, so that the concrete still lands where it was planned at the planned stand-off.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array, wrap_angle
from ascrcp.kinematics.barrier import Sight
from ascrcp.kinematics.capsule import Body
from ascrcp.kinematics.obstacle import Obstacles

RAISE = 4.0
"""Factor on the weight of a link that came too near, per round (the paper's added weight, eq. 9)."""

MOST = 4096.0
"""Largest such factor: beyond, the task's own stiffness would give way."""

AGREED = 0.5
"""Length of the mean of tilts over the mean of their lengths from which they lean one way."""

LEAST_LEVER = 0.3
"""A link nearer to the sprayed point's axis than this gains nothing from a tilt [m]."""


def split_collisions(body: Body, sight: Sight, wanted: float, last: int) -> tuple[NDArray[np.bool_], ...]:
    """Part the links that are too near by who can help it (eq. 5).

    Args:
        body: The capsules.
        sight: Their distances.
        wanted: Distance each should keep [m].
        last: Joint whose link the redundant joints still move, from 1.

    Returns:
        Avoidable and unavoidable ones, each shape (n, c).
    """
    short = sight.distance < wanted
    tied = body.shape.joint > last
    return short & ~tied, short & tied


def raise_weights(emphasis: Array, avoidable: NDArray[np.bool_]) -> Array:
    """Raise the weight of links that came too near (eq. 9), shape (n, c)."""
    return np.where(avoidable, np.minimum(emphasis * RAISE, MOST), emphasis)


def find_lever(
    obstacles: Obstacles, sight: Sight, unavoidable: NDArray[np.bool_], pivot: Array, wanted: float
) -> Array:
    """Find the rotation about the pivot that brings the worst tied link out of each point.

    The link at r from the pivot leaves along the escape direction e fastest when turned about r x e.

    Args:
        obstacles: The surroundings, for the escape direction.
        sight: Distances of the links.
        unavoidable: Links to help, shape (n, c).
        pivot: Sprayed points [m], shape (n, 3).
        wanted: Distance to reach [m].

    Returns:
        Rotation vectors in the base frame [rad], zero where none is needed, shape (n, 3).
    """
    lever = np.zeros((len(pivot), 3))
    rows = np.flatnonzero(unavoidable.any(axis=1))
    if not len(rows):
        return lever
    worst = np.where(unavoidable, sight.distance, np.inf)[rows].argmin(axis=1)
    centre = sight.centre[rows, worst]
    axis = np.cross(centre - pivot[rows], obstacles.direction(centre))
    arm = np.linalg.norm(axis, axis=1)
    amount = np.where(arm > LEAST_LEVER, (wanted - sight.distance[rows, worst]) / np.maximum(arm, 1e-9), 0.0)
    lever[rows] = (amount / np.maximum(arm, 1e-9))[:, None] * axis
    return lever


def add_tilt(tilt: Array, more: Array, direction: Array, step: float, limit: float) -> Array:
    """Add rotations to the tilts, in whole steps, without roll about the spray direction.

    Args:
        tilt: Rotation vectors so far [rad], shape (n, 3).
        more: Rotation vectors to add, shape (n, 3).
        direction: Planned spray directions, shape (n, 3).
        step: Step of the tilt [rad].
        limit: Largest tilt [rad].
    """
    total = tilt + more
    total -= (total * direction).sum(axis=1, keepdims=True) * direction
    size = np.linalg.norm(total, axis=1)
    whole = np.minimum(np.ceil(size / step - 1e-6) * step, limit)
    changed = (more != 0.0).any(axis=1)
    scaled = (whole / np.maximum(size, 1e-12))[:, None] * total
    return np.where(changed[:, None], scaled, tilt)


def spread_tilt(tilt: Array, stretch: NDArray[np.int64], step: float) -> Array:
    """Spread tilts over the neighbours, a step less for every point further (third paper 3.2).

    Args:
        tilt: Rotation vectors [rad], shape (n, 3).
        stretch: Number of the stroke each point belongs to; nothing is spread beyond it, shape (n,).
        step: Largest difference of neighbours [rad].

    Returns:
        Rotation vectors [rad], shape (n, 3).
    """
    spread, n = tilt.copy(), len(tilt)
    size, same = np.linalg.norm(tilt, axis=1).tolist(), (np.diff(stretch) == 0).tolist()
    for order, back in ((range(1, n), -1), (range(n - 2, -1, -1), 1)):
        for i in order:
            j = i + back
            if size[j] - step > size[i] and same[min(i, j)]:
                spread[i] = (size[j] - step) / size[j] * spread[j]
                size[i] = size[j] - step
    return spread


def soften_tilt(tilt: Array, stretch: NDArray[np.int64], reach: int) -> Array:
    """Smooth tilts along the path without taking any point's own away.

    A point tilted by itself throws the arm out and back within a second. So every point takes the largest
    tilt within a few points, and then their mean: where all lean one way, that is no less than its own.

    Args:
        tilt: Rotation vectors [rad], shape (n, 3).
        stretch: Number of the stroke each point belongs to, shape (n,).
        reach: Points looked at to either side.

    Returns:
        Rotation vectors [rad], shape (n, 3).
    """
    if not tilt.any():
        return tilt
    n, size = len(tilt), np.linalg.norm(tilt, axis=1)
    widest, most = tilt.copy(), size.copy()
    pairs = [_shifted(n, k, stretch) for k in range(-reach, reach + 1) if k]
    for mine, other in pairs:
        larger = size[other] > most[mine]
        widest[mine[larger]], most[mine[larger]] = tilt[other[larger]], size[other[larger]]
    total, sizes, count = widest.copy(), most.copy(), np.ones(n)
    for mine, other in pairs:
        total[mine] += widest[other]
        sizes[mine] += most[other]
        count[mine] += 1.0
    # leans that differ shorten their mean: it takes their mean size, for as far as they agree
    length = np.linalg.norm(total, axis=1)
    agreed = length > AGREED * sizes
    return np.where(agreed, sizes / np.maximum(length, 1e-12), 1.0)[:, None] * total / count[:, None]


def _shifted(n: int, k: int, stretch: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points of one stroke that lie k apart: each and its partner."""
    mine = np.arange(max(0, -k), min(n, n - k))
    mine = mine[stretch[mine] == stretch[mine + k]]
    return mine, mine + k


def tilt_path(path: SprayPath, tilt: Array, stand_off: float) -> SprayPath:
    """Turn planned poses about the points they spray at.

    Args:
        path: n planned points.
        tilt: Rotation vectors in the base frame [rad], shape (n, 3).
        stand_off: Nozzle to the sprayed point [m].

    Returns:
        The path with position, theta2 and theta3 of the tilted points changed.
    """
    rows = np.flatnonzero(tilt.any(axis=1))
    if not len(rows):
        return path
    planned = path.direction[rows]
    direction = (rotation_matrices(tilt[rows]) @ planned[..., None])[..., 0]
    local = direction @ path.R_base_tunnel
    position, theta2, theta3 = (np.array(a) for a in (path.position, path.theta2, path.theta3))
    position[rows] += stand_off * (planned - direction)
    theta2[rows] = np.arccos(np.clip(local[:, 0], -1.0, 1.0))
    angle = np.arctan2(local[:, 2], local[:, 1])
    theta3[rows] += wrap_angle(angle - theta3[rows])
    return replace(path, position=position, theta2=theta2, theta3=theta3)


def rotation_matrices(vector: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=1)
    axis = vector / np.maximum(angle, 1e-12)[:, None]
    K = np.zeros((len(vector), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = axis[:, 2], -axis[:, 1], axis[:, 0]
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * K + (1.0 - c) * (K @ K))
