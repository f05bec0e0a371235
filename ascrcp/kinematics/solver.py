"""The steps of solving a whole path: first chain, smoothing, stops, collision feedback, lone points."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import make_barrier, no_emphasis
from ascrcp.kinematics.candidate import Grid, find_candidates, find_rolls, make_grid
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
from ascrcp.kinematics.rescue import Rescue, nearest_solved
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.seam import TURN, find_seam_tilt
from ascrcp.kinematics.smooth import Keeper, make_cost, own_cost, smooth_chain
from ascrcp.kinematics.spacing import STAND_OFF, distances, find_keys
from ascrcp.kinematics.task import compute_error, project_task, spray_pose

Progress = Callable[[float], None]

ANCHORS = 24
"""Key points at which every roll is tried; elsewhere only the rolls that were of use at some anchor."""

LAST_REDUNDANT = 6
"""Last joint the redundant ones still move at a given pose: beyond, wrist and nozzle are tied to it."""

TASK_TOLERANCE = 1e-6
"""Largest miss of a solved point [m, rad]."""

REROLL = np.pi / 2
"""Step of a turning joint between neighbouring points beyond which it goes round the other way [rad]."""

FEEDBACK_ROUNDS = 4
"""Rounds of collision feedback; placeholder, the third paper needs three steps at most."""

FEEDBACK_SMOOTHING = 4
"""Smoothing rounds between them."""

FEW = 16
"""Key points with fewer candidates than this take over those of a neighbour; placeholder."""

FOLLOW_ROUNDS = 5
"""Newton rounds that carry a candidate over."""

EDGE_ROUNDS = 3
"""Choices of the chain while its edges still pass through something; placeholder."""


class PathSolver:
    """One path being solved.

    Attributes:
        arm, model: The machine.
        cost: Its weights.
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
        path: SprayPath,
        payload_kg: float,
        start: Array,
        obstacles: Obstacles | None,
    ) -> None:
        self.arm, self.model, self.cost = arm, model, make_cost(arm, model)
        self.planned = self.path = path
        self.payload_kg, self.start = payload_kg, start
        self.T = compensate(arm, spray_pose(path), payload_kg)
        self.tilt = np.zeros((len(path), 3))
        self.obstacles = obstacles
        self.barrier = None if obstacles is None else make_barrier(arm, obstacles)
        self.emphasis = np.zeros((len(path), 0))
        if self.barrier is not None:
            self.emphasis = no_emphasis(self.barrier, len(path))

    def solve(self, report: Progress) -> tuple[Array, Array]:
        """Do all steps.

        Returns:
            Joint vectors, NaN where unsolved (n, joints), and the best posture found by itself for
            every point that was unsolved on the way (n, joints), which tells why it failed.
        """
        q = self.start_chain(distances(self.T, self.model.far), report)
        q = self.keep_good(self.smooth(q, report, 0.5, 0.65))
        q, best = self.rescue(self.keep_least(self.keep_clear(self.keep_side(q, report), report)), report)
        if self.barrier is not None:  # points that came back by themselves have had no feedback yet
            q, again = self.rescue(self.keep_least(self.keep_clear(q, report)), report)
            best = np.where(np.isfinite(again), again, best)
        # lone points may have come back on the other side of a stop
        q, again = self.rescue(self._settle(self.keep_side(q, report), q, report), report)
        return q, np.where(np.isfinite(again), again, best)

    def _settle(self, turned: Array, q: Array, report: Progress) -> Array:
        """Smooth a last time; what is lost by it stays as it was, if its pose is still the same."""
        smoothed = self.keep_least(self.keep_good(self.smooth(turned, report, 0.85, 1.0)))
        spare = self.keep_least(self.keep_good(q))
        return np.where(np.isfinite(smoothed), smoothed, spare)

    def start_chain(self, distance: Array, report: Progress) -> Array:
        """Find a first chain: candidates at key points, the graph, the points between interpolated.

        Returns:
            Joint vectors, NaN between key points that have no candidate, shape (n, joints).
        """
        keys = find_keys(distance, self.model.key_spacing)
        grid = make_grid(self.arm, self.model)
        anchors = keys[np.linspace(0, len(keys) - 1, min(len(keys), ANCHORS)).astype(int)]
        rolls = find_rolls(self.arm, self.T[anchors], grid)
        grid = grid.keep(rolls) if rolls.size else grid
        report(0.1)
        layers, price = self._find_layers(keys, grid, report)
        usable = np.array([i for i, layer in enumerate(layers) if len(layer)], dtype=np.int64)
        q = np.full((len(self.T), self.arm.n), np.nan)
        if not usable.size:
            return q
        along = np.cumsum(np.where(np.isfinite(distance), distance, 0.0))
        cuts = np.cumsum(~np.isfinite(distance))
        chosen_keys = keys[usable]
        gaps = np.concatenate([[np.inf], np.maximum(np.diff(along[chosen_keys]), 1e-3)])
        gaps[1:][np.diff(cuts[chosen_keys]) > 0] = np.inf
        chosen = self._choose([layers[i] for i in usable], [price[i] for i in usable], gaps)
        report(0.5)
        self._fill_between(q, chosen_keys, chosen, usable, along, cuts)
        return q

    def _find_layers(
        self, keys: NDArray[np.int64], grid: Grid, report: Progress
    ) -> tuple[list[Array], list[Array]]:
        """Find the candidates of every key point and what each costs by itself."""
        layers: list[Array] = []
        for start in range(0, len(keys), 32):
            layers += find_candidates(self.arm, self.T[keys[start : start + 32]], grid)
            report(0.1 + 0.3 * min(1.0, (start + 32) / len(keys)))
        layers = self._enrich(layers, keys)
        price: list[Array] = []
        for i, layer in enumerate(layers):
            own = own_cost(self.arm, self.cost, layer) * self.model.key_spacing
            if self.barrier is not None and len(layer):
                near = rough_clearance(self.arm, layer, self.barrier.obstacles)
                own = own + self.barrier.weight * np.maximum(self.barrier.soft - near, 0.0) ** 2
                free = near > 0.0 if (near > 0.0).any() else near == near.max()
                layers[i], own = layer[free], own[free]
            price.append(own)
        return layers, price

    def _enrich(self, layers: list[Array], keys: NDArray[np.int64]) -> list[Array]:
        """Carry candidates over from the nearest key point that has many to one that has few.

        Where the nozzle's tilt axis turns parallel to the pitch axes (at the crown) the lance's
        inclination changes fast with theta1, and the grid meets but few of the postures there are.
        """
        size = np.array([len(layer) for layer in layers])
        rich, poor = np.flatnonzero(size >= FEW), np.flatnonzero(size < FEW)
        if not rich.size or not poor.size:
            return layers
        from_layer = rich[np.abs(rich - poor[:, None]).argmin(axis=1)]
        picks = [layers[j][np.linspace(0, size[j] - 1, FEW).astype(int)] for j in from_layer]
        T = np.repeat(self.T[keys[poor]], FEW, axis=0)
        q = project_task(self.arm, T, np.concatenate(picks), self.cost.metric, rounds=FOLLOW_ROUNDS)
        good = (compute_error(self.arm, T, q).size <= TASK_TOLERANCE) & self.arm.within_limits(q)
        enriched = list(layers)
        for k, i in enumerate(poor):
            mine = slice(k * FEW, (k + 1) * FEW)
            enriched[i] = np.concatenate([layers[i], q[mine][good[mine]]])
        return enriched

    def _choose(self, layers: list[Array], price: list[Array], gaps: Array) -> Array:
        """Choose the cheapest chain; where it would pass through something on the way, dearer ones.

        Clearance between key points is looked at half-way and only on the chain chosen: a candidate
        reached through something gets a price, and the choice is made again.
        """
        for _ in range(EDGE_ROUNDS):
            chain = find_chain(
                layers, price, np.sqrt(self.cost.metric), gaps, self.model.break_cost, self.start
            )
            chosen = np.array([layer[c] for layer, c in zip(layers, chain, strict=True)])
            if self.obstacles is None:
                break
            joined = np.flatnonzero(np.isfinite(gaps[1:]) & ~self._is_reroll(chosen[:-1], chosen[1:]))
            half = (chosen[joined] + chosen[joined + 1]) / 2.0
            hit = joined[rough_clearance(self.arm, half, self.obstacles) < 0.0] + 1
            if not hit.size:
                break
            for i in hit:
                price[i][chain[i]] += self.model.break_cost
        return chosen

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

    def keep_side(self, q: Array, report: Progress) -> Array:
        """Tilt poses just beyond the stop of a joint of a full turn, where that saves going round."""
        model = self.arm.description.clearance
        full = np.flatnonzero(self.arm.upper - self.arm.lower > TURN - 1e-6)
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        if model is None or self.obstacles is None or not live.size:
            return q
        stops = ~np.isfinite(distances(self.T[live], self.model.far))
        for mark in (self.path.bay, self.path.overbreak):
            stops[1:] |= np.diff(mark[live].astype(np.int64)) != 0
        more = np.zeros_like(self.tilt)
        for i in full[~self.arm.prismatic[full]]:
            wanted, more[live] = find_seam_tilt(
                q[live, i],
                float(self.arm.lower[i]),
                float(self.arm.upper[i]),
                float(np.radians(model.tilt_limit_deg)),
                TURN / float(self.arm.max_speed[i]),
                stops,
                self.arm.jacobian(q[live])[:, 3:, i],
                self.path.direction[live],
            )
            if not more.any():
                continue
            q = q.copy()
            q[live, i] = wanted
            self._tilt(more, model)
            q = self.keep_good(self.smooth(q, report, 0.65, 0.65, FEEDBACK_SMOOTHING))
        return q

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
            pivot = self.path.position[live] + STAND_OFF * self.path.direction[live]
            more = np.zeros_like(self.tilt)
            more[live] = find_lever(barrier.obstacles, sight, tied, pivot, model.wanted)
            self._tilt(more, model)
            begin = 0.65 + 0.1 * done / FEEDBACK_ROUNDS
            end = begin + 0.1 / FEEDBACK_ROUNDS
            q = self.keep_good(self.smooth(q, report, begin, end, FEEDBACK_SMOOTHING))
        return q

    def _tilt(self, more: Array, model: ClearanceModel) -> None:
        step, limit = np.radians(model.tilt_step_deg), np.radians(model.tilt_limit_deg)
        tilt = add_tilt(self.tilt, more, self.planned.direction, step, limit)
        strokes = np.cumsum(~np.isfinite(distances(self.T, self.model.far)))
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
        gaps = distances(T, self.model.far)
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
        """Try unsolved points by themselves; with something in the way, on a finer grid once more.

        Returns:
            Joint vectors with the rescued points filled in, and the candidates they were tried from.
        """
        best = np.full_like(q, np.nan)
        aid = Rescue(self.arm, self.model, self.cost, self.barrier, lambda done: report(0.75 + 0.1 * done))
        for refine in (1,) if self.barrier is None else (1, 2):
            failed = np.flatnonzero(~np.isfinite(q[:, 0]))
            if refine > 1:
                failed = failed[self.arm.within_limits(best[failed])]
            if not failed.size:
                break
            tries, best[failed] = aid.solve(self.T[failed], nearest_solved(q, failed, self.start), refine)
            for k in range(tries.shape[1]):
                alone = np.full_like(q, np.nan)
                alone[failed] = tries[:, k]
                alone[np.isfinite(q[:, 0])] = np.nan
                q = np.where(np.isfinite(q), q, self.keep_least(self.keep_good(alone)))
        return q, best

    def find_breaks(self, q: Array) -> NDArray[np.bool_]:
        """Mark the points the arm does not reach without stopping to spray, shape (n,)."""
        breaks = np.zeros(len(q), dtype=bool)
        live = np.flatnonzero(np.isfinite(q[:, 0]))
        gaps = distances(self.T[live], self.model.far)
        needed = (np.abs(np.diff(q[live], axis=0)) / self.arm.max_speed).max(axis=1, initial=0.0)
        gaps[1:][needed > gaps[1:] / self.model.nozzle_speed + self.model.reroll_s] = np.inf
        breaks[live] = ~np.isfinite(gaps)
        return breaks
