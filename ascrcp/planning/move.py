"""Joint moves between strokes: from rest to rest, jerk-limited, clear of everything on the way."""

from collections.abc import Sequence

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.leg import keep_ranges, plan_legs
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.route import find_route
from ascrcp.planning.parameter import TimingParameters

DIP_M = 0.10  # how far below the lower end of a move its nozzle may come; placeholder
LIFTS_M = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)  # heights tried for the middle of a move that would dip


def plan_move(
    arm: Arm,
    start: Array,
    end: Array,
    parameters: TimingParameters,
    obstacles: Obstacles | None = None,
    trails: Sequence[Array] = (),
) -> tuple[float, Array, Array]:
    """Move in joint space, straight or through postures that keep clear of the surroundings.

    Where these are not known, over a raised middle if a straight move would dip: a nozzle that rolls
    round beside the floor swings through the lowest point of its circle; the ends of the move were
    planned clear of the floor, its middle was not.

    Args:
        arm: For its forward model, Jacobian and limits.
        start: Joints at rest [rad, m], shape (joints,).
        end: The same at the end.
        parameters: Shares of speed, acceleration and jerk; longest time between rows.
        obstacles: The surroundings, None if they are not known.
        trails: Ways known to be clear, from an end of the move onwards, each (m, joints); see find_route.

    Returns:
        Duration [s], times of the rows strictly between start and end, their joints (m, joints).

    Raises:
        UnreachableError: No move with these limits, or none found that keeps clear.
    """
    if obstacles is None:
        return _plan_above(arm, start, end, parameters)
    return _chain(arm, [start, *find_route(arm, start, end, obstacles, trails=trails), end], parameters)


def _plan_above(
    arm: Arm, start: Array, end: Array, parameters: TimingParameters
) -> tuple[float, Array, Array]:
    """Move straight, or over the first raised middle that does not dip, else over the highest way."""
    lowest_allowed = float(arm.forward(np.stack([start, end]))[:, 2, 3].min()) - DIP_M
    best = _chain(arm, [start, end], parameters)
    best_lowest = _lowest(arm, best[2])
    for lift in LIFTS_M:
        if best_lowest >= lowest_allowed:
            break
        move = _chain(arm, [start, _raised(arm, (start + end) / 2.0, lift), end], parameters)
        lowest = _lowest(arm, move[2])
        if lowest > best_lowest:
            best, best_lowest = move, lowest
    return best


def _raised(arm: Arm, q: Array, lift: float) -> Array:
    """Raise the nozzle by `lift` [m] with the least effort, each joint measured by its speed."""
    up = arm.jacobian(q)[2]
    effort = arm.max_speed**2 * up
    raised = q + lift * effort / float(up @ effort) if float(up @ effort) > 0.0 else q
    return keep_ranges(arm, raised)


def _lowest(arm: Arm, q: Array) -> float:
    return float(arm.forward(q)[:, 2, 3].min()) if len(q) else np.inf


def _chain(arm: Arm, stops: list[Array], parameters: TimingParameters) -> tuple[float, Array, Array]:
    """Join straight legs from stop to stop; rows strictly between the first and the last."""
    share = parameters.move_fraction
    t, q = plan_legs(arm, stops, parameters.row_s, speed=share, acceleration=share)
    return float(t[-1]), t[1:-1], q[1:-1]
