"""Try path points by themselves that the chain could not hold: closed form over the whole grid."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.barrier import Barrier
from ascrcp.kinematics.candidate import Grid, make_grid, solve_grid
from ascrcp.kinematics.clearance import rough_clearance
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.reason import limit_excess
from ascrcp.kinematics.smooth import Cost, Keeper, smooth_chain

NEARLY = 0.1
"""Share of a range by which a lone point's best candidate may leave it and still be tried."""

COLLIDED = 1e6
"""Rank of a metre by which a candidate comes too near, above any squared travel time [s^2/m]."""

FAR_OFF = 1e9
"""Rank of a candidate beyond the limits, above any squared travel time [s^2]."""

BLOCK = 8
"""Points whose whole candidate grid is held at once: 0.5 MB each."""

INSIST = 64.0
"""Emphasis of clearance for a point by itself: no neighbour pulls at it."""


@dataclass(frozen=True)
class Rescue:
    """Tries lone points.

    Attributes:
        arm, model, cost: Machine and weights.
        barrier: What it keeps clear of, None for nothing.
        report: Called with the share done; may raise to stop.
    """

    arm: Arm
    model: PathModel
    cost: Cost
    barrier: Barrier | None
    report: Callable[[float], None]

    def solve(self, T: Array, neighbour: Array, refine: int = 1) -> tuple[Array, Array]:
        """Solve points by themselves.

        Of a point's candidates the one that leaves the ranges least is taken; where several keep them
        the clearest, then the nearest to its neighbours. It is then smoothed by itself.

        Args:
            T: Targets, shape (n, 4, 4).
            neighbour: Joint vectors to be near to, shape (n, joints).
            refine: Factor by which the spacing of the grid is divided.

        Returns:
            Joint vectors, not yet checked, NaN where nothing was near the ranges, shape (n, joints),
            and the candidates they started from, which tell why a point failed, shape (n, joints).
        """
        grid = make_grid(self.arm, self.model, refine)
        best = np.empty((len(T), self.arm.n))
        for start in range(0, len(T), BLOCK):
            self.report(start / len(T))
            cut = slice(start, start + BLOCK)
            best[cut] = self._choose(T[cut], neighbour[cut], grid)
        excess = np.nan_to_num(limit_excess(self.arm, best).max(axis=-1, initial=0.0), nan=np.inf)
        near = np.flatnonzero(excess < NEARLY)
        alone = np.full_like(best, np.nan)
        if near.size:
            keeper = None
            if self.barrier is not None:
                keeper = Keeper(self.barrier, np.full((len(near), len(self.barrier.body.names)), INSIST))
            alone[near] = smooth_chain(
                self.arm,
                self.cost,
                T[near],
                best[near],
                np.full(len(near), np.inf),
                0.0,
                self.model.smooth_rounds,
                lambda _: self.report(1.0),
                keeper,
            )
        return alone, best

    def _choose(self, T: Array, neighbour: Array, grid: Grid) -> Array:
        block = solve_grid(self.arm, T, grid).reshape(len(T), -1, self.arm.n)
        excess = np.nan_to_num(limit_excess(self.arm, block).max(axis=-1), nan=np.inf)
        rank = FAR_OFF * (1.0 + excess)
        kept = ~(excess > 0.0)
        travel = (self.cost.metric * (block - neighbour[:, None]) ** 2).sum(axis=-1)[kept]
        if self.barrier is not None:
            near = rough_clearance(self.arm, block[kept], self.barrier.obstacles)
            travel = travel + COLLIDED * np.maximum(self.barrier.soft - near, 0.0)
        rank[kept] = travel
        chosen: Array = block[np.arange(len(T)), rank.argmin(axis=1)]
        return chosen


def nearest_solved(q: Array, rows: NDArray[np.int64], start: Array) -> Array:
    """Joint vectors of the solved points nearest in order to rows (m,), start if none; (m, joints)."""
    solved = np.flatnonzero(np.isfinite(q[:, 0]))
    if not solved.size:
        return np.broadcast_to(start, (len(rows), len(start)))
    after = np.searchsorted(solved, rows).clip(0, len(solved) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(rows - solved[before] <= np.abs(solved[after] - rows), before, after)
    return q[solved[nearer]]
