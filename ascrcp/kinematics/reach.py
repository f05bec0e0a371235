"""Reach map: nozzle poses -> whether each can be held, with which margin, or what is missing.

Margin is the distance to the nearest end of a range, as a share of that range, in the posture that has
most of it; negative where the ranges are left, by as little as possible.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.reason import explain_failure
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.task import roll_pose
from ascrcp.kinematics.workspace import ReachConfig

Progress = Callable[[float], None]

BLOCK = 4096
"""Candidate poses solved at once: 2 MB of joint vectors, small enough for the cache."""

EDGE = 1e-7
"""Share of a range by which a posture on a limit may come out beyond it: rounding (arm.LIMIT_TOLERANCE)."""


@dataclass(frozen=True)
class ReachMap:
    """How poses can be held; rows belong to the poses.

    Attributes:
        margin: Share of a range left, negative beyond it, -inf where no posture is real, shape (m,).
        q: The best posture [rad, m], NaN where none is real, shape (m, joints).
        joint: Index of the joint whose range is nearest, -1 where no posture is real, shape (m,).
        room: Its distance to the end of its range [rad, m], negative beyond, NaN if none, shape (m,).
    """

    margin: Array
    q: Array
    joint: NDArray[np.int64]
    room: Array

    def __post_init__(self) -> None:
        for array in (self.margin, self.q, self.joint, self.room):
            array.flags.writeable = False

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether each pose can be held, shape (m,)."""
        return self.margin >= -EDGE

    def reason(self, arm: Arm, row: int) -> str | None:
        """Say why a pose cannot be held, None if it can."""
        return None if self.reachable[row] else explain_failure(arm, self.q[row])


