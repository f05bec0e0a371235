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
from ascrcp.kinematics.reason import largest_excess
from ascrcp.kinematics.smooth import Cost, Keeper, smooth_chain

NEARLY = 0.25
"""Share of a range by which a lone point's candidates may leave it and still be tried."""

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

        The neighbour's posture is tried first: where the nozzle's tilt axis turns parallel to the pitch
        axes, the grid is too coarse to meet the few rolls that serve. Then, at every yaw of the grid, the
        candidate that leaves the ranges least; where several keep them the clearest, then the nearest to
        the neighbour. Each is smoothed by itself.

        Args:
            T: Targets, shape (n, 4, 4).
            neighbour: Joint vectors to be near to, shape (n, joints).
            refine: Factor by which the spacing of the grid is divided.

        Returns:
            Tries of every point, best first, not yet checked, NaN where nothing was near the ranges,
            shape (n, tries, joints); the best candidate, which tells why a point failed, (n, joints).
        """
        grid = make_grid(self.arm, self.model, refine)
        yaw = np.unique(grid.rows[:, 1], return_inverse=True)[1].reshape(-1)
        chosen = np.empty((len(T), int(yaw.max()) + 2, self.arm.n))
        chosen[:, 0] = neighbour
        for start in range(0, len(T), BLOCK):
            self.report(start / len(T))
            cut = slice(start, start + BLOCK)
            chosen[cut, 1:] = self._choose(T[cut], neighbour[cut], grid, yaw)
        excess = largest_excess(self.arm, chosen)
        tries = np.full_like(chosen, np.nan)
        point, place = np.nonzero(excess < NEARLY)
        if point.size:
            keeper = None
            if self.barrier is not None:
                keeper = Keeper(self.barrier, np.full((len(point), len(self.barrier.body.names)), INSIST))
            tries[point, place] = smooth_chain(
                self.arm,
                self.cost,
                T[point],
                chosen[point, place],
                np.full(len(point), np.inf),
                0.0,
                self.model.smooth_rounds,
                lambda _: self.report(1.0),
                keeper,
            )
        return tries, chosen[:, 1]

    def _choose(self, T: Array, neighbour: Array, grid: Grid, yaw: NDArray[np.int64]) -> Array:
        """Best candidate per yaw, by falling rank, shape (n, yaws, joints)."""
        block = solve_grid(self.arm, T, grid)
        excess = np.nan_to_num(largest_excess(self.arm, block), nan=np.inf)
        rank = FAR_OFF * (1.0 + excess)
        kept = ~(excess > 0.0)
        near_by = neighbour[:, None, None]
        travel = (self.cost.metric * (block - near_by) ** 2).sum(axis=-1)[kept]
        if self.barrier is not None:
            near = rough_clearance(self.arm, block[kept], self.barrier.obstacles)
            travel = travel + COLLIDED * np.maximum(self.barrier.soft - near, 0.0)
        rank[kept] = travel
        n, count = len(T), int(yaw.max()) + 1
        best, value = np.empty((n, count, self.arm.n)), np.empty((n, count))
        for k in range(count):
            mine = rank[:, yaw == k].reshape(n, -1)
            at = mine.argmin(axis=1)
            best[:, k] = block[:, yaw == k].reshape(n, -1, self.arm.n)[np.arange(n), at]
            value[:, k] = mine[np.arange(n), at]
        return np.take_along_axis(best, value.argsort(axis=1, kind="stable")[..., None], axis=1)


def nearest_solved(q: Array, rows: NDArray[np.int64], start: Array) -> Array:
    """Joint vectors of the solved points nearest in order to rows (m,), start if none; (m, joints)."""
    solved = np.flatnonzero(np.isfinite(q[:, 0]))
    if not solved.size:
        return np.broadcast_to(start, (len(rows), len(start)))
    after = np.searchsorted(solved, rows).clip(0, len(solved) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(rows - solved[before] <= np.abs(solved[after] - rows), before, after)
    return q[solved[nearer]]
