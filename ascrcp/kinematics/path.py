"""Solve a whole path: SprayPath -> PathSolution, every limit kept and no joint jumping.

Candidates over theta1, q5, q6 at key points and the cheapest chain through them settle the
configuration; smoothing over all points settles the rest and keeps clear of the surroundings; collision
feedback mends what is still too near; a point that then fails is tried by itself, and what fails even so
says why. Targets are raised by the sag beforehand. `solver.py` holds the steps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.reason import explain_failure
from ascrcp.kinematics.solver import PathSolver, Progress
from ascrcp.kinematics.task import find_roll


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
    report = _rising(progress)
    solver = PathSolver(arm, model, path, payload_kg, start, obstacles)
    report(0.0)
    q, best = solver.solve(report)
    report(1.0)
    return _finish(solver, q, best)


def _rising(progress: Progress | None) -> Progress:
    """Report progress that never falls, though some steps are done twice."""
    most = 0.0

    def report(share: float) -> None:
        nonlocal most
        most = max(most, share)
        if progress is not None:
            progress(most)

    return report


def _finish(solver: PathSolver, q: Array, best: Array) -> PathSolution:
    """Say why points failed, mark the breaks, read theta1 back and measure what is kept clear."""
    arm, obstacles, n = solver.arm, solver.obstacles, len(q)
    solved = np.isfinite(q[:, 0])
    reasons = tuple(None if solved[i] else explain_failure(arm, best[i], obstacles) for i in range(n))
    theta1, free = np.full(n, np.nan), np.full(n, np.nan)
    theta1[solved] = find_roll(solver.aim.T[solved], arm.forward(q[solved]))
    if obstacles is not None and solved.any():
        free[solved] = least_distance(arm, q[solved], obstacles)
    tilt = np.linalg.norm(solver.aim.tilt, axis=1)
    return PathSolution(q, theta1, reasons, solver.find_breaks(q), solver.aim.path, tilt, free)
