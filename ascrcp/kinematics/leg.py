"""One leg of a joint move: rest to rest, jerk-limited, straight in joint space, arriving together."""

from typing import Protocol

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Synchronization, Trajectory

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array


class Rates(Protocol):
    """Largest speed, acceleration and jerk of each joint, SI, shape (joints,)."""

    max_speed: Array
    max_acceleration: Array
    max_jerk: Array


def plan_leg(
    rates: Rates, start: Array, end: Array, row_s: float, speed: float, acceleration: float
) -> tuple[Array, Array]:
    """Plan one leg.

    Only ruckig's offline state-to-state call is used; its waypoints would ask a cloud service.

    Args:
        rates: The arm's limits.
        start: Joints at rest [rad, m], shape (joints,).
        end: The same at the end.
        row_s: Longest time between rows [s].
        speed: Share of each joint's largest speed, 0..1.
        acceleration: Share of its largest acceleration and jerk.

    Returns:
        Times from 0 [s] (m,) and joints (m, joints), the first row at start, the last at end.

    Raises:
        UnreachableError: No move with these limits.
    """
    if np.array_equal(start, end):
        return np.zeros(1), start[None, :].copy()
    joints = len(start)
    request = InputParameter(joints)
    request.synchronization = Synchronization.Phase
    request.current_position, request.target_position = start.tolist(), end.tolist()
    request.max_velocity = (speed * rates.max_speed).tolist()
    request.max_acceleration = (acceleration * rates.max_acceleration).tolist()
    request.max_jerk = (acceleration * rates.max_jerk).tolist()
    trajectory = Trajectory(joints)
    result = Ruckig(joints).calculate(request, trajectory)
    if result not in (Result.Working, Result.Finished):
        where = f"{np.round(start, 4).tolist()} to {np.round(end, 4).tolist()}"
        raise UnreachableError(f"no jerk-limited move from {where}: ruckig says {result}")
    duration = max(float(trajectory.duration), row_s)
    t = np.linspace(0.0, duration, max(1, int(np.ceil(duration / row_s - 1e-9))) + 1)
    q = np.array([trajectory.at_time(time)[0] for time in t.tolist()])
    q[0], q[-1] = start, end
    return t, q
