"""Solve a whole path: SprayPath -> PathSolution, every limit kept and no joint jumping.

Candidates over theta1, q5, q6 at key points and the cheapest chain through them settle the
configuration; smoothing over all points settles the rest; a point that still fails is tried by itself
from its neighbours, and what fails then says why. Targets are raised by the sag beforehand.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier, make_barrier, no_emphasis
from ascrcp.kinematics.candidate import Grid, find_candidates, find_rolls, make_grid, solve_grid
from ascrcp.kinematics.clearance import clearance, rough_clearance
from ascrcp.kinematics.description import ClearanceModel, PathModel
from ascrcp.kinematics.feedback import (
    add_tilt,
    find_lever,
    raise_weights,
    split_collisions,
    spread_tilt,
    tilt_path,
)
from ascrcp.kinematics.graph import find_chain
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.reason import explain_failure, limit_excess
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.smooth import Cost, Keeper, make_cost, own_cost, smooth_chain
from ascrcp.kinematics.task import compute_error, find_roll, spray_pose

Progress = Callable[[float], None]

ANCHORS = 24
"""Key points at which every roll is tried; elsewhere only the rolls that were of use at some anchor."""

STAND_OFF = 1.0
"""Nozzle to wall [m] (design.md section 1): carries a turn of the nozzle to the wall."""

LAST_REDUNDANT = 6
"""Last joint the redundant ones still move at a given pose: beyond, wrist and nozzle are tied to it."""

TASK_TOLERANCE = 1e-6
"""Largest miss of a solved point [m, rad]."""

REROLL = np.pi / 2
"""Step of a turning joint between neighbouring points beyond which it goes round the other way [rad]."""

NEARLY = 0.1
"""Share of a range by which a lone point's best candidate may leave it and still be tried."""

COLLIDED = 1e6
"""Rank of a metre by which a candidate comes too near, above any squared travel time [s^2/m]."""

FAR_OFF = 1e9
"""Rank of a candidate beyond the limits, above any squared travel time [s^2]."""

FEEDBACK_ROUNDS = 4
"""Rounds of collision feedback; placeholder, the third paper needs three steps at most."""

FEEDBACK_SMOOTHING = 4
"""Smoothing rounds between them."""

BLOCK = 8
"""Points whose whole candidate grid is held at once: 0.5 MB each."""


