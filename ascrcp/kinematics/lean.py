"""Search the spray directions within the tolerance for points that nothing else keeps clear or in reach.

The lever of `feedback.py` leans every point the way its nearest obstacle says, step by step. Where several
obstacles or a range's end are near, that stops short. Here the whole cone of directions is looked at: closed
form on the grid of candidates for each, and the cheapest chain of postures and leans along every stretch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier
from ascrcp.kinematics.candidate import Grid, solve_inside, spread_rolls
from ascrcp.kinematics.clearance import least_distance, rough_clearance
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.feedback import rotation_matrices, tilt_path
from ascrcp.kinematics.graph import find_chain
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.smooth import Cost, own_cost
from ascrcp.kinematics.task import find_roll, roll_pose, spray_pose

WAYS = 8
"""Directions round the planned one to lean in."""

SHARES = (0.5, 1.0)
"""Leans tried, of the largest allowed."""

BLOCK = 64
"""Points whose cones are looked at at once."""

LOOKED_AT = 96
"""Candidates of a point whose clearance is measured, the best of a rough look; placeholder."""

POLISHED = 4
"""Candidates looked at more closely where none keeps what is wanted; placeholder."""

POLISH_ROUNDS = 3
"""Times that is done, at half the steps each; placeholder."""

KEPT = 64
"""Candidates of a point that go into the chain; placeholder."""

AIMED = 0.02
"""Clearance aimed at above what is wanted [m]: smoothing gives some of it back."""

SHORT = 2.5e6
"""Price of a squared metre of clearance short of that: 2 cm weigh as much as a break."""

LEAN_COST = 1.0
"""Price of a lean to the limit beside squared seconds of travel; one half as far costs a quarter."""

LEAN_S = 60.0
"""Seconds that a radian of difference between the leans of neighbours weighs; placeholder."""

CHANGE_COST = 100.0
"""The same of a lean off the present one: the neighbours have to follow; placeholder."""


View = tuple[Array, Array, Array]
"""Candidates of a point: joints (k, joints), leans [rad] (k, 3), what they keep clear [m] (k,)."""


@dataclass(frozen=True)
class Leans:
    """What was found; rows belong to the points that were asked for.

    Attributes:
        tilt: Rotation vectors [rad], base frame, shape (m, 3).
        q: Postures, NaN where no direction has one within limits, shape (m, joints).
        best: Most clearance of any candidate [m], -inf without one, shape (m,).
    """

    tilt: Array
    q: Array
    best: Array


@dataclass(frozen=True)
class LeanSearch:
    """Looks for leans.

    Attributes:
        arm, model, cost, grid: Machine, weights and candidates.
        barrier: What is kept clear of.
        wanted: Clearance wanted [m].
        limit: Largest lean [rad].
        stand_off: Nozzle to the sprayed point, about which it leans [m].
        payload_kg: Concrete in the hose [kg], for the sag.
        seen: What the cones of points held, by their number in the plan.
    """

    arm: Arm
    model: PathModel
    cost: Cost
    grid: Grid
    barrier: Barrier
    wanted: float
    limit: float
    stand_off: float
    payload_kg: float
    seen: dict[int, View] = field(default_factory=dict)

    def find(
        self,
        path: SprayPath,
        rows: NDArray[np.int64],
        gaps: Array,
        near: Array,
        own: NDArray[np.bool_],
        tilt: Array,
    ) -> Leans:
        """Find leans and postures for points of a path.

        Args:
            path: The path as planned.
            rows: The points, rising, shape (m,).
            gaps: Distance from the point before on the path [m], infinite where the nozzle does not spray
                through from there, shape (m,).
            near: Postures to be near to, shape (m, joints).
            own: Whether these are the points' own at the present tilt, shape (m,).
            tilt: Present rotation vectors [rad], shape (m, 3).
        """
        found, q = np.zeros((len(rows), 3)), np.full((len(rows), self.arm.n), np.nan)
        new = np.array([i for i in rows.tolist() if i not in self.seen], dtype=np.int64)
        for start in range(0, len(new), BLOCK):
            self._look_round(path, new[start : start + BLOCK])
        here = self._look(path, rows, tilt[:, None], None)
        now = least_distance(self.arm, near, self.barrier.obstacles)
        here = [
            _join(here[k], (near[k : k + 1], tilt[k : k + 1], now[k : k + 1])) if own[k] else here[k]
            for k in range(len(rows))
        ]
        layers = [
            self._price(_join(self.seen[i], here[k]), near[k], tilt[k]) for k, i in enumerate(rows.tolist())
        ]
        usable = np.array([k for k, layer in enumerate(layers) if len(layer[0])], dtype=np.int64)
        cut = (np.diff(rows[usable]) > 1) | np.isinf(gaps[usable[1:]])
        for stretch in np.split(usable, 1 + np.flatnonzero(cut)):
            if not stretch.size:
                continue
            options, leans, price, _ = zip(*(layers[k] for k in stretch), strict=True)
            both = [np.hstack(pair) for pair in zip(options, leans, strict=True)]
            scale = np.concatenate([np.sqrt(self.cost.metric), np.full(3, LEAN_S)])
            begin = np.concatenate([near[stretch[0]], tilt[stretch[0]]])
            chain = find_chain(both, price, scale, gaps[stretch], self.model.break_cost, begin)
            q[stretch] = [option[c] for option, c in zip(options, chain, strict=True)]
            found[stretch] = [lean[c] for lean, c in zip(leans, chain, strict=True)]
        return Leans(found, q, np.array([layer[3].max(initial=-np.inf) for layer in layers]))

    def _look_round(self, path: SprayPath, rows: NDArray[np.int64]) -> None:
        """Look at the cone round planned points (m,) and keep what is seen: the plan does not change."""
        if not rows.size:
            return
        angles = [share * self.limit for share in SHARES]
        cones = np.stack([lean_cone(path.direction[i], angles, WAYS) for i in rows])
        straight = compensate(self.arm, spray_pose(repeat_points(path, rows, 1)), self.payload_kg)
        pose, row, _ = solve_inside(self.arm, straight, self.grid)
        seen = self._look(path, rows, cones, spread_rolls(self.grid, pose, row, len(rows)))
        for i, view in zip(rows.tolist(), seen, strict=True):
            short = len(view[2]) > 0 and view[2].max() < self.wanted + AIMED
            self.seen[i] = self._polish(path, i, view) if short else view

    def _polish(self, path: SprayPath, i: int, view: View) -> View:
        """Look more closely round a point's clearest candidates, whose grid was too coarse to keep clear."""
        spacing = [np.diff(np.unique(column))[:1] for column in self.grid.rows.T]
        steps = np.array([step[0] if len(step) else 0.0 for step in spacing])
        turn = np.pi / WAYS
        for _ in range(POLISH_ROUNDS):
            steps, turn = steps / 2.0, turn / 2.0
            q, lean, free = view
            best = (-free).argsort(kind="stable")[:POLISHED]
            near, near_lean = self._around(path, i, q[best], lean[best], steps, turn)
            kept = least_distance(self.arm, near, self.barrier.obstacles)
            clear = (-kept).argsort(kind="stable")[:POLISHED]
            view = _join(view, (near[clear], near_lean[clear], kept[clear]))
        return view

    def _around(
        self, path: SprayPath, i: int, q: Array, lean: Array, steps: Array, turn: float
    ) -> tuple[Array, Array]:
        """Find postures within limits, and their leans, a step to every side of candidates (k, joints)."""
        ways = np.array([-turn, 0.0, turn])
        sides = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3) * steps
        leans = (rotation_matrices(ways[:, None] * path.direction[i]) @ lean[:, None, :, None])[..., 0]
        flat = leans.reshape(-1, 3)
        leaned = tilt_path(repeat_points(path, np.array([i]), len(flat)), flat, self.stand_off)
        T = compensate(self.arm, spray_pose(leaned), self.payload_kg)
        source = np.repeat(q, len(ways), axis=0)
        roll = find_roll(T, self.arm.forward(source))
        pose = np.repeat(np.arange(len(T)), len(sides))
        side = np.tile(sides, (len(T), 1))
        aimed = roll_pose(T[pose], roll[pose] + side[:, 0])
        held = {5: source[pose, 4] + side[:, 1], 6: source[pose, 5] + side[:, 2]}
        at, found = self.arm.candidates_inside(aimed, held)
        return found, flat[pose[at]]

    def _look(
        self, path: SprayPath, rows: NDArray[np.int64], leans: Array, tried: NDArray[np.bool_] | None
    ) -> list[View]:
        """Find the clearest candidates of points (m,) leaned in some ways, (m, ways, 3)."""
        m, ways = leans.shape[:2]
        leaned = tilt_path(repeat_points(path, rows, ways), leans.reshape(-1, 3), self.stand_off)
        T = compensate(self.arm, spray_pose(leaned), self.payload_kg)
        mask = None if tried is None else np.repeat(tried, ways, axis=0)
        pose, _, q = solve_inside(self.arm, T, self.grid, mask)
        rough = rough_clearance(self.arm, q, self.barrier.obstacles)
        point = pose // ways
        order = np.lexsort((-rough, point))
        place = np.arange(len(order)) - np.searchsorted(point[order], point[order])
        best = order[place < LOOKED_AT]
        free = least_distance(self.arm, q[best], self.barrier.obstacles)
        ends = np.searchsorted(point[best], np.arange(1, m))
        parts = (np.split(each, ends) for each in (q[best], leans.reshape(-1, 3)[pose[best]], free))
        return list(zip(*parts, strict=True))

    def _price(self, view: View, near: Array, tilt: Array) -> tuple[Array, Array, Array, Array]:
        """Price a point's candidates and keep the best: joints, leans, prices, clearances."""
        q, lean, free = view
        price = own_cost(self.arm, self.cost, q) + LEAN_COST * (lean**2).sum(axis=1) / self.limit**2
        price += CHANGE_COST * ((lean - tilt) ** 2).sum(axis=1) / self.limit**2
        price += (self.cost.metric * (q - near) ** 2).sum(axis=1)
        price += self.barrier.weight * np.maximum(self.barrier.soft - free, 0.0) ** 2
        price += SHORT * np.maximum(self.wanted + AIMED - free, 0.0) ** 2
        best = price.argsort(kind="stable")[:KEPT]
        return q[best], lean[best], price[best], free[best]


def _join(a: View, b: View) -> View:
    return tuple(np.concatenate(pair) for pair in zip(a, b, strict=True))  # type: ignore[return-value]


def lean_cone(direction: Array, angles: Sequence[float], ways: int) -> Array:
    """Rotation vectors that lean a direction every way by each angle [rad], none first, shape (k, 3)."""
    aside = np.eye(3)[int(np.abs(direction).argmin())]
    first = np.cross(direction, aside)
    first /= np.linalg.norm(first)
    turn = 2.0 * np.pi * np.arange(ways) / ways
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(direction, first)
    return np.concatenate([np.zeros((1, 3)), *(angle * ring for angle in angles)])


def repeat_points(path: SprayPath, rows: NDArray[np.int64], count: int) -> SprayPath:
    """Return points (m,) of a path, each so many times over."""
    names = [name for name, shape in SprayPath.SHAPES.items() if shape[0] == "n"]
    return replace(path, **{name: np.repeat(getattr(path, name)[rows], count, axis=0) for name in names})
