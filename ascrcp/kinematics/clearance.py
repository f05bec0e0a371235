"""Clearance of the arm: joint vectors + Obstacles -> signed distance and closest pair."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel
from ascrcp.kinematics.obstacle import Obstacle, Obstacles

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
    body, q = make_body(arm), _check(arm, q)
    distance, centre, own, pair, on = kernel("clearance").find_links(obstacles.around(body), q, -1.0)
    rows, link = np.arange(len(q)), distance.argmin(axis=1)
    best, at, radius = distance[rows, link], centre[rows, link], body.shape.radius
    out, kind = obstacles.direction(at), obstacles.kind_at(at).astype(np.int64)
    a, b = at - radius[link][:, None] * out, at - (best + radius[link])[:, None] * out
    mine = own < best
    if mine.any():
        first, second = body.shape.pairs[pair[mine]].T
        gap = on[mine, 1] - on[mine, 0]
        unit = gap / np.maximum(np.linalg.norm(gap, axis=1), 1e-12)[:, None]
        a[mine] = on[mine, 0] + radius[first][:, None] * unit
        b[mine] = on[mine, 1] - radius[second][:, None] * unit
        best[mine], link[mine], kind[mine] = own[mine], first, int(Obstacle.ARM)
    return Clearance(best, link, kind, a, b)


def least_distance(arm: Arm, q: ArrayLike, obstacles: Obstacles) -> Array:
    """Measure the distances of `clearance` alone; (n,) [m]."""
    scene, find = obstacles.around(make_body(arm)), kernel("clearance").find_least
    found: Array = by_halves(lambda rows: find(scene, rows), _check(arm, q))
    return found


def rough_clearance(arm: Arm, q: Array, obstacles: Obstacles) -> Array:
    """Measure quickly and roughly for searches, the arm itself left out; (n, joints) -> (n,) [m].

    Half as many samples, and of each the nearest node: wrong by up to a cell's half diagonal.
    """
    scene, find = obstacles.around(make_body(arm, ROUGH_SPREAD)), kernel("clearance").find_rough
    found: Array = by_halves(lambda rows: find(scene, rows), as_rows(q))
    return found


def _check(arm: Arm, q: ArrayLike) -> Array:
    """Return joint vectors as rows (n, joints), or refuse them."""
    q = np.asarray(q, dtype=float)
    if q.ndim not in (1, 2) or q.shape[-1] != arm.n or not np.isfinite(q).all():
        raise InputError(f"joint vectors must be finite with shape (n, {arm.n}), not {q.shape}")
    return as_rows(q)
