"""A spraying pass round a tunnel for control tests: an arc at constant nozzle speed, solved numerically."""

import numpy as np

from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array, unit
from ascrcp.kinematics.arm import Arm

CENTRE_Z, RADIUS, STATION = -1.85, 4.9, 10.8
SPACING = 0.2


def arc_sequence(
    arm: Arm, speed: float = 0.3, from_deg: float = 20.0, to_deg: float = 160.0
) -> JointSequence:
    """Nozzle along an arc 1 m off a 5.9 m wall, spraying outward; a planned point every 0.2 m."""
    n = int(np.radians(to_deg - from_deg) * RADIUS / (SPACING / 4)) // 4 * 4 + 1
    phi = np.radians(np.linspace(from_deg, to_deg, n))
    outward = np.stack([np.zeros(n), -np.cos(phi), np.sin(phi)], -1)
    position = np.array([STATION, 0.0, CENTRE_Z]) + RADIUS * outward
    q = solve_arc(arm, position, outward)
    step = RADIUS * (phi[1] - phi[0]) / speed
    t = np.arange(n) * step + 1.5 * (1.0 - np.exp(-np.arange(n) * step))  # an unhurried start
    t[-1] += 0.3
    point = np.where(np.arange(n) % 4 == 0, np.arange(n) // 4, -1)
    T = arm.forward(q)
    return JointSequence(t, q, T[:, :3, 3], T[:, :3, 0], point.astype(np.int64), np.arange(n) < n - 1)


def solve_arc(arm: Arm, position: Array, outward: Array) -> Array:
    """Follow poses by damped least squares, the small joints moving most; roll about the spray is free."""
    q = np.array([-0.3, 0.0, 0.9, 0.3, 0.0, 1.1, 2.0, 1.5])
    rest = np.array([0.0, 0.2, 0.9, 0.0, 0.0, 1.1, 1.6, 1.5])
    weight = np.diag([0.3, 0.3, 0.3, 0.5, 0.5, 0.5, 1.0, 1.0])
    rows = []
    for i in range(len(position)):
        for _ in range(400 if i == 0 else 6):
            T = arm.forward(q)
            R = T[:3, :3]
            task = np.concatenate([position[i] - T[:3, 3], R[:, 1:].T @ np.cross(R[:, 0], outward[i])])
            full = arm.jacobian(q)
            J = np.vstack([full[:3], R[:, 1:].T @ full[3:]])
            pinv = weight @ J.T @ np.linalg.inv(J @ weight @ J.T + 1e-6 * np.eye(5))
            pull = (np.eye(8) - pinv @ J) @ (rest - q) * (0.1 if i == 0 else 0.005)
            q = q + np.clip(pinv @ task + pull, -0.1, 0.1)
        rows.append(q.copy())
    q = np.array(rows)
    found = arm.forward(q)
    assert np.abs(found[:, :3, 3] - position).max() < 0.02
    assert (unit(found[:, :3, 0]) * outward).sum(-1).min() > 0.999
    assert arm.within_limits(q).all(), q[~arm.within_limits(q)][:3]
    return q
