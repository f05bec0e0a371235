"""Smooth a chain of joint vectors: Gauss-Newton over the whole path, targets and limits kept.

The three redundant coordinates are not used as unknowns: at the crown the nozzle's tilt axis turns
parallel to the pitch axes, where the closed form folds over. All joints are unknown instead, the task
enters as stiff terms, and every joint couples only with itself at its two neighbours on each side,
so that one round is one banded solution.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier, Sight
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel
from ascrcp.kinematics.kernel_table import CostTable, freeze
from ascrcp.kinematics.spacing import NEAREST
from ascrcp.kinematics.task import project_task

TASK_STIFFNESS = 1e8
"""Weight of a squared miss [1/m^2, 1/rad^2] against squared travel: leaves micrometres."""

HARD_LIMIT = 1e4
"""How much dearer than the margin a joint beyond its limit is."""

INSIDE = 1e-3
"""Share of a range inside its end at which a joint counts as beyond, so that the balance of stiff terms
still lies within the limit."""

FIRST_DAMPING = 1.0
"""Damping of the first round [1/m]: small against 1 / distance."""

GAIN = 1e-4
"""Relative gain of a round at which smoothing a piece ends."""


@dataclass(frozen=True)
class Keeper:
    """What keeps a chain clear: the barrier and the emphasis of its links at every point, (n, c)."""

    barrier: Barrier
    emphasis: Array


@dataclass(frozen=True)
class Cost:
    """What the chain is to minimise, in units of squared seconds of weighted travel.

    Attributes:
        metric: Squared travel time per squared unit of each joint [s^2/rad^2, s^2/m^2], (joints,).
        middle: Middle of the limited quantities [rad, m], (joints,).
        half: Half their ranges less the margin, (joints,).
        limit_half: Half their ranges less a hair, (joints,).
        centre: Weight of leaving the middle, per squared half range, (joints,).
        limit: Weight of entering the margin, per squared half range, (joints,).
    """

    metric: Array
    middle: Array
    half: Array
    limit_half: Array
    centre: Array
    limit: Array

    def table(self, arm: Arm) -> CostTable:
        """Return the weights for the machine code."""
        own = (self.metric, self.middle, self.half, self.limit_half, self.centre, self.limit)
        return freeze(CostTable(arm.limit_matrix, *own, HARD_LIMIT * self.limit))


def make_cost(arm: Arm, model: PathModel) -> Cost:
    """Take the weights of a machine."""
    half = (arm.limit_upper - arm.limit_lower) / 2
    scale = (arm.travel_weight / arm.max_speed * half) ** 2
    return Cost(
        metric=(arm.travel_weight / arm.max_speed) ** 2,
        middle=(arm.limit_upper + arm.limit_lower) / 2,
        half=half * (1.0 - 2.0 * model.margin_fraction),
        limit_half=half * (1.0 - INSIDE),
        centre=model.centre_weight * scale / half**2,
        limit=model.limit_weight * scale / half**2,
    )


def own_cost(arm: Arm, cost: Cost, q: Array) -> Array:
    """Cost of joint vectors (..., joints) by themselves: off the middle, in the margin; (...)."""
    off = q @ arm.limit_matrix.T - cost.middle
    over = np.maximum(np.abs(off) - cost.half, 0.0)
    return (cost.centre * off**2 + cost.limit * over**2).sum(axis=-1)


def smooth_round(
    arm: Arm,
    cost: Cost,
    T: Array,
    q: Array,
    distance: Array,
    curvature: float,
    damping: Array,
    push: tuple[Array, Array] | None = None,
) -> Array:
    """Do one Gauss-Newton round.

    Args:
        arm: The arm.
        cost: Weights.
        T: Targets (roll free), shape (n, 4, 4).
        q: Joint vectors, shape (n, joints).
        distance: Distance from the point before [m], infinite where the chain is cut, shape (n,).
        curvature: Weight of the squared second difference by distance [m].
        damping: Weight of the change itself, against staying [1/m], shape (n,).
        push: Further terms of the points by themselves: blocks (n, joints, joints), gradient (n, joints).

    Returns:
        Better joint vectors, shape (n, joints).
    """
    n, joints = q.shape
    travel, pull = _difference_terms(q, distance, curvature)
    travel[:, 0] += damping
    blocks, slope = (np.zeros((n, joints, joints)), np.zeros((n, joints))) if push is None else push
    code = kernel("smooth").assemble
    band, gradient = by_halves(
        lambda *rows: code(arm.table, cost.table(arm), TASK_STIFFNESS, *rows),
        *(np.ascontiguousarray(T), as_rows(q), travel, pull, blocks, slope),
    )
    upper = band.reshape(n * joints, 2 * joints + 1).T
    step = solveh_banded(upper, gradient.reshape(-1), overwrite_ab=True, check_finite=False)
    return q - step.reshape(n, joints)


def point_cost(arm: Arm, cost: Cost, q: Array, distance: Array, curvature: float) -> Array:
    """Split what smoothing minimises over the chain q (n, joints) into shares of the points, (n,).

    Their sum over a piece between two cuts is the piece's cost; limits included, task not.
    """
    product = _difference_terms(q, distance, curvature)[1]
    off = q @ arm.limit_matrix.T - cost.middle
    beyond = np.maximum(np.abs(off) - cost.limit_half, 0.0)
    hard = HARD_LIMIT * (cost.limit * beyond**2).sum(axis=1)
    return np.asarray((cost.metric * q * product).sum(axis=1) + own_cost(arm, cost, q) + hard)


def smooth_chain(
    arm: Arm,
    cost: Cost,
    T: Array,
    q: Array,
    distance: Array,
    curvature: float,
    rounds: int,
    report: Callable[[int], None],
    keeper: Keeper | None = None,
) -> Array:
    """Smooth a chain until it gains no more: Levenberg's damping around `smooth_round`.

    The pieces between two cuts know nothing of each other: each has its own damping, raised where a
    round does not lower the piece's cost and is thrown away, and each ends by itself.

    Args:
        arm: The arm.
        cost: Weights.
        T: Targets, shape (n, 4, 4).
        q: Joint vectors, shape (n, joints).
        distance: Distance from the point before [m], infinite at a cut, shape (n,).
        curvature: Weight of the squared second difference [m].
        rounds: Largest number of rounds.
        report: Called with the number of rounds done; may raise to stop.
        keeper: What keeps the chain clear, None for nothing.

    Returns:
        Joint vectors on their targets, shape (n, joints).
    """
    piece = np.cumsum(~np.isfinite(distance))
    count = int(piece[-1]) + 1

    def judge(q: Array, rows: NDArray[np.int64]) -> tuple[Array, Sight | None]:
        price = point_cost(arm, cost, q, distance[rows], curvature)
        sight = None
        if keeper is not None:
            sight = keeper.barrier.look(q)
            price += keeper.barrier.cost(sight, keeper.emphasis[rows])
        return np.bincount(piece[rows], price, count).astype(float), sight

    q = project_task(arm, T, q, cost.metric)
    best, sight = judge(q, np.arange(len(q)))
    damping, going = np.full(count, FIRST_DAMPING), np.ones(count, dtype=bool)
    for done in range(1, rounds + 1):
        report(done)
        rows = np.flatnonzero(going[piece])
        if not rows.size:
            break
        push = None
        if keeper is not None and sight is not None:
            push = keeper.barrier.terms(q[rows], sight.pick(rows), keeper.emphasis[rows])
        try:
            trial = smooth_round(
                arm, cost, T[rows], q[rows], distance[rows], curvature, damping[piece[rows]], push
            )
        except np.linalg.LinAlgError:  # not positive definite by rounding: more damping mends it
            damping *= 8.0
            continue
        trial = project_task(arm, T[rows], trial, cost.metric, rounds=2)
        reached, seen = judge(trial, rows)
        better = going & (reached < best)
        taken = better[piece[rows]]
        q[rows[taken]] = trial[taken]
        if sight is not None and seen is not None:
            sight.put(rows[taken], seen.pick(np.flatnonzero(taken)))
        damping *= np.where(better, 0.25, 8.0)
        going &= ~(better & (best - reached < GAIN * best))
        best = np.where(better, reached, best)
    return q


def _difference_terms(q: Array, distance: Array, curvature: float) -> tuple[Array, Array]:
    """Assemble squared first and second differences by distance, a scalar matrix for all joints.

    Returns:
        The matrix by its diagonal, first and second off-diagonal, (n, 3), and times q, (n, joints); entry i
        of an off-diagonal couples point i with i - 1 or i - 2.
    """
    n = len(q)
    d = np.maximum(distance, NEAREST)
    w = np.where(np.isfinite(d), 1.0 / d, 0.0)
    w[0] = 0.0
    diagonal, first, second = np.zeros(n), np.zeros(n), np.zeros(n)
    diagonal += w
    diagonal[:-1] += w[1:]
    first[1:] -= w[1:]
    # second difference at i: w[i+1] (q[i+1] - q[i]) - w[i] (q[i] - q[i-1]), none across a cut
    whole = curvature * ((w[1:-1] > 0.0) & (w[2:] > 0.0)) if n > 2 else np.zeros(0)
    if n > 2:
        a, c = w[1:-1], w[2:]
        b = -(a + c)
        diagonal[:-2] += whole * a * a
        diagonal[1:-1] += whole * b * b
        diagonal[2:] += whole * c * c
        first[1:-1] += whole * a * b
        first[2:] += whole * b * c
        second[2:] += whole * a * c
    product = diagonal[:, None] * q
    product[1:] += first[1:, None] * q[:-1]
    product[:-1] += first[1:, None] * q[1:]
    product[2:] += second[2:, None] * q[:-2]
    product[:-2] += second[2:, None] * q[2:]
    return np.stack([diagonal, first, second], axis=1), product
