"""Legs of a joint move: rest to rest, jerk-limited, straight in joint space, arriving together."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Trajectory

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm


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
    # one motion for all joints: ruckig's phase synchronisation leaves the straight line now and then
    share = np.abs(end - start) / rates.max_speed
    length = float(share.max())
    part = np.maximum(share / length, 1e-12) * rates.max_speed
    request = InputParameter(1)
    request.current_position, request.target_position = [0.0], [length]
    request.max_velocity = [speed]
    request.max_acceleration = [acceleration * float((rates.max_acceleration / part).min())]
    request.max_jerk = [acceleration * float((rates.max_jerk / part).min())]
    trajectory = Trajectory(1)
    result = Ruckig(1).calculate(request, trajectory)
    if result not in (Result.Working, Result.Finished):
        where = f"{np.round(start, 4).tolist()} to {np.round(end, 4).tolist()}"
        raise UnreachableError(f"no jerk-limited move from {where}: ruckig says {result}")
    duration = max(float(trajectory.duration), row_s)
    t = np.linspace(0.0, duration, max(1, int(np.ceil(duration / row_s - 1e-9))) + 1)
    done = np.array([trajectory.at_time(time)[0][0] for time in t.tolist()]) / length
    q = start + done[:, None] * (end - start)
    q[0], q[-1] = start, end
    return t, q


def plan_legs(
    rates: Rates, stops: Sequence[Array], row_s: float, speed: float, acceleration: float
) -> tuple[Array, Array]:
    """Join legs from stop to stop, at rest at each; see plan_leg.

    Args:
        rates: The arm's limits.
        stops: Joints [rad, m], each of shape (joints,).
        row_s: Longest time between rows [s].
        speed: Share of each joint's largest speed, 0..1.
        acceleration: Share of its largest acceleration and jerk.

    Returns:
        Times from 0 [s] (m,) and joints (m, joints), the first row at the first stop, the last at the last.

    Raises:
        UnreachableError: No move with these limits.
    """
    t, q = np.zeros(1), np.array(stops[0])[None]
    for start, end in pairwise(stops):
        leg_t, leg_q = plan_leg(rates, start, end, row_s, speed, acceleration)
        t = np.concatenate([t, t[-1] + leg_t[1:]])
        q = np.concatenate([q, leg_q[1:]])
    return t, q


def keep_ranges(arm: Arm, q: Array) -> Array:
    """Bring joints (..., joints) that were carried past an end of their range back onto it."""
    limited = np.clip(q @ arm.limit_matrix.T, arm.limit_lower, arm.limit_upper)
    return np.asarray(limited @ np.linalg.inv(arm.limit_matrix).T)
