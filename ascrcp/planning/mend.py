"""Time a solved path and try it dry: bad points give way to their neighbours (thesis 5.3)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.dryrun import DryRun, check_sequence
from ascrcp.planning.parameter import Parameters
from ascrcp.planning.timing import TimedPath, time_path

ROUNDS = 3  # of leaving points out; what a new stroke does between its points is known only when it is timed


@dataclass(frozen=True)
class MendedPath:
    """A timed path that was tried dry.

    Attributes:
        timed: Rows, and why points were left out in timing.
        run: The last dry run; it may still hold findings.
        replaced: Points left out for rows that broke a rule beside them, each with the reason.
    """

    timed: TimedPath
    run: DryRun
    replaced: dict[int, str]


def time_and_mend(
    arm: Arm,
    path: SprayPath,
    q: Array,
    break_before: NDArray[np.bool_],
    parameters: Parameters,
    obstacles: Obstacles | None,
    payload_kg: float,
    progress: Callable[[float], None] | None = None,
) -> MendedPath:
    """Time a path and try it dry; where rows between points break a rule, leave out the nearest point.

    The stroke then runs from its neighbours on either side, as long as they are near enough to be joined.

    Args:
        arm: The arm.
        path: Planned poses, n points.
        q: Joints of each point, NaN rows where unsolved, shape (n, joints).
        break_before: Points reached by a joint move, shape (n,).
        parameters: Of timing and check.
        obstacles: The surroundings, None if not known.
        payload_kg: Concrete in the hose [kg].
        progress: Called with the fraction done.
    """
    q = q.copy()
    replaced: dict[int, str] = {}
    for number in range(ROUNDS + 1):
        tell = progress if number == 0 else None
        timed = time_path(arm, path, q, break_before, parameters.timing, obstacles, tell)
        run = check_sequence(arm, timed.sequence, parameters.check, obstacles, payload_kg)
        if not run.points or number == ROUNDS:
            break
        for point, why in run.points.items():
            replaced[point] = f"replaced by its neighbours: {why}"
            q[point] = np.nan
    return MendedPath(timed, run, replaced)
