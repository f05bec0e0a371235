"""Plan a joint move: two joint vectors -> JointSequence, jerk-limited, all joints arriving together."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.config import ControlConfig
from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.leg import plan_leg


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
    arm: Mover, q_from: Sequence[float], q_to: Sequence[float], config: ControlConfig
) -> JointSequence:
    """Plan a move at rest to a pose at rest.

    When both coupled joints travel far, the near one goes first and the far one after it (thesis
    5.2.1), if the pose between lies within limits; else in the other order, else together.

    Args:
        arm: Speeds, limits and forward model.
        q_from: Joints where the move begins [rad, m], as measured.
        q_to: Joints where it ends.
        config: Shares of speed and acceleration, coupling rule.

    Returns:
        The sequence; no planned points, no spraying, the nozzle's pose by the forward model.

    Raises:
        InputError: A joint vector that is not finite or has the wrong length.
        UnreachableError: A target outside the joints' limits.
    """
    start, end = _checked(arm, q_from, "start"), _checked(arm, q_to, "target")
    if not bool(arm.within_limits(end)):
        raise UnreachableError(f"move target {np.round(end, 4).tolist()} lies outside the joints' limits")
    stops = [start, *_between(arm, start, end, config), end]
    move = config.move
    t, q = np.zeros(1), start[None, :]
    for a, b in pairwise(stops):
        leg_t, leg_q = plan_leg(arm, a, b, move.row_s, speed=move.speed, acceleration=move.acceleration)
        t = np.concatenate([t, t[-1] + leg_t[1:]])
        q = np.vstack([q, leg_q[1:]])
    T = arm.forward(q)
    return JointSequence(
        t=t,
        q=q,
        position=T[:, :3, 3],
        direction=T[:, :3, 0],
        point=np.full(len(t), -1, dtype=np.int64),
        spraying=np.zeros(len(t), dtype=np.bool_),
    )


def _checked(arm: Mover, q: Sequence[float], which: str) -> Array:
    vector = np.array(q, dtype=float)
    if vector.shape != np.shape(arm.max_speed) or not np.isfinite(vector).all():
        raise InputError(f"move {which} must be {len(arm.max_speed)} finite joints, not {vector.tolist()}")
    return vector


def _between(arm: Mover, start: Array, end: Array, config: ControlConfig) -> list[Array]:
    """Return the pose in which the coupled joints change over, none if they may move together."""
    near, far = (number - 1 for number in config.tracker.coupled)
    if not np.abs(end - start)[[near, far]].min() > np.radians(config.move.coupled_deg):
        return []
    for waits in (far, near):
        between = end.copy()
        between[waits] = start[waits]
        if bool(arm.within_limits(between)):
            return [between]
    return []
