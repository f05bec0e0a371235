"""Plan a joint move: two joint vectors -> JointSequence, jerk-limited, all joints arriving together."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.config import ControlConfig
from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.leg import plan_legs


class Mover(Protocol):
    """What a move needs to know of the arm."""

    max_speed: Array
    max_acceleration: Array
    max_jerk: Array

    def forward(self, q: Array) -> Array:
        """Compute T_base_tool (..., 4, 4) of joint vectors (..., n)."""
        ...

    def within_limits(self, q: Array) -> NDArray[np.bool_]:
        """Return whether joint vectors (..., n) lie within their ranges."""
        ...


def plan_move(
    arm: Mover,
    q_from: Sequence[float],
    q_to: Sequence[float],
    config: ControlConfig,
    between: Sequence[Array] | None = None,
) -> JointSequence:
    """Plan a move at rest to a pose at rest.

    Args:
        arm: Speeds, limits and forward model.
        q_from: Joints where the move begins [rad, m], as measured.
        q_to: Joints where it ends.
        config: Shares of speed and acceleration, coupling rule.
        between: Postures to pass through at rest, as a route around obstacles gives; None for those of
            the coupling rule.

    Returns:
        The sequence; no planned points, no spraying, the nozzle's pose by the forward model.

    Raises:
        InputError: A joint vector that is not finite or has the wrong length.
        UnreachableError: A target outside the joints' limits.
    """
    start, end = check_ends(arm, q_from, q_to)
    stops = [start, *(find_changeover(arm, start, end, config) if between is None else between), end]
    move = config.move
    t, q = plan_legs(arm, stops, move.row_s, speed=move.speed, acceleration=move.acceleration)
    T = arm.forward(q)
    return JointSequence(
        t=t,
        q=q,
        position=T[:, :3, 3],
        direction=T[:, :3, 0],
        point=np.full(len(t), -1, dtype=np.int64),
        spraying=np.zeros(len(t), dtype=np.bool_),
    )


def check_ends(arm: Mover, q_from: Sequence[float], q_to: Sequence[float]) -> tuple[Array, Array]:
    """Return both ends of a move as arrays.

    Raises:
        InputError: A joint vector that is not finite or has the wrong length.
        UnreachableError: A target outside the joints' limits.
    """
    start, end = _checked(arm, q_from, "start"), _checked(arm, q_to, "target")
    if not bool(arm.within_limits(end)):
        raise UnreachableError(f"move target {np.round(end, 4).tolist()} lies outside the joints' limits")
    return start, end


def _checked(arm: Mover, q: Sequence[float], which: str) -> Array:
    vector = np.array(q, dtype=float)
    if vector.shape != np.shape(arm.max_speed) or not np.isfinite(vector).all():
        raise InputError(f"move {which} must be {len(arm.max_speed)} finite joints, not {vector.tolist()}")
    return vector


def find_changeover(arm: Mover, start: Array, end: Array, config: ControlConfig) -> list[Array]:
    """Find the pose in which the coupled joints change over, none if they may move together.

    When both travel far, the near one goes first and the far one after it (thesis 5.2.1), if the pose
    between lies within limits; else in the other order, else together.
    """
    near, far = (number - 1 for number in config.tracker.coupled)
    if not np.abs(end - start)[[near, far]].min() > np.radians(config.move.coupled_deg):
        return []
    for waits in (far, near):
        between = end.copy()
        between[waits] = start[waits]
        if bool(arm.within_limits(between)):
            return [between]
    return []
