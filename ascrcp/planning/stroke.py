"""The curve through the points of one stroke: joints and pose over the length of the path."""

import numpy as np
from scipy.interpolate import Akima1DInterpolator, PPoly

from ascrcp.core.geometry import Array, unit
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.kernel_call import as_rows, kernel
from ascrcp.kinematics.leg import keep_ranges

TURN_LEVER_M = 0.5  # a turn by 1 rad counts as this much path where the nozzle stands; placeholder
LEAST_LENGTH_M = 1e-4  # length given to a step between points that coincide
CORRECTIONS = 2  # Newton steps per row; the error falls quadratically, mm to below 0.01 mm
DAMPING = 1e-3  # keeps the correction finite in a singular pose; placeholder


class Stroke:
    """Joints and wanted pose between planned points, exact at them.

    Splines alone would let the nozzle stray from the pose by centimetres where the joint path
    bends, so the joints of rows between points are corrected onto the pose that the planned
    joints themselves interpolate. What the solver put on top of the planned pose, such as its lift
    against sag, is kept.

    Attributes:
        knots: Path length at the points [m], shape (k,).
        joints, place: Splines of joints and nozzle position over the path length.
    """

    def __init__(self, arm: Arm, q: Array, position: Array, direction: Array) -> None:
        steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
        turns = np.linalg.norm(np.diff(direction, axis=0), axis=1)
        length = np.maximum(np.maximum(steps, TURN_LEVER_M * turns), LEAST_LENGTH_M)
        self.knots = np.concatenate([[0.0], np.cumsum(length)])
        self.joints = self._spline(q)
        self.place = self._spline(position)
        self._heading = self._spline(direction)
        self._arm = arm
        T = arm.forward(q)
        self._reached_place = self._spline(T[:, :3, 3])
        self._reached_heading = self._spline(T[:, :3, 0])

    def pose(self, u: Array) -> tuple[Array, Array]:
        """Return wanted nozzle positions [m] and unit directions at path lengths (m,), both (m, 3)."""
        return np.asarray(self.place(u)), unit(self._heading(u))

    def solve(self, u: Array) -> Array:
        """Return joints at path lengths (m,) [rad, m], within the arm's ranges, shape (m, joints)."""
        q = keep_ranges(self._arm, np.asarray(self.joints(u)))
        position, direction = as_rows(self._reached_place(u)), as_rows(unit(self._reached_heading(u)))
        weight = self._arm.max_speed**2  # least effort, each joint measured by its speed
        step = kernel("task").step_onto
        for _ in range(CORRECTIONS):
            moved = step(self._arm.table, as_rows(q), position, direction, weight, DAMPING**2)
            q = keep_ranges(self._arm, moved)
        return q

    def _spline(self, values: Array) -> PPoly:
        return Akima1DInterpolator(self.knots, values, method="makima")
