"""Where a joint of a full turn meets its stop along a path: stay on one side by a small tilt.

Joint 7 of kc cannot turn through its 0/360 degree stop. Wall normals vary, so that points beside the stop
would ask it to go round and back, twelve seconds each time. A pose that lies a few degrees beyond the stop
is tilted back to it instead, where the process allows that much and it saves such a turn.
"""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array

TURN = 2.0 * np.pi

HOLD_BACK = np.radians(0.5)
"""How far inside the stop a tilted pose is brought [rad]."""

TILT_S = 1.0
"""A pose tilted to the limit counts as this many seconds, one tilted half as far a quarter; placeholder."""

FREE_SHARE = 0.5
"""Share of a turn's time that counts where the arm stops spraying anyway: the other joints move too;
placeholder."""


def choose_turns(
    angle: Array, lower: float, upper: float, limit: float, turn_s: float, stops: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Choose on which side of its stop a joint passes every point: the cheapest chain of turns.

    Args:
        angle: The joint's angle followed without its stops [rad], shape (n,).
        lower, upper: Its range [rad].
        limit: Largest angle by which a pose may be brought back into the range [rad].
        turn_s: Time of going round once [s].
        stops: Whether the arm stops spraying before a point anyway, shape (n,).

    Returns:
        Whole turns to add to `angle` at each point, shape (n,).
    """
    low = int(np.floor((lower - angle.max()) / TURN))
    high = int(np.ceil((upper - angle.min()) / TURN))
    turns = np.arange(low, high + 1)
    value = angle[:, None] + TURN * turns
    beyond = np.maximum(np.maximum(lower - value, value - upper), 0.0)
    price = np.where(beyond <= limit, TILT_S * (beyond / max(limit, 1e-9)) ** 2, np.inf)
    change = turn_s * np.abs(turns[:, None] - turns)
    total = price[0]
    came_from = np.zeros(price.shape, dtype=np.int64)
    for i in range(1, len(angle)):
        reach = total[None, :] + (FREE_SHARE * change if stops[i] else change)
        came_from[i] = reach.argmin(axis=1)
        total = reach.min(axis=1) + price[i]
    chosen = np.empty(len(angle), dtype=np.int64)
    chosen[-1] = int(total.argmin())
    for i in range(len(angle) - 1, 0, -1):
        chosen[i - 1] = came_from[i][chosen[i]]
    return np.asarray(turns[chosen])


def find_seam_tilt(
    angle: Array,
    lower: float,
    upper: float,
    limit: float,
    turn_s: float,
    stops: NDArray[np.bool_],
    axis: Array,
    direction: Array,
) -> tuple[Array, Array]:
    """Find the tilts that keep a joint on its side of the stop.

    Args:
        angle: Angles of the joint along the chain of solved points [rad], shape (n,).
        lower, upper, limit, turn_s, stops: As for `choose_turns`.
        axis: The joint's axis in the base frame, shape (n, 3).
        direction: Spray directions, shape (n, 3).

    Returns:
        The joint's angles after the tilt [rad], shape (n,), and rotation vectors of the spray
        directions [rad], zero where nothing changes, shape (n, 3).
    """
    followed = np.unwrap(angle)
    if not (np.abs(angle - followed) > np.pi).any():
        return angle, np.zeros((len(angle), 3))
    turns = choose_turns(followed, lower, upper, limit, turn_s, stops)
    value = followed + TURN * turns
    kept = np.clip(value, lower, upper)
    beyond = np.abs(value - kept) > 1e-9
    wanted = np.where(beyond, np.clip(value, lower + HOLD_BACK, upper - HOLD_BACK), kept)
    back = wanted - value
    # the direction moves on a cone about the axis; only its own change counts, not the roll
    s, c = np.sin(back)[:, None], np.cos(back)[:, None]
    along = (axis * direction).sum(axis=1, keepdims=True)
    turned = c * direction + s * np.cross(axis, direction) + (1.0 - c) * along * axis
    lever = np.cross(direction, turned)
    size = np.linalg.norm(lever, axis=1, keepdims=True)
    amount = np.arctan2(size, (direction * turned).sum(axis=1, keepdims=True))
    tilt = np.where(beyond[:, None] & (size > 1e-12), amount * lever / np.maximum(size, 1e-12), 0.0)
    return wanted, tilt
