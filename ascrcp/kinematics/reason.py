"""Say why a path point has no solution: the limit that stands in the way, and by how much."""

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm, JointInfo


def explain_failure(arm: Arm, solutions: Array) -> str:
    """Name the limit that the best of a point's solutions breaks.

    Args:
        arm: The arm.
        solutions: The point's real solutions over the candidate grid, limits not looked at, NaN
            where not real, shape (..., joints).

    Returns:
        One line: joint, value needed, range, by how much.
    """
    q = solutions.reshape(-1, arm.n)
    q = q[np.isfinite(q).all(axis=1)]
    if not len(q):
        return "no posture brings the nozzle to this position and direction"
    g = q @ arm.limit_matrix.T
    over = np.maximum(np.maximum(arm.limit_lower - g, g - arm.limit_upper), 0.0)
    worst = (over / (arm.limit_upper - arm.limit_lower)).max(axis=1)
    best = int(worst.argmin())
    if not worst[best] > 0.0:
        return "reachable by itself, but not kept by the solution of the path"
    share = over[best] / (arm.limit_upper - arm.limit_lower)
    i = int(share.argmax())
    return _describe(arm.joints[i], float(g[best, i]), float(over[best, i]))


def _describe(joint: JointInfo, value: float, over: float) -> str:
    quantity = " + ".join(f"q{k}" for k in joint.limit_sum) if len(joint.limit_sum) > 1 else ""
    name = f"joint {joint.number} {joint.name}" + (f" ({quantity})" if quantity else "")
    if joint.prismatic:
        what = "out of reach: " if value > joint.upper else "too near: "
        return f"{what}{name} needs {value:.2f} m, allowed {joint.lower:g}..{joint.upper:g} m ({over:.2f} m beyond)"
    value_deg, low_deg, high_deg = (float(np.degrees(x)) for x in (value, joint.lower, joint.upper))
    return (
        f"{name} needs {value_deg:.1f} deg, allowed {low_deg:g}..{high_deg:g} deg "
        f"({np.degrees(over):.1f} deg beyond)"
    )
