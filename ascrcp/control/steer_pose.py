"""Bring joints onto a nozzle pose by Newton steps from joints near it; roll about the spray is free."""

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.sag import sagged_forward

ROUNDS = 4
"""Newton steps at most: from interpolated joints two suffice."""

ENOUGH = 2e-5
"""Miss at which the steps end [m and rad]: far below what the sensors' steps mean at the nozzle."""

DAMPING = 1e-6
"""Damping of the least-squares step, so that a singular pose makes it short instead of wild."""


def find_joints(
    arm: Arm, q: Array, position: Array, direction: Array, payload_kg: float = 0.0
) -> tuple[Array, Array]:
    """Move joint vectors, by as little as possible, until the sagging nozzle is where it should be.

    Args:
        arm: The arm.
        q: Joints near the pose [rad, m], shape (..., joints); a single vector is much the quickest.
        position: Nozzle positions wanted [m], base frame, shape (..., 3).
        direction: Unit spray directions wanted, shape (..., 3).
        payload_kg: Concrete in the hose [kg].

    Returns:
        Joints, shape (..., joints), and what is still missed: distance [m] plus angle [rad], shape (...).
    """
    q = np.array(q, dtype=float)
    if not q.size:
        return q, np.zeros(q.shape[:-1])
    weight = 1.0 / arm.travel_weight
    for left in range(ROUNDS, -1, -1):
        T = sagged_forward(arm, q, payload_kg)
        axis = T[..., :3, 0]
        residual = np.concatenate([position - T[..., :3, 3], _cross(axis, direction)], axis=-1)
        miss = np.sqrt((residual[..., :3] ** 2).sum(-1)) + np.sqrt((residual[..., 3:] ** 2).sum(-1))
        if not left or (miss <= ENOUGH).all():
            break
        J = arm.jacobian(q)
        # roll about the spray direction is free: take its part out of the rotation rows
        J[..., 3:, :] -= axis[..., :, None] * (axis[..., None, :] @ J[..., 3:, :])
        weighted = J * weight
        normal = weighted @ np.swapaxes(J, -1, -2) + DAMPING * np.eye(6)
        step = np.swapaxes(weighted, -1, -2) @ np.linalg.solve(normal, residual[..., None])
        q = q + step[..., 0]
    return q, np.asarray(miss)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (..., 3); np.cross costs five times as much for one."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
