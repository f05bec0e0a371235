"""Hold a closed-form inverse to what it promises: Arm -> counts and worst misses over many poses.

Nothing here knows a formula of the inverse: joints are drawn, carried forward, inverted, and what comes
back is carried forward again or looked for by a search that only knows the forward model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.solution import MEETING, TURN

ROUNDING = 10.0 * MEETING
"""Rounding of a pose on its way through the inverse [1, m], what counts as rounding there included."""

GRID = 33
"""Values of a joint at which the determinant is sampled to find where it changes its sign."""


@dataclass(frozen=True)
class RoundTrip:
    """How joint vectors came back from forward and inverse.

    Attributes:
        gap: Distance of the nearest solution from the drawn joints, angles modulo a turn, largest
            joint [rad, m], infinite where no solution came back, shape (N,).
        miss_m: Farthest any solution's tool is from the pose [m].
        miss_rad: Most any solution's tool is turned from it [rad].
        count: Real solutions of each pose, shape (N,).
        inside: Solutions within limits of each pose, shape (N,).
    """

    gap: Array
    miss_m: float
    miss_rad: float
    count: NDArray[np.int64]
    inside: NDArray[np.int64]


def draw_within_limits(arm: Arm, n: int, rng: np.random.Generator, at_ends: float = 0.0) -> Array:
    """Draw joint vectors uniformly within every range, sums included, shape (n, joints).

    Args:
        arm: The arm.
        n: Number of joint vectors.
        rng: Source of randomness.
        at_ends: Share of the joints that stand exactly on an end of their range.
    """
    g = rng.uniform(arm.limit_lower, arm.limit_upper, (n, arm.n))
    ends = np.where(rng.random(g.shape) < 0.5, arm.limit_lower, arm.limit_upper)
    g = np.where(rng.random(g.shape) < at_ends, ends, g)
    return np.asarray(np.linalg.solve(arm.limit_matrix, g.T).T, dtype=float)


def draw_singular(arm: Arm, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw joint vectors on and near singularities of the free joints, whichever these are.

    Along a random joint the determinant of the Jacobian is bisected to where it changes its sign: the
    wrist on the slew axis, the boom at its fold, parallel axes. Slides may leave their range, for most
    of these lie beyond it. Half of the vectors stay there, half are moved off by 1e-12 to 1e-2.

    Returns:
        Joint vectors [rad, m], at most n of them, shape (m, joints), and how far each was moved off.
    """
    q, free, reach = draw_within_limits(arm, n, rng), free_joints(arm), slide_span(arm)
    for i in free[arm.prismatic[free]]:
        q[:, i] = np.where(rng.random(n) < 0.5, q[:, i], rng.uniform(-reach, reach, n))
    joint = rng.choice(free, n)
    span = np.where(arm.prismatic[joint], reach, np.pi)
    rows = np.arange(n)
    grid = np.repeat(q[:, None], GRID, axis=1)
    grid[rows, :, joint] = np.linspace(-span, span, GRID).T
    sign = np.sign(_determinant(arm, grid))
    changes = sign[:, 1:] * sign[:, :-1] < 0
    rows = np.flatnonzero(changes.any(axis=1))
    first = changes[rows].argmax(axis=1)
    low, high = grid[rows, first], grid[rows, first + 1]
    below = sign[rows, first]
    for _ in range(60):
        middle = (low + high) / 2
        same = np.sign(_determinant(arm, middle)) == below
        low, high = np.where(same[:, None], middle, low), np.where(same[:, None], high, middle)
    off = np.where(rng.random(len(rows)) < 0.5, 0.0, 10.0 ** rng.uniform(-12.0, -2.0, len(rows)))
    low[np.arange(len(rows)), joint[rows]] += off
    return low, off


def check_round_trip(arm: Arm, q: Array, *, use_near: bool = False) -> RoundTrip:
    """Carry joint vectors (N, joints) forward and back and measure what returns.

    Args:
        arm: An arm with a closed form.
        q: Joint vectors [rad, m].
        use_near: Whether to give the vectors themselves as what settles a singular pose.
    """
    T = arm.forward(q)
    solutions = arm.inverse(T, held_values(arm, q), q if use_near else None)
    gap = joint_distance(arm, solutions.q, q[:, None])
    pose, row = np.nonzero(solutions.valid)
    reached = arm.forward(solutions.q[pose, row])
    turn = turn_between(reached[:, :3, :3], T[pose, :3, :3])
    way = np.linalg.norm(reached[:, :3, 3] - T[pose, :3, 3], axis=1)
    return RoundTrip(
        gap=np.where(solutions.valid, gap, np.inf).min(axis=1),
        miss_m=float(way.max(initial=0.0)),
        miss_rad=float(np.linalg.norm(turn, axis=1).max(initial=0.0)),
        count=solutions.valid.sum(axis=1),
        inside=solutions.within_limits.sum(axis=1),
    )


def expected_gap(arm: Arm, q: Array) -> Array:
    """Bound what rounding of the pose alone does to the joints, shape (N,) [rad, m].

    1e-9, and near a singularity rounding over the smallest singular value of the free joints'
    Jacobian: there no method can tell joints apart that give the same pose in double precision.
    """
    with np.errstate(divide="ignore"):
        return 1e-9 + ROUNDING / least_singular_value(arm, q)


def least_singular_value(arm: Arm, q: Array) -> Array:
    """Compute how far joint vectors (N, joints) are from a singularity of the free joints, shape (N,)."""
    J = arm.jacobian(q)[..., free_joints(arm)]
    return np.asarray(np.linalg.svd(J, compute_uv=False)[..., -1], dtype=float)


def joint_distance(arm: Arm, a: Array, b: Array) -> Array:
    """Compute the largest difference of any joint, angles modulo a turn, shape (...) [rad, m]."""
    gap = np.abs(a - b)
    turning = ~arm.prismatic
    gap[..., turning] = np.abs((gap[..., turning] + np.pi) % TURN - np.pi)
    return gap.max(axis=-1)


def turn_between(R_a: Array, R_b: Array) -> Array:
    """Compute the turn w [rad] with R_a = exp(w) R_b, shape (N, 3); accurate to rounding near zero."""
    M = R_a @ np.swapaxes(R_b, -1, -2)
    v = 0.5 * np.stack([M[:, 2, 1] - M[:, 1, 2], M[:, 0, 2] - M[:, 2, 0], M[:, 1, 0] - M[:, 0, 1]], axis=-1)
    sine = np.linalg.norm(v, axis=-1)
    angle = np.arctan2(sine, (np.trace(M, axis1=-2, axis2=-1) - 1.0) / 2)
    return v * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]


def free_joints(arm: Arm) -> NDArray[np.int64]:
    """Return the indices of the six joints the inverse solves for.

    Raises:
        InputError: Another number than six is free.
    """
    free = np.array([i for i in range(arm.n) if i + 1 not in arm.held], dtype=np.int64)
    if len(free) != 6:
        raise InputError(f"machine {arm.name}: a pose fixes six joints, but {len(free)} are free")
    return free


def held_values(arm: Arm, q: Array) -> dict[int, Array]:
    """Take the values of the held joints out of joint vectors (N, joints)."""
    return {number: q[:, number - 1] for number in arm.held}


def slide_span(arm: Arm) -> float:
    """Return a length [m] within which every slide of every real solution stays, ranges or not."""
    frames = arm.frames(np.where(arm.prismatic, arm.upper, 0.0))
    return float(2.0 * np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1).sum())


def _determinant(arm: Arm, q: Array) -> Array:
    return np.linalg.det(arm.jacobian(q)[..., free_joints(arm)])
