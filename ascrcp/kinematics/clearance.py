"""Clearance of the arm: joint vectors + Obstacles -> signed distance and closest pair."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.capsule import Body, between_segments, droop, make_body
from ascrcp.kinematics.obstacle import Obstacle, Obstacles

BLOCK = 512
"""Joint vectors looked at at once: their samples stay in the cache."""

HALF_DIAGONAL = 0.87
"""Most by which the distance at the nearest node is wrong, over a cell: the field's slope is one."""

ROUGH_SPREAD = 2.0
"""Spacing of the samples of a rough look, over the usual one."""


@dataclass(frozen=True)
class Clearance:
    """Closest pair of each joint vector.

    Attributes:
        distance: Between the surfaces of link and obstacle [m], negative inside, shape (n,).
        link: Index of the capsule in the machine file, shape (n,).
        obstacle: `Obstacle`, shape (n,).
        point_a: On the link's surface, base frame [m], shape (n, 3).
        point_b: On the obstacle, shape (n, 3).
    """

    distance: Array
    link: NDArray[np.int64]
    obstacle: NDArray[np.int64]
    point_a: Array
    point_b: Array

    def describe(self, arm: Arm, i: int) -> str:
        """Say one row in a line: which link, what it would meet, how near, where."""
        x, y, z = self.point_b[i].tolist()
        name = arm.description.capsules[int(self.link[i])].name
        what = Obstacle(int(self.obstacle[i])).name.lower()
        how = (
            f"{self.distance[i]:.2f} m from" if self.distance[i] >= 0.0 else f"{-self.distance[i]:.2f} m into"
        )
        return f"{name} {how} the {what} at ({x:.2f}, {y:.2f}, {z:.2f}) m"