def find_reach(
    arm: Arm, T: Array, config: ReachConfig, payload_kg: float = 0.0, progress: Progress | None = None
) -> ReachMap:
    """Find for each pose the posture farthest from the ends of the ranges; roll, q5 and q6 are free.

    Args:
        arm: An arm whose closed form holds joints 5 and 6.
        T: Wanted nozzle poses, roll about x free, shape (m, 4, 4).
        config: Postures tried.
        payload_kg: Concrete in the hose [kg], for the sag.
        progress: Called with the share done; may raise to cancel.

    Raises:
        InputError: An arm that cannot do this.
    """
    if arm.held != (5, 6):
        raise InputError(f"machine {arm.name} has no closed form with joints 5 and 6 held: no reach map")
    T = compensate(arm, T, payload_kg)
    rolls = np.radians(np.arange(-180.0, 180.0, config.roll_step_deg))
    yaws, slides = _spread(arm, 4, config.yaw_candidates), _spread(arm, 5, config.telescope_candidates)
    held = np.stack(np.meshgrid(yaws, slides, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = np.column_stack([np.repeat(rolls, len(held)), np.tile(held, (len(rolls), 1))])
    starts = min(config.starts, len(rolls))
    best = _Best.nothing(len(T) * starts, arm.n)
    size = max(1, BLOCK // len(grid))
    for first in range(0, len(T), size):
        rows = np.arange(first, min(first + size, len(T)))
        _search(arm, T[rows], grid, len(rolls), starts, best, rows)
        if progress is not None:
            progress(0.6 * rows[-1] / len(T))
    spacing = np.array([np.radians(config.roll_step_deg), _step(yaws), _step(slides)])
    _refine(arm, np.repeat(T, starts, axis=0), spacing, config.refine_rounds, best)
    won = best.margin.reshape(-1, starts).argmax(axis=1) + starts * np.arange(len(T))
    joint, room = _nearest_end(arm, best.q[won])
    if progress is not None:
        progress(1.0)
    return ReachMap(best.margin[won], best.q[won], joint, room)


def find_margin(arm: Arm, q: Array) -> Array:
    """Compute the least share of a range left at joint vectors (..., joints), -inf for NaN; (...)."""
    least = np.full(q.shape[:-1], np.inf)
    for joint in arm.joints:  # joint by joint: q is stored joint first by the inverse
        g = q[..., joint.number - 1]
        for other in joint.limit_sum[:-1]:
            g = g + q[..., other - 1]
        off = np.abs(g - (joint.lower + joint.upper) / 2)
        off *= -1.0 / (joint.upper - joint.lower)
        off += 0.5
        np.minimum(least, off, out=least)
    least[np.isnan(least)] = -np.inf
    return least


def _spread(arm: Arm, i: int, count: int) -> Array:
    """Values inside a range, half a spacing off its ends, where the margin would be zero."""
    edges = np.linspace(arm.lower[i], arm.upper[i], count + 1)
    return (edges[:-1] + edges[1:]) / 2


def _step(values: Array) -> float:
    return float(values[1] - values[0]) if len(values) > 1 else 0.0


@dataclass(frozen=True)
class _Best:
    """The best found so far, one row per pose and start: theta1, q5, q6; margin; joint vector."""

    centre: Array
    margin: Array
    q: Array

    @classmethod
    def nothing(cls, rows: int, joints: int) -> "_Best":
        return cls(np.zeros((rows, 3)), np.full(rows, -np.inf), np.full((rows, joints), np.nan))


def _solve(arm: Arm, T: Array, tried: Array) -> tuple[Array, Array]:
    """Solve poses (k, 4, 4) at values (k, g, 3) of theta1, q5, q6.

    Returns:
        Margin of the best branch (k, g) and its joint vector (k, g, joints).
    """
    k, g = tried.shape[:2]
    flat = tried.reshape(-1, 3)
    aimed = roll_pose(np.repeat(T, g, axis=0), flat[:, 0])
    found = arm.candidates(aimed, {5: flat[:, 1], 6: flat[:, 2]})
    margin = find_margin(arm, found)
    branch = margin.argmax(axis=1)
    row = np.arange(k * g)
    return margin[row, branch].reshape(k, g), found[row, branch].reshape(k, g, arm.n)


def _search(
    arm: Arm, T: Array, grid: Array, rolls: int, starts: int, best: _Best, rows: NDArray[np.int64]
) -> None:
    """Try the whole grid (g, 3), rolls first, and keep the best of each of the best rolls."""
    k = len(T)
    margin, q = _solve(arm, T, np.broadcast_to(grid, (k, *grid.shape)))
    by_roll = margin.reshape(k, rolls, -1)
    inner = by_roll.argmax(axis=2)
    order = np.argsort(-by_roll.max(axis=2), axis=1)[:, :starts]
    chosen = order * by_roll.shape[2] + np.take_along_axis(inner, order, axis=1)
    place = (rows[:, None] * starts + np.arange(starts)).ravel()
    best.centre[place] = grid[chosen.ravel()]
    best.margin[place] = np.take_along_axis(margin, chosen, axis=1).ravel()
    best.q[place] = np.take_along_axis(q, chosen[..., None], axis=1).reshape(-1, arm.n)


def _refine(arm: Arm, T: Array, spacing: Array, rounds: int, best: _Best) -> None:
    """Climb from the best values of theta1, q5, q6; the step is halved where no neighbour is better."""
    live = np.flatnonzero(np.isfinite(best.margin))
    steps = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    low = np.array([-np.inf, arm.lower[4], arm.lower[5]])
    high = np.array([np.inf, arm.upper[4], arm.upper[5]])
    share = np.full(len(best.margin), 0.5)
    size = BLOCK // len(steps)
    for _ in range(rounds):
        for first in range(0, len(live), size):
            rows = live[first : first + size]
            around = steps * spacing * share[rows, None, None]
            tried = np.clip(best.centre[rows, None] + around, low, high)
            margin, q = _solve(arm, T[rows], tried)
            top = margin.argmax(axis=1)
            reached = margin[np.arange(len(rows)), top]
            better = reached > best.margin[rows]
            share[rows[~better]] /= 2.0
            won, top = rows[better], top[better]
            best.margin[won] = reached[better]
            best.q[won] = q[better, top]
            best.centre[won] = tried[better, top]


def _nearest_end(arm: Arm, q: Array) -> tuple[NDArray[np.int64], Array]:
    """Return which joint is nearest to an end of its range, and how far from it [rad, m]."""
    g = q @ arm.limit_matrix.T
    distance = np.minimum(g - arm.limit_lower, arm.limit_upper - g)
    share = np.nan_to_num(distance / (arm.limit_upper - arm.limit_lower), nan=np.inf)
    joint = share.argmin(axis=1)
    room = distance[np.arange(len(q)), joint]
    return np.where(np.isfinite(room), joint, -1), room


@dataclass(frozen=True)
class Parking:
    """Places compared along the machine's x axis.

    Attributes:
        offset: How far forward of the present place [m], shape (p,).
        covered: Share of the wall that can be sprayed from there, shape (p,).
        margin: Mean margin of what can, shape (p,).
        best: Index of the place to choose.
    """

    offset: Array
    covered: Array
    margin: Array
    best: int


def compare_places(
    arm: Arm,
    T: Array,
    offset: Array,
    config: ReachConfig,
    payload_kg: float = 0.0,
    progress: Progress | None = None,
) -> Parking:
    """Compare parking places: most of the wall covered, then most margin, then nearest.

    Args:
        arm: The arm.
        T: Wanted nozzle poses from the present place, each standing for the same area, (m, 4, 4).
        offset: Places along the machine's own x axis, forward positive [m], shape (p,).
        config: Postures tried.
        payload_kg: Concrete in the hose [kg].
        progress: Called with the share done; may raise to cancel.
    """
    covered, margin = np.zeros(len(offset)), np.zeros(len(offset))
    for i, forward in enumerate(offset):
        shifted = T.copy()
        shifted[:, 0, 3] -= forward
        found = find_reach(arm, shifted, config, payload_kg)
        covered[i] = found.reachable.mean()
        margin[i] = found.margin[found.reachable].mean() if found.reachable.any() else 0.0
        if progress is not None:
            progress((i + 1) / len(offset))
    order = np.lexsort((np.abs(offset), -np.round(margin, 4), -np.round(covered, 4)))
    return Parking(offset, covered, margin, int(order[0]))
