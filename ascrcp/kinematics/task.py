"""The spray task: a nozzle position and a spray direction, with the roll about it left free (eq. 4-5)."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array, rotation, transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel


def spray_pose(path: SprayPath, theta1: float | Array = 0.0) -> Array:
    """Build the planned poses: R_base_tunnel Rot(x, theta3) Rot(z, theta2) Rot(x, theta1).

    Args:
        path: The planned path, n points.
        theta1: Free roll about the spray direction [rad], scalar or (n,).

    Returns:
        T_base_tool, shape (n, 4, 4).
    """
    R = path.R_base_tunnel @ rotation("x", path.theta3) @ rotation("z", path.theta2) @ rotation("x", theta1)
    return transform(R, path.position)


def roll_pose(T: Array, theta1: Array) -> Array:
    """Turn poses (n, 4, 4) about their own x axis by theta1 [rad], (n,)."""
    c, s = np.cos(theta1)[:, None], np.sin(theta1)[:, None]
    rolled = T.copy()
    rolled[:, :3, 1] = c * T[:, :3, 1] + s * T[:, :3, 2]
    rolled[:, :3, 2] = c * T[:, :3, 2] - s * T[:, :3, 1]
    return rolled


def find_roll(T: Array, reached: Array) -> Array:
    """Find theta1 by which the tool's reached frame is rolled against T, each (n, 4, 4); (n,) [rad]."""
    y = reached[:, :3, 1]
    return np.arctan2(
        np.einsum("ni,ni->n", T[:, :3, 2], y),
        np.einsum("ni,ni->n", T[:, :3, 1], y),
    )


@dataclass(frozen=True)
class TaskError:
    """How far joint vectors miss their targets, linearised.

    Attributes:
        residual: Position error [m] (3) and direction error [rad] (2), shape (n, 5).
        jacobian: Its derivative by the joints, shape (n, 5, joints).
        facing: Whether the tool looks into the target's half space, shape (n,).
    """

    residual: Array
    jacobian: Array
    facing: Array

    @property
    def size(self) -> Array:
        """Largest residual of each point [m, rad], infinite where the tool faces away; (n,)."""
        return np.where(self.facing, np.abs(self.residual).max(axis=1), np.inf)


def compute_error(arm: Arm, T: Array, q: Array) -> TaskError:
    """Compare the tool's position and direction at q (n, joints) with targets T (n, 4, 4)."""
    find = kernel("task").find_misses
    return TaskError(*by_halves(lambda T, q: find(arm.table, T, q), np.ascontiguousarray(T), as_rows(q)))


def project_task(arm: Arm, T: Array, q: Array, metric: Array, rounds: int = 3) -> Array:
    """Move joint vectors onto their targets by the least weighted change (Newton).

    Args:
        arm: The arm.
        T: Targets, shape (n, 4, 4).
        q: Joint vectors near them, shape (n, joints).
        metric: Cost of a squared change of each joint, shape (joints,).
        rounds: Newton rounds.
    """
    move, ease = kernel("task").project, 1.0 / metric
    found: Array = by_halves(
        lambda T, q: move(arm.table, T, q, ease, rounds), np.ascontiguousarray(T), as_rows(q)
    )
    return found
