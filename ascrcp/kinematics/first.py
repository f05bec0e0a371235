"""The first chain of a path: candidates at key points, the cheapest way through, interpolation between."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier
from ascrcp.kinematics.candidate import Grid, find_candidates, find_rolls, make_grid
from ascrcp.kinematics.clearance import rough_clearance
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.graph import find_chain
from ascrcp.kinematics.smooth import Cost, own_cost
from ascrcp.kinematics.spacing import find_keys
from ascrcp.kinematics.task import compute_error, project_task

Progress = Callable[[float], None]

ANCHORS = 24
"""Key points at which every roll is tried; elsewhere only the rolls that were of use at some anchor."""

TASK_TOLERANCE = 1e-6
"""Largest miss of a solved point [m, rad]."""

REROLL = np.pi / 2
"""Step of a turning joint between neighbouring points beyond which it goes round the other way [rad]."""

FEW = 16
"""Key points with fewer candidates than this take over those of a neighbour; placeholder."""

FOLLOW_ROUNDS = 5
"""Newton rounds that carry a candidate over."""

EDGE_ROUNDS = 3
"""Choices of the chain while its edges still pass through something; placeholder."""


def is_reroll(arm: Arm, a: Array, b: Array) -> NDArray[np.bool_]:
    """Tell where a turning joint goes round instead of along: no smoothing can join these."""
    step = np.abs(b - a)
    return np.asarray((step[..., ~arm.prismatic] > REROLL).any(axis=-1))


@dataclass(frozen=True)
class FirstChain:
    """Settles the configuration of a whole path.

    Attributes:
        arm, model, cost: Machine and weights.
        T: Poses, theta1 = 0, shape (n, 4, 4).
        start: Joint vector the arm comes from, shape (joints,).
        barrier: What is kept clear of, None for nothing.
    """

    arm: Arm
    model: PathModel
    cost: Cost
    T: Array
    start: Array
    barrier: Barrier | None

    def find(self, distance: Array, report: Progress) -> Array:
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
        price = [own_cost(self.arm, self.cost, layer) * self.model.key_spacing for layer in layers]
        if self.barrier is None:
            return layers, price
        ends = np.cumsum([len(layer) for layer in layers])[:-1]
        rough = rough_clearance(self.arm, np.concatenate(layers), self.barrier.obstacles)
        for i, near in enumerate(np.split(rough, ends)):
            if not len(near):
                continue
            own = price[i] + self.barrier.weight * np.maximum(self.barrier.soft - near, 0.0) ** 2
            free = near > 0.0 if (near > 0.0).any() else near == near.max()
            layers[i], price[i] = layers[i][free], own[free]
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
            if self.barrier is None:
                break
            joined = np.flatnonzero(np.isfinite(gaps[1:]) & ~is_reroll(self.arm, chosen[:-1], chosen[1:]))
            half = (chosen[joined] + chosen[joined + 1]) / 2.0
            hit = joined[rough_clearance(self.arm, half, self.barrier.obstacles) < 0.0] + 1
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
            elif bool(is_reroll(self.arm, chosen[i], chosen[i + 1])):
                share = np.round(share)
            q[inner] = chosen[i] + share[:, None] * (chosen[i + 1] - chosen[i])
