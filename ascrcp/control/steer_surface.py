"""Walk on a SteerPlan: a place (row, column) -> pose and joints, and how far it goes on from there."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.steer_plan import SteerPlan
from ascrcp.control.steer_pose import find_joints
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm

ON_ROW = 1e-3
"""A place this near to a row, in rows, stands on it."""

DIFFERENCE = 1e-3
"""Step for the surface's own slopes, in columns and rows."""


@dataclass(frozen=True, slots=True)
class Spot:
    """A place on the surface.

    Attributes:
        row: 0..rows - 1, whole on a pass.
        column: 0..columns - 1.
    """

    row: float
    column: float


class Slopes(NamedTuple):
    """Way of the nozzle [m].

    Attributes:
        along: Per column.
        up: Per row to the next pass, 0 where there is none.
        down: Per row to the pass before.
    """

    along: float
    up: float
    down: float

    def of(self, axis: int, speed: float) -> float:
        """Return the one that counts for a speed on an axis, 0 along, 1 across."""
        if axis == 0:
            return self.along
        return self.up if speed > 0.0 else self.down


class SteerSurface:
    """Smooth pose and joints between the nodes: cubic along a pass, linear across."""

    def __init__(self, plan: SteerPlan, arm: Arm, payload_kg: float = 0.0, turn_m: float = 1.0) -> None:
        """Args: turn_m: way of the nozzle that counts like a turn of the direction by one radian [m]."""
        self.plan = plan
        self._turn_m = turn_m
        self._arm, self._payload = arm, payload_kg
        self._values = np.concatenate([plan.q, plan.position, plan.direction], axis=-1)
        self._n = arm.n
        self._node_run = _runs(plan.node)
        self._cross_run = _runs(plan.cross)

    def pose(self, spot: Spot) -> tuple[Array, Array]:
        """Return nozzle position [m] and unit spray direction at a place."""
        values = self._at(spot)[self._n :]
        return values[:3], values[3:] / math.sqrt(float(values[3:] @ values[3:]))

    def joints(self, spot: Spot) -> tuple[Array, float]:
        """Return the joints that reach the pose of a place, and what they miss of it [m + rad].

        They depend on the place alone: whoever comes back finds the arm as it was.
        """
        position, direction = self.pose(spot)
        first = self._at(spot)[: self._n]
        q, miss = find_joints(self._arm, first, position, direction, self._payload)
        return q, float(miss)

    def mesh_joints(self, spot: Spot) -> Array:
        """Return the joints between the nodes without correction: near enough for rates, shape (joints,)."""
        return self._at(spot)[: self._n]

    def slopes(self, spot: Spot) -> "Slopes":
        """Return the nozzle's way per column and per row at a place [m].

        Where the direction turns much on a short way, the turn counts instead.
        """
        last = self.plan.node.shape[1] - 1
        column = min(max(spot.column, DIFFERENCE), last - DIFFERENCE)
        a, b = (self._at(Spot(spot.row, column + s * DIFFERENCE))[self._n :] for s in (-1, 1))
        on_row = abs(spot.row - round(spot.row)) <= ON_ROW
        above = round(spot.row) if on_row else math.floor(spot.row)
        j = round(spot.column)
        return Slopes(
            self._way(a, b) / (2 * DIFFERENCE),
            self._gap(above, j),
            self._gap(above - 1 if on_row else above, j),
        )

    def _gap(self, row: int, column: int) -> float:
        """Way from a row to the next [m]; 0 where none may be gone."""
        if not 0 <= row < len(self.plan.cross) or not self.plan.cross[row, column]:
            return 0.0
        return self._way(self._values[row, column, self._n :], self._values[row + 1, column, self._n :])

    def _way(self, a: Array, b: Array) -> float:
        """Way between two poses (6,): of the nozzle, or of the turn if that is more [m]."""
        d = (b - a).tolist()
        way, turn = math.hypot(*d[:3]), self._turn_m * math.hypot(*d[3:])
        return turn if turn > way else way

    def is_free(self, spot: Spot) -> bool:
        """Whether a place is steerable."""
        run = self._run(spot.row)
        return run is not None and _reach(run, spot.column, 1) >= 0.0

    def free_along(self, spot: Spot, sign: int) -> float:
        """Return how far it goes on along the pass, in columns; below 0 where the place itself is none."""
        run = self._run(spot.row)
        return -1.0 if run is None else _reach(run, spot.column, sign)

    def free_across(self, spot: Spot, sign: int) -> float:
        """Return how far it goes on across the passes, in rows."""
        columns = {math.floor(spot.column + 1e-9), math.ceil(spot.column - 1e-9)}
        row = spot.row
        if abs(row - round(row)) <= ON_ROW:
            row = round(row)
        gap = math.floor(row) if sign > 0 else math.ceil(row) - 1
        while 0 <= gap < len(self.plan.cross) and all(self.plan.cross[gap, j] for j in columns):
            gap += sign
        return max(0.0, gap - row if sign > 0 else row - gap - 1)

    def rows_beside(self, spot: Spot) -> tuple[int, int]:
        """Return the rows below and above a place."""
        return math.floor(spot.row), math.ceil(spot.row)

    def nearest_point(self, spot: Spot) -> int:
        """Return the planned point nearest to a place, -1 if none."""
        return int(self.plan.point[round(spot.row), round(spot.column)])

    def _run(self, row: float) -> NDArray[np.int64] | None:
        """Return the first and last column of the run each column lies in, shape (a, 2), -1 outside."""
        k = round(row)
        if abs(row - k) <= ON_ROW:
            return self._node_run[k]
        k = math.floor(row)
        return self._cross_run[k] if 0 <= k < len(self._cross_run) else None

    def _at(self, spot: Spot) -> Array:
        k = round(spot.row)
        if abs(spot.row - k) <= ON_ROW:
            return self._along(k, spot.column)
        k = math.floor(spot.row)
        share = spot.row - k
        return (1.0 - share) * self._along(k, spot.column) + share * self._along(k + 1, spot.column)

    def _along(self, row: int, column: float) -> Array:
        """Cubic through four nodes of a row (Catmull and Rom); linear slopes at the end of a run."""
        values = self._values[row]
        last = len(values) - 1
        j = min(int(column), last - 1)
        share = column - j
        b = values[j]
        if share < 1e-9:
            return b
        c = values[j + 1]
        if share > 1.0 - 1e-9:
            return c
        rise = c - b
        before = values[j - 1] if j > 0 else b
        after = values[j + 2] if j + 2 <= last else c
        m0 = 0.5 * (c - before) if j > 0 and before[0] == before[0] else rise
        m1 = 0.5 * (after - b) if j + 2 <= last and after[0] == after[0] else rise
        s2 = share * share
        s3 = s2 * share
        return np.asarray(
            b + (3 * s2 - 2 * s3) * rise + (s3 - 2 * s2 + share) * m0 + (s3 - s2) * m1, dtype=float
        )


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Find for every cell of a row the ends of the run of true cells it lies in, shape (r, a, 2)."""
    found = np.full((*mask.shape, 2), -1, np.int64)
    for row, cells in enumerate(mask):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], cells, [False]]).astype(np.int8)))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            found[row, first:end] = first, end - 1
    return found


def _reach(run: NDArray[np.int64], column: float, sign: int) -> float:
    low, high = run[min(max(math.floor(column + 1e-9), 0), len(run) - 1)]
    if low < 0 or column > high + 1e-9:
        return -1.0
    return max(0.0, high - column if sign > 0 else column - low)
