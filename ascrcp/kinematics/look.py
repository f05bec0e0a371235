"""Where the lidar looks behind arches and rims: Arm + Obstacles -> a second scan pose.

From the scan pose, outside the heading, the far sides of arches and of deep pockets are hidden. Drawn out
into the heading the lidar sees them square.
"""

import numpy as np

from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles

STEP_M = 0.05  # between postures looked at on the way
LEAST_M = 0.5  # a look from nearer to the scan pose shows hardly more; placeholder


def find_look_pose(arm: Arm, obstacles: Obstacles, surface: Surface) -> Array | None:
    """Draw the lidar's telescope out of the scan pose, to the middle of the heading or as far as is clear.

    Args:
        arm: An arm with a clearance model, its lidar behind a telescope.
        obstacles: What the newest scan saw.
        surface: The heading, recognised: where the part to be sprayed lies.

    Returns:
        The posture [rad, m], shape (joints,); None if it would lie too near to the scan pose, or if the
        lidar sits on no telescope.
    """
    mount, model = arm.description.lidar, arm.description.clearance
    if mount is None or model is None or not arm.prismatic[mount.joint - 1]:
        return None
    i = mount.joint - 1
    T = inverse_transform(surface.axis.T_base_tunnel)
    station = float(apply_transform(T, arm.lidar(arm.zero_pose)[:3, 3])[0])
    most = min(float(np.mean(surface.unsprayed)) - station, float(arm.upper[i] - arm.zero_pose[i]))
    if not most >= LEAST_M:
        return None
    q = np.repeat(arm.zero_pose[None], int(most / STEP_M + 1e-9) + 1, axis=0)
    q[:, i] += STEP_M * np.arange(len(q))
    clear = least_distance(arm, q, obstacles) >= model.wanted
    last = int(np.argmin(clear)) - 1 if not clear.all() else len(q) - 1
    return np.asarray(q[last]) if last * STEP_M >= LEAST_M - 1e-9 else None
