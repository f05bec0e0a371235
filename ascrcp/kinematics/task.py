"""The spray task: a nozzle position and a spray direction, with the roll about it left free (eq. 4-5)."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array, rotation, transform
from ascrcp.kinematics.arm import Arm


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
    reached, J = arm.pose_and_jacobian(q)
    d = reached[:, :3, 0]
    residual = np.empty((len(q), 5))
    jacobian = np.empty((len(q), 5, arm.n))
    residual[:, :3] = reached[:, :3, 3] - T[:, :3, 3]
    jacobian[:, :3] = J[:, :3]
    for row, axis in ((3, T[:, :3, 1]), (4, T[:, :3, 2])):
        residual[:, row] = np.einsum("ni,ni->n", axis, d)
        jacobian[:, row] = np.einsum("ni,nij->nj", np.cross(d, axis), J[:, 3:])
    facing = np.einsum("ni,ni->n", T[:, :3, 0], d) > 0.0
    return TaskError(residual, jacobian, facing)


def project_task(arm: Arm, T: Array, q: Array, metric: Array, rounds: int = 3) -> Array:
    """Move joint vectors onto their targets by the least weighted change (Newton).

    Args:
        arm: The arm.
        T: Targets, shape (n, 4, 4).
        q: Joint vectors near them, shape (n, joints).
        metric: Cost of a squared change of each joint, shape (joints,).
        rounds: Newton rounds.
    """
    ease = 1.0 / metric
    for _ in range(rounds):
        error = compute_error(arm, T, q)
        JW = error.jacobian * ease
        gram = JW @ np.swapaxes(error.jacobian, 1, 2)
        # a trace-scaled grain keeps a singular pose from stopping the others
        gram += 1e-12 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(5)
        step = np.linalg.solve(gram, error.residual[..., None])
        q = q - (np.swapaxes(JW, 1, 2) @ step)[..., 0]
    return q
