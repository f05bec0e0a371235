"""Search the solutions of poses numerically, knowing the forward model only: poses -> joint vectors.

The slow and plain peer that a closed form is held against: damped Newton from many starts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.proof import free_joints, held_values, joint_distance, slide_span, turn_between

SAME = 1e-6
"""Joint vectors closer than this [rad, m] are one solution."""

ARRIVED = 1e-11
"""Miss of a pose [m, rad] at which a search ends."""

ROUNDS = 60
"""Newton steps after which a start is given up."""

DAMPING = 1e-2
"""Levenberg's damping, times the squared miss: it fades as the search closes in, to no less than 1e-12."""

LARGEST_STEP = 1.0
"""Largest change of a joint in one step [rad, m]."""


@dataclass(frozen=True)
class Comparison:
    """A closed form beside the numeric search.

    Attributes:
        poses: Poses searched.
        solutions: Solutions of the closed form.
        found: Those of them the search found too.
        missing: Solutions the search found and the closed form lacks.
        gap: Largest difference of a solution found by both [rad, m].
    """

    poses: int
    solutions: int
    found: int
    missing: int
    gap: float


def compare_with_search(arm: Arm, q: Array, starts: int, rng: np.random.Generator) -> Comparison:
    """Invert the poses of joint vectors (N, joints) both ways; keep away from singular poses."""
    T, held = arm.forward(q), held_values(arm, q)
    closed = arm.inverse(T, held)
    total = found = missing = 0
    gap = 0.0
    for i, numeric in enumerate(search_solutions(arm, T, held, starts, rng)):
        ours = closed.q[i][closed.valid[i]]
        distance = joint_distance(arm, numeric[:, None], ours[None])
        total += len(ours)
        found += int((distance.min(axis=0, initial=np.inf) <= SAME).sum())
        nearest = distance.min(axis=1, initial=np.inf)
        missing += int((nearest > SAME).sum())
        gap = max(gap, float(nearest[nearest <= SAME].max(initial=0.0)))
    return Comparison(len(q), total, found, missing, gap)


def search_solutions(
    arm: Arm, T: Array, held: dict[int, Array], starts: int, rng: np.random.Generator
) -> list[Array]:
    """Search every pose's solutions numerically: damped Newton from many starts, then cluster.

    Args:
        arm: Any arm with six joints that are not held.
        T: Poses, shape (N, 4, 4).
        held: Values of the held joints, each shape (N,).
        starts: Starts per pose, spread over full turns and slides.
        rng: Source of randomness.

    Returns:
        Of each pose the distinct joint vectors found, shape (k, joints).
    """
    free = free_joints(arm)
    n = len(T)
    q = np.where(
        arm.prismatic,
        rng.uniform(-1, 1, (n, starts, arm.n)) * slide_span(arm),
        rng.uniform(-np.pi, np.pi, (n, starts, arm.n)),
    )
    for number, value in held.items():
        q[:, :, number - 1] = value[:, None]
    flat, pose = q.reshape(-1, arm.n), np.repeat(np.arange(n), starts)
    done: list[tuple[NDArray[np.int64], Array]] = []
    for _ in range(ROUNDS):
        now = arm.forward(flat)
        error = np.concatenate(
            [T[pose, :3, 3] - now[:, :3, 3], turn_between(T[pose, :3, :3], now[:, :3, :3])], axis=1
        )
        size = np.linalg.norm(error, axis=1)
        arrived = size < ARRIVED
        done.append((pose[arrived], flat[arrived]))
        flat, pose, error, size = flat[~arrived], pose[~arrived], error[~arrived], size[~arrived]
        if not len(flat):
            break
        J = arm.jacobian(flat)[:, :, free]
        Jt = np.swapaxes(J, 1, 2)
        damping = (DAMPING * np.minimum(size, 1.0) ** 2 + 1e-12)[:, None, None] * np.eye(6)
        step = np.linalg.solve(Jt @ J + damping, Jt @ error[..., None])[..., 0]
        flat[:, free] += step * np.minimum(1.0, LARGEST_STEP / np.abs(step).max(axis=1))[:, None]
    poses, found = np.concatenate([p for p, _ in done]), np.concatenate([f for _, f in done])
    return [_distinct(arm, found[poses == i]) for i in range(n)]


def _distinct(arm: Arm, found: Array) -> Array:
    """Keep one of each cluster of joint vectors, shape (k, joints)."""
    kept: list[Array] = []
    while len(found):
        kept.append(found[0])
        found = found[joint_distance(arm, found, found[0]) > SAME]
    return np.array(kept).reshape(-1, arm.n)