def clearance(arm: Arm, q: ArrayLike, obstacles: Obstacles) -> Clearance:
    """Measure the clearance of joint vectors against heading, carrier and the arm itself.

    Args:
        arm: An arm with capsules.
        q: Joint vectors [rad, m], shape (joints,) or (n, joints).
        obstacles: The surroundings.

    Raises:
        InputError: Wrong shape, NaN, or an arm without capsules.
    """
    parts = [_find_pair(make_body(arm), look, obstacles) for look in _blocks(arm, q, obstacles)]
    return Clearance(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def least_distance(arm: Arm, q: ArrayLike, obstacles: Obstacles) -> Array:
    """Measure the distances of `clearance` alone, at two thirds of its cost; (n,) [m]."""
    return np.concatenate([np.minimum(look.best, look.own.distance) for look in _blocks(arm, q, obstacles)])


def rough_clearance(arm: Arm, q: Array, obstacles: Obstacles) -> Array:
    """Measure quickly and roughly for searches, the arm itself left out; (n, joints) -> (n,) [m]."""
    body = make_body(arm, ROUGH_SPREAD)
    found = np.empty(len(q))
    for i in range(0, len(q), BLOCK):
        placed = body.place(arm, q[i : i + BLOCK])
        near = obstacles.near(placed[:, body.moving]) - body.radius[body.owner[body.moving]]
        found[i : i + BLOCK] = near.min(axis=1, initial=np.inf)
    return found


def link_distances(
    body: Body, placed: Array, obstacles: Obstacles, within: float | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Find every capsule's nearest sample to the surroundings.

    The field is read at the nearest node first, and between nodes only where that can matter.

    Args:
        body: The capsules.
        placed: Their samples, shape (n, m, 3).
        obstacles: The surroundings.
        within: Distance below which every capsule's is exact [m]; None: only the least of each row is.
            The others are wrong by up to a cell's half diagonal.

    Returns:
        Distances from the capsule's surface [m], infinite for those that stay with the carrier, shape
        (n, c), and the samples' indices, shape (n, c).
    """
    moving = body.moving
    radius, points = body.radius[body.owner[moving]], placed[:, moving]
    free = obstacles.near(points) - radius
    slack = HALF_DIAGONAL * obstacles.cell
    limit = (
        free.min(axis=1, keepdims=True, initial=np.inf) + 2.0 * slack if within is None else within + slack
    )
    rows, samples = np.nonzero(free < limit)
    free[rows, samples] = obstacles.distance(points[rows, samples]) - radius[samples]
    distance = np.full(placed.shape[:2], np.inf)
    distance[:, moving] = free
    ends = [*body.first.tolist(), len(body.owner)]
    at = [distance[:, a:b].argmin(axis=1) + a for a, b in pairwise(ends)]
    nearest = np.stack(at, axis=1)
    return np.take_along_axis(distance, nearest, axis=1), nearest


@dataclass(frozen=True)
class _Own:
    """The nearest pair of links: distance, the pair's first link, points on both; each (n, ...)."""

    distance: Array
    link: NDArray[np.int64]
    on_a: Array
    on_b: Array


@dataclass(frozen=True)
class _Look:
    """A block of joint vectors: nearest link and its sample, distance to the surroundings, own pair."""

    best: Array
    link: NDArray[np.int64]
    centre: Array
    own: _Own


def _blocks(arm: Arm, q: ArrayLike, obstacles: Obstacles) -> Iterator[_Look]:
    """Check joint vectors and look at them block by block."""
    q = np.asarray(q, dtype=float)
    if q.ndim not in (1, 2) or q.shape[-1] != arm.n or not np.isfinite(q).all():
        raise InputError(f"joint vectors must be finite with shape (n, {arm.n}), not {q.shape}")
    q = q.reshape(-1, arm.n)
    body = make_body(arm)
    for i in range(0, max(len(q), 1), BLOCK):
        start, end = body.carry(arm, q[i : i + BLOCK])
        placed, rows = body.sample(arm, start, end), np.arange(start.shape[1])
        distance, nearest = link_distances(body, placed, obstacles)
        link = distance.argmin(axis=1)
        own = _self_distance(body, droop(arm, start), droop(arm, end))
        yield _Look(distance[rows, link], link, placed[rows, nearest[rows, link]], own)


def _find_pair(
    body: Body, look: _Look, obstacles: Obstacles
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64], Array, Array]:
    """Fill the fields of `Clearance`, in their order."""
    direction = obstacles.direction(look.centre)
    kind = obstacles.kind_at(look.centre).astype(np.int64)
    radius = body.radius[look.link]
    a = look.centre - radius[:, None] * direction
    b = look.centre - (look.best + radius)[:, None] * direction
    mine = look.own.distance < look.best
    return (
        np.where(mine, look.own.distance, look.best),
        np.where(mine, look.own.link, look.link),
        np.where(mine, int(Obstacle.ARM), kind),
        np.where(mine[:, None], look.own.on_a, a),
        np.where(mine[:, None], look.own.on_b, b),
    )


def _self_distance(body: Body, start: Array, end: Array) -> _Own:
    """Find the nearest pair of links, their segments' ends each (n, c, 3)."""
    n = len(start)
    if not len(body.pairs):
        nowhere = np.zeros((n, 3))
        return _Own(np.full(n, np.inf), np.zeros(n, dtype=np.int64), nowhere, nowhere)
    rows = np.arange(n)
    i, j = body.pairs.T
    on_a, on_b = between_segments(start[:, i], end[:, i], start[:, j], end[:, j])
    gap = on_b - on_a
    length = np.linalg.norm(gap, axis=-1)
    distance = length - body.radius[i] - body.radius[j]
    best = distance.argmin(axis=1)
    unit = gap[rows, best] / np.maximum(length[rows, best], 1e-12)[:, None]
    a = on_a[rows, best] + body.radius[i[best]][:, None] * unit
    b = on_b[rows, best] - body.radius[j[best]][:, None] * unit
    return _Own(distance[rows, best], i[best], a, b)
