"""Say why a path point has no solution: the limit in the way and by how much, or what it would hit."""

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm, JointInfo
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel
from ascrcp.kinematics.obstacle import Obstacles

NO_POSTURE = "out of reach: no posture brings the nozzle to this position and direction"
"""Reason of a point at which the closed form has no real solution anywhere on the grid."""

NOT_KEPT = "reachable only on a limit, and not kept on the way along the path"
"""Reason of a point that has a solution which the path's solution could not hold."""


def limit_excess(arm: Arm, q: Array) -> Array:
    """How far joint vectors (..., joints) leave the ranges, as shares of them; NaN stays; (..., joints)."""
    g = q @ arm.limit_matrix.T
    over = np.maximum(np.maximum(arm.limit_lower - g, g - arm.limit_upper), 0.0)
    return over / (arm.limit_upper - arm.limit_lower)


def largest_excess(arm: Arm, q: Array) -> Array:
    """Find the largest of `limit_excess`, of many; (..., joints) -> (...)."""
    find, limits = kernel("task").find_excess, (arm.limit_matrix, arm.limit_lower, arm.limit_upper)
    found: Array = by_halves(lambda rows: find(rows, *limits), as_rows(q))
    return found.reshape(q.shape[:-1])


def explain_failure(arm: Arm, q: Array, obstacles: Obstacles | None = None) -> str:
    """Name the limit that a point's least bad solution breaks, or what it would hit.

    Args:
        arm: The arm.
        q: The real solution that leaves the ranges least, NaN if there is none, shape (joints,).
        obstacles: The surroundings, if they were looked at.

    Returns:
        One line: joint, value needed, range, by how much; or link, obstacle, distance, place.
    """
    if not np.isfinite(q).all():
        return NO_POSTURE
    share = limit_excess(arm, q)
    i = int(share.argmax())
    if not share[i] > 0.0:
        return NOT_KEPT if obstacles is None else _describe_hit(arm, q, obstacles)
    joint = arm.joints[i]
    return _describe(joint, float(arm.limit_matrix[i] @ q), float(share[i]) * (joint.upper - joint.lower))


def _describe_hit(arm: Arm, q: Array, obstacles: Obstacles) -> str:
    """Say what the point's best posture is near to; that it was not kept if it keeps clear."""
    model, near = arm.description.clearance, clearance(arm, q, obstacles)
    if model is None or near.distance[0] >= model.least:
        return NOT_KEPT
    return f"would hit: {near.describe(arm, 0)}, at least {model.least:g} m is kept"


def _describe(joint: JointInfo, value: float, over: float) -> str:
    quantity = " + ".join(f"q{k}" for k in joint.limit_sum) if len(joint.limit_sum) > 1 else ""
    name = f"joint {joint.number} {joint.name}" + (f" ({quantity})" if quantity else "")
    if joint.prismatic:
        what = "out of reach: " if value > joint.upper else "too near: "
        allowed = f"{joint.lower:g}..{joint.upper:g} m"
        return f"{what}{name} needs {value:.2f} m, allowed {allowed} ({over:.2f} m beyond)"
    value_deg, low_deg, high_deg = (float(np.degrees(x)) for x in (value, joint.lower, joint.upper))
    allowed = f"{low_deg:g}..{high_deg:g} deg"
    return f"{name} needs {value_deg:.1f} deg, allowed {allowed} ({np.degrees(over):.1f} deg beyond)"
