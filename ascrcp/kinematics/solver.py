"""The steps of solving a whole path: first chain, smoothing, stops, collision feedback, lone points."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.aim import Aim
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import make_barrier, no_emphasis
from ascrcp.kinematics.candidate import make_grid
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.feedback import find_lever, raise_weights, split_collisions
from ascrcp.kinematics.first import TASK_TOLERANCE, FirstChain, is_reroll
from ascrcp.kinematics.kink import patch, straighten
from ascrcp.kinematics.lean import LeanSearch
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.rescue import INSIST, Rescue, nearest_solved
from ascrcp.kinematics.seam import TURN, find_seam_tilt
from ascrcp.kinematics.smooth import Keeper, make_cost, smooth_chain
from ascrcp.kinematics.spacing import STAND_OFF, distances, sum_stretches
from ascrcp.kinematics.task import compute_error, project_task

Progress = Callable[[float], None]

LAST_REDUNDANT = 6
"""Last joint the redundant ones still move at a given pose: beyond, wrist and nozzle are tied to it."""

FEEDBACK_ROUNDS = 4
"""Rounds of collision feedback; placeholder, the third paper needs three steps at most."""

FEEDBACK_SMOOTHING = 4
"""Smoothing rounds between them."""

LOW_SHARE = 10.0
"""A clearance short of the wanted by less than a cell of the field over this is taken as kept."""

CUT = 0.005
"""A cut of a stroke has to gain so many metres at each end: what counts as the same clearance."""

THROWN = 0.01
"""The same of a step that throws the arm while it sprays on; placeholder."""

UNSOLVED = 1.0
"""A point lost or won counts as so many metres of clearance."""

KINK = 0.02
"""Share of a break that a step to another point costs, beyond which the arm is thrown; placeholder."""

PROMISE_KEPT = 0.005
"""A clearance nearer to the most that was seen to be possible is taken for it [m]."""

BESIDE = 2
"""Neighbours that may change their posture and lean together with a point too near; placeholder."""


class PathSolver:
    """One path being solved.

    Attributes:
        arm, model: The machine.
        cost: Its weights.
        aim: The path as planned and as it is solved: leaned where it must be.
        start: Joint vector the arm comes from, shape (joints,).
        obstacles, barrier, search: Surroundings, None if there are none.
        emphasis: Weight of keeping each link clear, shape (n, links).
        promise: Most clearance the whole cone of directions was seen to give [m], infinite if not looked
            at, shape (n,).
    """

    def __init__(
        self,
        arm: Arm,
        model: PathModel,
        path: SprayPath,
        payload_kg: float,
        start: Array,
        obstacles: Obstacles | None,
    ) -> None:
        self.arm, self.model, self.cost = arm, model, make_cost(arm, model)
        self.start = start
        self.aim = Aim(arm, path, payload_kg, model.far)
        self.obstacles = obstacles
        self.barrier = None if obstacles is None else make_barrier(arm, obstacles)
        self.promise, self._vain = np.full(len(path), np.inf), np.full_like(self.aim.T, np.nan)
        self.emphasis = np.zeros((len(path), 0))
        self.search: LeanSearch | None = None
        clear = arm.description.clearance
        if self.barrier is not None and clear is not None:
            limit, grid = float(np.radians(clear.tilt_limit_deg)), make_grid(arm, model)
            self.search = LeanSearch(
                arm, model, self.cost, grid, self.barrier, clear.wanted, limit, STAND_OFF, payload_kg
            )
            self.emphasis = no_emphasis(self.barrier, len(path))

    def solve(self, report: Progress) -> tuple[Array, Array]:
        """Do all steps.

        Returns:
            Joint vectors, NaN where unsolved (n, joints), and the best posture found by itself for
            every point that was unsolved on the way (n, joints), which tells why it failed.
        """
        first = FirstChain(self.arm, self.model, self.cost, self.aim.T, self.start, self.barrier)
        q = first.find(self.aim.gaps, report)
        q = self.keep_good(self.smooth(q, report, 0.5, 0.65))
        q, best = self.rescue(self.keep_least(self.keep_clear(self.keep_side(q, report), report)), report)
        if self.barrier is not None:  # points that came back by themselves have had no feedback yet
            q, again = self.rescue(self.keep_least(self.keep_clear(q, report)), report)
            best = np.where(np.isfinite(again), again, best)
            q = self.lean(q, report)
        # lone points may have come back on the other side of a stop
        settled = self._turn_back(q, report)
        q, again = self.rescue(settled, report)
        back = np.isfinite(q[:, 0]) & ~np.isfinite(settled[:, 0])
        if back.any():
            q = self._settle(q, q, report, self._beside(back))
        return self._straighten(self.lean(q, report)), np.where(np.isfinite(again), again, best)

    def _turn_back(self, q: Array, report: Progress) -> Array:
        """Tilt poses back to their side of a stop and settle, but not where a point falls short by it."""
        old = self.aim.wish
        turned = self._settle(self.keep_side(q, report), q, report)
        changed = (self.aim.tilt != old.tilt).any(axis=1)
        worse = changed & (sum_stretches(changed, self._fallen(q, turned), self.aim.gaps) > 0.0)
        if not worse.any():
            return turned
        self.aim.put_back(worse, old)
        mixed = np.where(worse[:, None], q, turned)
        return self._settle(mixed, mixed, report, self._beside(worse))

    def _beside(self, marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mark all points of the strokes that hold a marked one."""
        strokes = self.aim.strokes
        return np.isin(strokes, strokes[marked])

    def _settle(
        self, turned: Array, q: Array, report: Progress, only: NDArray[np.bool_] | None = None
    ) -> Array:
        """Smooth a last time, all strokes or those marked; what is lost by it stays as it was."""
        smoothed = self.smooth(turned, report, 0.85, 1.0, only=only)
        mine = np.ones((len(q), 1), dtype=bool) if only is None else only[:, None]
        kept = self.keep_least(self.keep_good(np.where(mine, smoothed, np.nan)))
        return patch(np.where(mine, kept, smoothed), self._follow(np.where(mine, q, np.nan)), self.aim.gaps)

    def _fallen(self, before: Array, after: Array) -> NDArray[np.bool_]:
        """Mark points that kept what is wanted before and no longer do."""
        model = self.arm.description.clearance
        if model is None or self.obstacles is None:
            return np.zeros(len(after), dtype=bool)
        enough = model.wanted - model.cell / LOW_SHARE
        return (self._free(before) >= enough) & ~(self._free(after) >= enough)

    def _straighten(self, q: Array) -> Array:
        """Put points that alone stand off their neighbours' way between them, if they keep as much there."""
        model = self.arm.description.clearance
        kept = np.minimum(self._free(q), np.inf if model is None else model.wanted)
        steep = KINK * self.model.break_cost * np.where(self.aim.cut, np.inf, self.aim.gaps)

        def keep(tried: Array) -> Array:
            tried = self.keep_least(self.keep_good(tried))
            return np.where((self._free(tried) >= kept)[:, None], tried, np.nan)

        return straighten(self.arm, self.cost.metric, self.aim.T, q, steep, keep)

    def smooth(
        self,
        q: Array,
        report: Progress,
        begin: float,
        end: float,
        rounds: int | None = None,
        only: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Smooth the chain of solved points, or only of those marked; the rest stays as it is."""
        marked = np.ones(len(q), dtype=bool) if only is None else only
        live = np.flatnonzero(marked & np.isfinite(q[:, 0]))
        if not live.size:
            return q
        rounds = rounds or self.model.smooth_rounds
        smoothed = q.copy()
        smoothed[live] = smooth_chain(
            self.arm,
            self.cost,
            self.aim.T[live],
            q[live],
            self._gaps(q[live], live),
            self.model.curvature_weight,
            rounds,
            lambda done: report(begin + (end - begin) * done / rounds),
            self._keeper(live),
        )
        return smoothed

    def _keeper(self, rows: NDArray[np.int64]) -> Keeper | None:
        return None if self.barrier is None else Keeper(self.barrier, self.emphasis[rows])

    def keep_side(self, q: Array, report: Progress) -> Array:
        """Tilt poses just beyond the stop of a joint of a full turn, where that saves going round."""
        model = self.arm.description.clearance
        full = np.flatnonzero(self.arm.upper - self.arm.lower > TURN - 1e-6)
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        if model is None or self.obstacles is None or not live.size:
            return q
        stops = ~np.isfinite(distances(self.aim.T[live], self.model.far))
        for mark in (self.aim.path.bay, self.aim.path.overbreak):
            stops[1:] |= np.diff(mark[live].astype(np.int64)) != 0
        more = np.zeros_like(self.aim.tilt)
        for i in full[~self.arm.prismatic[full]]:
            wanted, more[live] = find_seam_tilt(
                q[live, i],
                float(self.arm.lower[i]),
                float(self.arm.upper[i]),
                float(np.radians(model.tilt_limit_deg)),
                TURN / float(self.arm.max_speed[i]),
                stops,
                self.arm.jacobian(q[live])[:, 3:, i],
                self.aim.path.direction[live],
            )
            if not more.any():
                continue
            turned = q.copy()
            turned[live, i] = wanted
            mine = self._beside(more.any(axis=1) | (np.abs(turned - q).max(axis=1) > 0.0))
            self.aim.lean(more, model)
            q = self.keep_good(self.smooth(turned, report, 0.65, 0.65, FEEDBACK_SMOOTHING, mine))
        return q

    def keep_clear(self, q: Array, report: Progress) -> Array:
        """Do the rounds of collision feedback: raise weights, tilt poses, smooth, until all keep clear."""
        model, barrier = self.arm.description.clearance, self.barrier
        if model is None or barrier is None:
            return q
        least = len(q)
        for done in range(FEEDBACK_ROUNDS):
            live = np.flatnonzero(np.isfinite(q[:, 0]))
            sight = barrier.look(q[live])
            avoidable, tied = split_collisions(barrier.body, sight, model.wanted, LAST_REDUNDANT)
            short = np.zeros(len(q), dtype=bool)
            short[live] = (avoidable | tied).any(axis=1)
            if not short.any() or (done > 1 and short.sum() >= least):
                break  # all clear, or more weight does not help
            least = int(short.sum())
            self.emphasis[live] = raise_weights(self.emphasis[live], avoidable)
            pivot = self.aim.path.position[live] + STAND_OFF * self.aim.path.direction[live]
            more = np.zeros_like(self.aim.tilt)
            more[live] = find_lever(barrier.obstacles, sight, tied, pivot, model.wanted)
            self.aim.lean(more, model)
            begin, end = (0.65 + 0.1 * k / FEEDBACK_ROUNDS for k in (done, done + 1))
            q = self.keep_good(self.smooth(q, report, begin, end, FEEDBACK_SMOOTHING, self._beside(short)))
        return q

    def lean(self, q: Array, report: Progress) -> Array:
        """Look at the whole cone of spray directions for points still unsolved or too near to something.

        Where that gains nothing in a stretch, it stays as it was.
        """
        model, search = self.arm.description.clearance, self.search
        if model is None or search is None:
            return q
        before, old, old_cut = self._free(q), self.aim.wish, self.aim.cut
        low = np.minimum(model.wanted - model.cell / LOW_SHARE, self.promise - PROMISE_KEPT)
        rows = np.flatnonzero(before < low)
        if not rows.size:
            return q
        self.emphasis = self.emphasis.copy()
        self.emphasis[rows] = np.maximum(self.emphasis[rows], INSIST)
        tried = self._lean_at(search, rows, q, report)
        fallen = np.flatnonzero(self._fallen(q, tried))
        if fallen.size:  # a lean went over into points that it does not suit: they join in the choice
            self.aim.put_back(np.ones(len(q), dtype=bool), old)
            self.aim.cut = old_cut
            tried = self._lean_at(search, np.union1d(rows, fallen), q, report)
        return tried

    def _lean_at(self, search: LeanSearch, rows: NDArray[np.int64], q: Array, report: Progress) -> Array:
        """Choose leans and postures of points (m,) together with their neighbours."""
        gaps, strokes = self.aim.gaps, self.aim.strokes
        around = (rows[:, None] + np.arange(-BESIDE, BESIDE + 1)).clip(0, len(q) - 1)
        rows = np.unique(around[strokes[around] == strokes[rows][:, None]])
        near, own = nearest_solved(q, rows, self.start), np.isfinite(q[rows, 0])
        found = search.find(self.aim.planned, rows, gaps[rows], near, own, self.aim.tilt[rows])
        self.promise[rows] = found.best
        hit = np.isfinite(found.q[:, 0])
        return self._try_leans(q, rows[hit], found.q[hit], found.tilt[hit], report)

    def _try_leans(
        self, q: Array, rows: NDArray[np.int64], lean_q: Array, lean: Array, report: Progress
    ) -> Array:
        """Take postures and leans of some points over, and back again in stretches that gain nothing."""
        model = self.arm.description.clearance
        assert model is not None
        gaps, old, old_cut = self.aim.gaps, self.aim.wish, self.aim.cut
        free, steep = self._free(q), self._is_steep(q, gaps, KINK)
        mine = np.isin(np.arange(len(q)), rows)
        tried = q.copy()
        tried[rows] = lean_q
        beside = mine | np.append(False, mine[:-1])
        self.aim.cut = old_cut | (beside & self._is_cut(tried, gaps))
        self.aim.pin(rows, lean, model)
        tried = self._settle(tried, q, report, self._beside(mine))
        self.aim.cut = old_cut | (beside & self._is_cut(tried, gaps))
        kinked = self._is_steep(tried, gaps, KINK) & ~steep
        worth = [np.clip(each, -UNSOLVED, model.wanted) for each in (free, self._free(tried))]
        price = np.where(self._is_cut(tried, gaps), CUT, THROWN) * kinked
        gain = worth[1] - worth[0] - np.maximum(price, np.append(price[1:], 0.0))
        changed = mine | (self.aim.tilt != old.tilt).any(axis=1)
        worse = changed & (sum_stretches(changed, gain, gaps) <= 0.0)
        self.aim.cut = np.where(worse | np.append(False, worse[:-1]), old_cut, self.aim.cut)
        self.aim.put_back(worse, old)
        mixed = np.where(worse[:, None], q, tried)
        # points that went back beside others that stay as tried: smooth their strokes over the seam
        return self._settle(mixed, mixed, report, self._beside(worse)) if worse.any() else mixed

    def _follow(self, q: Array) -> Array:
        """Carry joints over to targets that were tilted a little since; NaN where that fails."""
        live, carried = np.flatnonzero(np.isfinite(q[:, 0])), np.full_like(q, np.nan)
        carried[live] = project_task(self.arm, self.aim.T[live], q[live], self.cost.metric)
        return self.keep_least(self.keep_good(carried))

    def _is_steep(self, q: Array, gaps: Array, share: float) -> NDArray[np.bool_]:
        """Mark steps to a point that cost more than a share of a break: another posture, or on its way."""
        step = (self.cost.metric * np.diff(q, axis=0, prepend=q[:1]) ** 2).sum(axis=1)
        return np.asarray(step > share * self.model.break_cost * gaps)

    def _is_cut(self, q: Array, gaps: Array) -> NDArray[np.bool_]:
        """Mark steps to a point of another posture: dearer than a break, or once round."""
        return self._is_steep(q, gaps, 1.0) | np.append(False, is_reroll(self.arm, q[:-1], q[1:]))

    def _free(self, q: Array) -> Array:
        """Measure what every point keeps clear [m], minus infinity where it is unsolved, shape (n,)."""
        live, free = np.isfinite(q[:, 0]), np.full(len(q), -np.inf)
        if self.obstacles is not None and live.any():
            free[live] = least_distance(self.arm, q[live], self.obstacles)
        return free

    def keep_least(self, q: Array) -> Array:
        """Set points that come nearer to anything than the least clearance to NaN."""
        model = self.arm.description.clearance
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        if model is None or self.obstacles is None or not live.size:
            return q
        kept = q.copy()
        near = ~(least_distance(self.arm, q[live], self.obstacles) >= model.least)
        kept[live[near]] = np.nan
        return kept

    def _gaps(self, x: Array, rows: NDArray[np.int64]) -> Array:
        """Distances along the chain of solved points, infinite where it cannot be continuous."""
        gaps = distances(self.aim.T[rows], self.model.far)
        gaps[1:][is_reroll(self.arm, x[:-1], x[1:])] = np.inf
        gaps[np.diff(np.cumsum(self.aim.cut)[rows], prepend=0) > 0] = np.inf
        return gaps

    def keep_good(self, q: Array) -> Array:
        """Set points that miss their target or break a limit to NaN."""
        live = np.flatnonzero(np.isfinite(q).all(axis=1))
        kept = np.full_like(q, np.nan)
        if live.size:
            miss = compute_error(self.arm, self.aim.T[live], q[live]).size
            good = live[(miss <= TASK_TOLERANCE) & self.arm.within_limits(q[live])]
            kept[good] = q[good]
        return kept

    def rescue(self, q: Array, report: Progress) -> tuple[Array, Array]:
        """Try unsolved points by themselves, no pose twice; with something in the way, on a finer grid too.

        Returns:
            Joint vectors with the rescued points filled in, and the candidates they were tried from.
        """
        best = np.full_like(q, np.nan)
        aid = Rescue(self.arm, self.model, self.cost, self.barrier, lambda done: report(0.75 + 0.1 * done))
        for refine in (1,) if self.barrier is None else (1, 2):
            failed = np.flatnonzero(~np.isfinite(q[:, 0]) & (self._vain != self.aim.T).any(axis=(1, 2)))
            if refine > 1:
                failed = failed[self.arm.within_limits(best[failed])]
            if not failed.size:
                break
            tries, best[failed] = aid.solve(self.aim.T[failed], nearest_solved(q, failed, self.start), refine)
            for k in range(tries.shape[1]):
                alone = np.full_like(q, np.nan)
                alone[failed] = np.where(np.isfinite(q[failed, :1]), np.nan, tries[:, k])
                q = np.where(np.isfinite(q), q, self.keep_least(self.keep_good(alone)))
        lost = ~np.isfinite(q[:, 0])
        self._vain[lost] = self.aim.T[lost]
        return q, best

    def find_breaks(self, q: Array) -> NDArray[np.bool_]:
        """Mark the points the arm does not reach without stopping to spray, shape (n,)."""
        breaks = np.zeros(len(q), dtype=bool)
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        gaps = distances(self.aim.T[live], self.model.far)
        needed = (np.abs(np.diff(q[live], axis=0)) / self.arm.max_speed).max(axis=1, initial=0.0)
        thrown = self._is_steep(q[live], gaps, KINK)[1:] | (np.diff(np.cumsum(self.aim.cut)[live]) > 0)
        allowed = np.where(thrown, 0.0, self.model.reroll_s)
        gaps[1:][needed > gaps[1:] / self.model.nozzle_speed + allowed] = np.inf
        breaks[live] = ~np.isfinite(gaps)
        return breaks
