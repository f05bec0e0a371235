"""Search the spray directions within the tolerance for points that nothing else keeps clear or in reach.

The lever of `feedback.py` leans every point the way its nearest obstacle says, step by step. Where several
obstacles or a range's end are near, that stops short. Here the whole cone of directions is looked at: closed
form on the grid of candidates for each, and the cheapest chain of postures and leans along every stretch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier
from ascrcp.kinematics.candidate import Grid, solve_grid
from ascrcp.kinematics.clearance import clearance, rough_clearance
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.feedback import tilt_path
from ascrcp.kinematics.graph import find_chain
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.smooth import Cost, own_cost
from ascrcp.kinematics.task import spray_pose

WAYS = 8
"""Directions round the planned one to lean in."""

SHARES = (0.5, 1.0)
"""Leans tried, of the largest allowed."""

LOOKED_AT = 96
"""Candidates of a point whose clearance is measured, the best of a rough look; placeholder."""

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
        layers = [self._candidates(path, int(i), near[k], bool(own[k]), tilt[k]) for k, i in enumerate(rows)]
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

    def _candidates(
        self, path: SprayPath, i: int, near: Array, own: bool, tilt: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Find a point's candidates (k, joints), leans (k, 3), what each costs and keeps clear, (k,)."""
        leans = np.concatenate(
            [tilt[None], lean_cone(path.direction[i], [share * self.limit for share in SHARES], WAYS)]
        )
        leaned = tilt_path(repeat_point(path, i, len(leans)), leans, self.stand_off)
        found = solve_grid(self.arm, compensate(self.arm, spray_pose(leaned), self.payload_kg), self.grid)
        inside = self.arm.within_limits(found)
        q, lean = found[inside], leans[np.nonzero(inside)[0]]
        rough = rough_clearance(self.arm, q, self.barrier.obstacles)
        first = (-rough).argsort(kind="stable")[:LOOKED_AT]
        q, lean = q[first], lean[first]
        if own:
            q, lean = np.concatenate([q, near[None]]), np.concatenate([lean, tilt[None]])
        free = clearance(self.arm, q, self.barrier.obstacles).distance
        price = own_cost(self.arm, self.cost, q) + LEAN_COST * (lean**2).sum(axis=1) / self.limit**2
        price += CHANGE_COST * ((lean - tilt) ** 2).sum(axis=1) / self.limit**2
        price += (self.cost.metric * (q - near) ** 2).sum(axis=1)
        price += self.barrier.weight * np.maximum(self.barrier.soft - free, 0.0) ** 2
        price += SHORT * np.maximum(self.wanted + AIMED - free, 0.0) ** 2
        best = price.argsort(kind="stable")[:KEPT]
        return q[best], lean[best], price[best], free[best]


def lean_cone(direction: Array, angles: Sequence[float], ways: int) -> Array:
    """Rotation vectors that lean a direction every way by each angle [rad], none first, shape (k, 3)."""
    aside = np.eye(3)[int(np.abs(direction).argmin())]
    first = np.cross(direction, aside)
    first /= np.linalg.norm(first)
    turn = 2.0 * np.pi * np.arange(ways) / ways
    ring = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * np.cross(direction, first)
    return np.concatenate([np.zeros((1, 3)), *(angle * ring for angle in angles)])


def repeat_point(path: SprayPath, i: int, count: int) -> SprayPath:
    """Return one point of a path so many times over."""
    names = [name for name, shape in SprayPath.SHAPES.items() if shape[0] == "n"]
    return replace(path, **{name: np.repeat(getattr(path, name)[i : i + 1], count, axis=0) for name in names})