@dataclass(frozen=True)
class PathSolution:
    """Joints along a path; rows belong to the planned points.

    Attributes:
        q: Joint vectors [rad, m], NaN where unsolved, shape (n, joints). forward(q) is the planned
            pose raised by the sag, so that the sagged arm meets the plan.
        theta1: Free roll chosen [rad], NaN where unsolved, shape (n,).
        reasons: Why a point is unsolved, None where it is solved.
        break_before: Whether the arm must stop spraying and reposition before this point: passes
            far apart, joint 7 rolling round, or the first point; shape (n,).
        path: The planned path with the poses that were tilted to keep clear.
        tilt: Angle between planned and solved spray direction [rad], shape (n,).
        clearance: Distance to the surroundings [m], NaN where unsolved or none were given, shape (n,).
    """

    q: Array
    theta1: Array
    reasons: tuple[str | None, ...]
    break_before: NDArray[np.bool_]
    path: SprayPath
    tilt: Array
    clearance: Array

    def __post_init__(self) -> None:
        for array in (self.q, self.theta1, self.break_before, self.tilt, self.clearance):
            array.flags.writeable = False

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Whether each point is solved, shape (n,)."""
        return np.isfinite(self.theta1)


def solve_path(
    arm: Arm,
    path: SprayPath,
    start_q: ArrayLike,
    payload_kg: float = 0.0,
    progress: Progress | None = None,
    obstacles: Obstacles | None = None,
) -> PathSolution:
    """Solve the joints of a whole path.

    Args:
        arm: An arm with a path model and a closed form that holds joints 5 and 6.
        path: Planned points, n of them.
        start_q: Joint vector the arm comes from [rad, m], shape (joints,).
        payload_kg: Concrete in the hose [kg], for the sag.
        progress: Called with the share done; may raise CancelledError to stop.
        obstacles: What to keep clear of; None for nothing.

    Raises:
        InputError: A bad start, an empty path, or an arm that cannot do this.
    """
    model = arm.description.path
    if model is None or arm.held != (5, 6):
        raise InputError(f"machine {arm.name} has no path model or no closed form for spray paths")
    start = np.asarray(start_q, dtype=float)
    if start.shape != (arm.n,) or not np.isfinite(start).all():
        raise InputError(f"start_q must be finite with shape ({arm.n},), not {start.shape}")
    if not len(path):
        raise InputError("the path holds no point")
    report = progress or _ignore
    work = _Work(arm, model, make_cost(arm, model), path, payload_kg, start, obstacles)
    report(0.0)
    distance = _distances(work.T, model.far)
    q = work.keep_good(work.smooth(work.start_chain(distance, report), report, 0.5, 0.65))
    q = work.keep_clear(q, report)
    q, best = work.rescue(work.keep_least(q), report)
    smoothed = work.keep_least(work.keep_good(work.smooth(q, report, 0.85, 1.0)))
    return work.finish(np.where(np.isfinite(smoothed), smoothed, q), best, report)


def _ignore(_: float) -> None:
    """Take no notice of progress."""


def _distances(T: Array, far: float) -> Array:
    """Distance from the pose before, infinite at the first and where the nozzle jumps farther than far.

    The nozzle's way or that of the point sprayed at, whichever is longer: in a pocket the nozzle turns
    almost on the spot.

    Args:
        T: Poses, shape (n, 4, 4).
        far: Largest way of the nozzle that is sprayed through [m].

    Returns:
        Distances [m], shape (n,).
    """
    nozzle = T[:, :3, 3]
    wall = nozzle + STAND_OFF * T[:, :3, 0]
    way, sprayed = (np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (nozzle, wall))
    return np.concatenate([[np.inf], np.where(way <= far, np.maximum(way, sprayed), np.inf)])


class _Work:
    """One path being solved.

    Attributes:
        arm, model, cost: Machine and weights.
        planned: The path as planned.
        path: The path as it is solved: tilted where it must be.
        payload_kg: Concrete in the hose, for the sag.
        T: Its poses raised by the sag, theta1 = 0, shape (n, 4, 4).
        start: Joint vector the arm comes from, shape (joints,).
        tilt: Rotation vectors from planned to solved [rad], base frame, shape (n, 3).
        obstacles, barrier: Surroundings, None if there are none.
        emphasis: Weight of keeping each link clear, shape (n, links).
    """

    def __init__(
        self,
        arm: Arm,
        model: PathModel,
        cost: Cost,
        path: SprayPath,
        payload_kg: float,
        start: Array,
        obstacles: Obstacles | None,
    ) -> None:
        self.arm, self.model, self.cost = arm, model, cost
        self.planned = self.path = path
        self.payload_kg, self.start = payload_kg, start
        self.T = compensate(arm, spray_pose(path), payload_kg)
        self.tilt = np.zeros((len(path), 3))
        self.obstacles = obstacles
        self.barrier = None if obstacles is None else make_barrier(arm, obstacles)
        self.emphasis = np.zeros((len(path), 0))
        if self.barrier is not None:
            self.emphasis = no_emphasis(self.barrier, len(path))

    def start_chain(self, distance: Array, report: Progress) -> Array:
        """Find a first chain: candidates at key points, the graph, the points between interpolated.

        Returns:
            Joint vectors, NaN between key points that have no candidate, shape (n, joints).
        """
        keys = _find_keys(distance, self.model.key_spacing)
        grid = make_grid(self.arm, self.model)
        anchors = keys[np.linspace(0, len(keys) - 1, min(len(keys), ANCHORS)).astype(int)]
        rolls = find_rolls(self.arm, self.T[anchors], grid)
        grid = grid.keep(rolls) if rolls.size else grid
        report(0.1)
        layers = self._find_layers(keys, grid, report)
        usable = np.array([i for i, layer in enumerate(layers) if len(layer)], dtype=np.int64)
        q = np.full((len(self.T), self.arm.n), np.nan)
        if not usable.size:
            return q
        along = np.cumsum(np.where(np.isfinite(distance), distance, 0.0))
        cuts = np.cumsum(~np.isfinite(distance))
        chosen_keys = keys[usable]
        gaps = np.concatenate([[np.inf], np.maximum(np.diff(along[chosen_keys]), 1e-3)])
        gaps[1:][np.diff(cuts[chosen_keys]) > 0] = np.inf
        used = [layers[i] for i in usable]
        chain = find_chain(
            used,
            [own_cost(self.arm, self.cost, layer) * self.model.key_spacing for layer in used],
            np.sqrt(self.cost.metric),
            gaps,
            self.model.break_cost,
            self.start,
        )
        report(0.5)
        chosen = np.array([layer[c] for layer, c in zip(used, chain, strict=True)])
        self._fill_between(q, chosen_keys, chosen, usable, along, cuts)
        return q

    def _find_layers(self, keys: NDArray[np.int64], grid: Grid, report: Progress) -> list[Array]:
        layers: list[Array] = []
        for start in range(0, len(keys), 32):
            found = find_candidates(self.arm, self.T[keys[start : start + 32]], grid)
            layers.extend(self._clear_ones(layer) for layer in found)
            report(0.1 + 0.3 * min(1.0, (start + 32) / len(keys)))
        return layers

    def _clear_ones(self, layer: Array) -> Array:
        """Leave out candidates that stand in something, unless all do."""
        if self.obstacles is None or not len(layer):
            return layer
        free = rough_clearance(self.arm, layer, self.obstacles) > 0.0
        return layer[free] if free.any() else layer

    def _fill_between(
        self,
        q: Array,
        keys: NDArray[np.int64],
        chosen: Array,
        usable: NDArray[np.int64],
        along: Array,
        cuts: NDArray[np.int64],
    ) -> None:
        """Interpolate between neighbouring keys; across a break each half keeps its own key's joints."""
        q[keys] = chosen
        for i in range(len(keys) - 1):
            a, b = keys[i], keys[i + 1]
            if b <= a + 1 or usable[i + 1] != usable[i] + 1:
                continue
            inner = np.arange(a + 1, b)
            share = (along[inner] - along[a]) / max(along[b] - along[a], 1e-9)
            if cuts[a] != cuts[b]:
                share = (cuts[inner] == cuts[b]).astype(float)
            elif bool(self._is_reroll(chosen[i], chosen[i + 1])):
                share = np.round(share)
            q[inner] = chosen[i] + share[:, None] * (chosen[i + 1] - chosen[i])

    def smooth(
        self, q: Array, report: Progress, begin: float, end: float, rounds: int | None = None
    ) -> Array:
        """Smooth the chain of solved points; the rest stays NaN."""
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        if not live.size:
            return q
        rounds = rounds or self.model.smooth_rounds
        smoothed = q.copy()
        smoothed[live] = smooth_chain(
            self.arm,
            self.cost,
            self.T[live],
            q[live],
            self._gaps(q[live], self.T[live]),
            self.model.curvature_weight,
            rounds,
            lambda done: report(begin + (end - begin) * done / rounds),
            self._keeper(live),
        )
        return smoothed

    def _keeper(self, rows: NDArray[np.int64]) -> Keeper | None:
        return None if self.barrier is None else Keeper(self.barrier, self.emphasis[rows])

    def keep_clear(self, q: Array, report: Progress) -> Array:
        """Do the rounds of collision feedback: raise weights, tilt poses, smooth, until all keep clear."""
        model, barrier = self.arm.description.clearance, self.barrier
        if model is None or barrier is None:
            return q
        for done in range(FEEDBACK_ROUNDS):
            live = np.flatnonzero(np.isfinite(q[:, 0]))
            sight = barrier.look(q[live])
            avoidable, tied = split_collisions(barrier.body, sight, model.wanted, LAST_REDUNDANT)
            if not (avoidable | tied).any():
                break
            self.emphasis[live] = raise_weights(self.emphasis[live], avoidable)
            pivot = self.planned.position[live] + STAND_OFF * self.planned.direction[live]
            more = np.zeros_like(self.tilt)
            more[live] = find_lever(barrier.obstacles, sight, tied, pivot, model.wanted)
            self._tilt(more, model)
            begin = 0.65 + 0.1 * done / FEEDBACK_ROUNDS
            q = self.keep_good(
                self.smooth(q, report, begin, begin + 0.1 / FEEDBACK_ROUNDS, FEEDBACK_SMOOTHING)
            )
        return q

    def _tilt(self, more: Array, model: ClearanceModel) -> None:
        step, limit = np.radians(model.tilt_step_deg), np.radians(model.tilt_limit_deg)
        tilt = add_tilt(self.tilt, more, self.planned.direction, step, limit)
        strokes = np.cumsum(~np.isfinite(_distances(self.T, self.model.far)))
        self.tilt = spread_tilt(tilt, strokes, step)
        self.path = tilt_path(self.planned, self.tilt, STAND_OFF)
        self.T = compensate(self.arm, spray_pose(self.path), self.payload_kg)

    def keep_least(self, q: Array) -> Array:
        """Set points that come nearer to anything than the least clearance to NaN."""
        model = self.arm.description.clearance
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        if model is None or self.obstacles is None or not live.size:
            return q
        kept = q.copy()
        near = ~(clearance(self.arm, q[live], self.obstacles).distance >= model.least)
        kept[live[near]] = np.nan
        return kept

    def _gaps(self, x: Array, T: Array) -> Array:
        """Distances along the chain of solved points, infinite where it cannot be continuous."""
        gaps = _distances(T, self.model.far)
        gaps[1:][self._is_reroll(x[:-1], x[1:])] = np.inf
        return gaps

    def _is_reroll(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Tell where a turning joint goes round instead of along: no smoothing can join these."""
        step = np.abs(b - a)
        return np.asarray((step[..., ~self.arm.prismatic] > REROLL).any(axis=-1))

    def keep_good(self, q: Array) -> Array:
        """Set points that miss their target or break a limit to NaN."""
        live = np.flatnonzero(np.isfinite(q).all(axis=1))
        kept = np.full_like(q, np.nan)
        if live.size:
            miss = compute_error(self.arm, self.T[live], q[live]).size
            good = live[(miss <= TASK_TOLERANCE) & self.arm.within_limits(q[live])]
            kept[good] = q[good]
        return kept

    def rescue(self, q: Array, report: Progress) -> tuple[Array, Array]:
        """Try unsolved points by themselves, from the closed form over the whole grid.

        Of a point's candidates the one that leaves the ranges least is taken, the nearest to its
        solved neighbours where several keep them, and is then moved inside if it can be.

        Returns:
            Joint vectors with the rescued points filled in (n, joints), and the candidate each
            unsolved point started from (n, joints), which tells why it failed.
        """
        failed = np.flatnonzero(~np.isfinite(q[:, 0]))
        grid = make_grid(self.arm, self.model)
        best = np.full_like(q, np.nan)
        neighbour = _nearest_solved(q, failed, self.start)
        for start in range(0, len(failed), BLOCK):
            report(0.75 + 0.1 * start / len(failed))
            rows = failed[start : start + BLOCK]
            block = solve_grid(self.arm, self.T[rows], grid).reshape(len(rows), -1, self.arm.n)
            excess = np.nan_to_num(limit_excess(self.arm, block).max(axis=-1), nan=np.inf)
            travel = (self.cost.metric * (block - neighbour[start : start + BLOCK, None]) ** 2).sum(axis=-1)
            # travel decides among those within limits; beyond them the excess outweighs any travel
            if self.obstacles is not None and self.barrier is not None:
                flat = np.nan_to_num(block.reshape(-1, self.arm.n))
                near = rough_clearance(self.arm, flat, self.obstacles).reshape(excess.shape)
                travel += COLLIDED * np.maximum(self.barrier.soft - near, 0.0)
            rank = np.where(excess > 0.0, FAR_OFF * (1.0 + excess), np.nan_to_num(travel, nan=np.inf))
            best[rows] = block[np.arange(len(rows)), rank.argmin(axis=1)]
        excess = np.nan_to_num(limit_excess(self.arm, best).max(axis=-1), nan=np.inf)
        near = np.flatnonzero(excess < NEARLY)
        if not near.size:
            return q, best
        cuts = np.full(len(near), np.inf)
        alone = best.copy()
        alone[near] = smooth_chain(
            self.arm,
            self.cost,
            self.T[near],
            best[near],
            cuts,
            0.0,
            self.model.smooth_rounds,
            lambda _: report(0.85),
            self._keeper(near),
        )
        return np.where(np.isfinite(q), q, self.keep_least(self.keep_good(alone))), best

    def finish(self, q: Array, best: Array, report: Progress) -> PathSolution:
        """Say why points failed, mark the breaks and read theta1 back."""
        n = len(q)
        solved = np.isfinite(q[:, 0])
        reasons = tuple(
            None if solved[i] else explain_failure(self.arm, best[i], self.obstacles) for i in range(n)
        )
        theta1 = np.full(n, np.nan)
        theta1[solved] = find_roll(self.T[solved], self.arm.forward(q[solved]))
        breaks = np.zeros(n, dtype=bool)
        live = np.flatnonzero(solved)
        gaps = _distances(self.T[live], self.model.far)
        needed = (np.abs(np.diff(q[live], axis=0)) / self.arm.max_speed).max(axis=1, initial=0.0)
        gaps[1:][needed > gaps[1:] / self.model.nozzle_speed + self.model.reroll_s] = np.inf
        breaks[live] = ~np.isfinite(gaps)
        report(1.0)
        free = np.full(n, np.nan)
        if self.obstacles is not None:
            free[solved] = clearance(self.arm, q[solved], self.obstacles).distance
        tilt = np.linalg.norm(self.tilt, axis=1)
        return PathSolution(q, theta1, reasons, breaks, self.path, tilt, free)


def _nearest_solved(q: Array, rows: NDArray[np.int64], start: Array) -> Array:
    """Joint vectors of the solved points nearest in order to rows (m,), start if none; (m, joints)."""
    solved = np.flatnonzero(np.isfinite(q[:, 0]))
    if not solved.size:
        return np.broadcast_to(start, (len(rows), len(start)))
    after = np.searchsorted(solved, rows).clip(0, len(solved) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(rows - solved[before] <= np.abs(solved[after] - rows), before, after)
    return q[solved[nearer]]


def _find_keys(distance: Array, spacing: float) -> NDArray[np.int64]:
    """Pick key points: the ends of every uncut stretch and one per spacing between; rising (k,)."""
    n = len(distance)
    keys, since = [0], 0.0
    for i in range(1, n):
        cut = not np.isfinite(distance[i])
        since += 0.0 if cut else float(distance[i])
        next_cut = i == n - 1 or not np.isfinite(distance[i + 1])
        if cut or next_cut or since >= spacing:
            keys.append(i)
            since = 0.0
    return np.array(keys, dtype=np.int64)
