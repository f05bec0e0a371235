"""Whether points that come near to something had to: a dense search over roll, q5, q6, branches and leans."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.candidate import make_grid, solve_inside
from ascrcp.kinematics.clearance import least_distance, rough_clearance
from ascrcp.kinematics.feedback import tilt_path
from ascrcp.kinematics.lean import lean_cone, repeat_points
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.task import spray_pose

REFINE = 2
"""Each spacing of the solver's grid is divided by this."""

SHARES = (1 / 3, 2 / 3, 1.0)
"""Leans tried, of the largest the process allows."""

WAYS = 12
"""Directions to lean in."""

STAND_OFF = 1.0
"""Nozzle to the sprayed point, about which it leans [m], as in solving."""

MEASURED = 200
"""Postures of a lean whose clearance is measured, the best of a rough look."""


def find_most_clearance(arm: Arm, path: SprayPath, rows: NDArray[np.int64], obstacles: Obstacles) -> Array:
    """Search densely for the posture that keeps most clearance at planned points.

    Args:
        arm: An arm with path and clearance models.
        path: The path as planned, not as solved.
        rows: Points, shape (m,).
        obstacles: The surroundings.

    Returns:
        Most clearance found [m], -inf where no posture keeps the limits, shape (m,).
    """
    model, room = arm.description.path, arm.description.clearance
    assert model is not None and room is not None
    grid, limit = make_grid(arm, model, REFINE), float(np.radians(room.tilt_limit_deg))
    most = np.full(len(rows), -np.inf)
    for k, i in enumerate(rows.tolist()):
        leans = lean_cone(path.direction[i], [share * limit for share in SHARES], WAYS)
        leaned = tilt_path(repeat_points(path, np.array([i]), len(leans)), leans, STAND_OFF)
        for pose in compensate(arm, spray_pose(leaned)):
            q = solve_inside(arm, pose[None], grid)[2]
            best = (-rough_clearance(arm, q, obstacles)).argsort(kind="stable")[:MEASURED]
            if len(best):
                most[k] = max(most[k], float(least_distance(arm, q[best], obstacles).max()))
    return most
