"""What a ring's plan is worth: joints -> collisions, clearance, tilt, accelerations (duct paper 4)."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.ring import RingPlan, Scene, round_trip
from ascrcp.kinematics.ring_sweep import find_acceleration
from ascrcp.kinematics.ring_target import Ring


@dataclass(frozen=True)
class Verdict:
    """Figures of one plan.

    Attributes:
        clearance: Least at each row of the plan [m], shape (n + 1,) (fig. 11).
        colliding: Poses that touch the wall, the first counted twice (fig. 8).
        touching: How many poses each part touches the wall at.
        nearest: The part with the least clearance.
        between: Least clearance on straight joint moves between the poses [m].
        place_error: Largest miss of the gun's wanted place [m].
        tilt: Turn of the spray direction at each pose [rad], shape (n,).
        acceleration: Joints' accelerations at the inner rows [rad/s2, m/s2], shape (n - 1, joints).
        open_end: Largest difference of first and last row but for whole turns [rad, m].
    """

    clearance: Array
    colliding: int
    touching: dict[str, int]
    nearest: str
    between: float
    place_error: float
    tilt: Array
    acceleration: Array
    open_end: float


def judge_ring(scene: Scene, ring: Ring, plan: RingPlan) -> Verdict:
    """Judge a plan against the poses that were asked for."""
    gap = scene.body.measure(scene.arm, plan.q, scene.duct).clearance
    T = scene.arm.forward(plan.q)
    wanted = ring.T[round_trip(len(ring.T))]
    z, z_wanted = T[:-1, :3, 2], ring.T[:, :3, 2]
    sine = np.linalg.norm(np.cross(z, z_wanted), axis=1)
    apart = plan.q[-1] - plan.q[0]
    turns = np.where(scene.arm.prismatic, 0.0, 2 * np.pi * np.rint(apart / (2 * np.pi)))
    names = np.array(scene.body.names)
    return Verdict(
        clearance=gap.min(axis=1),
        colliding=int((gap < 0.0).any(axis=1).sum()),
        touching={
            name: int((gap[:, names == name] < 0.0).any(axis=1).sum())
            for name in dict.fromkeys(scene.body.names)
            if (gap[:, names == name] < 0.0).any()
        },
        nearest=scene.body.names[int(gap.min(axis=0).argmin())],
        between=measure_between(scene, plan.q),
        place_error=float(np.linalg.norm(T[:, :3, 3] - wanted[:, :3, 3], axis=1).max()),
        tilt=np.arctan2(sine, (z * z_wanted).sum(axis=1)),
        acceleration=find_acceleration(plan.q, scene.parameters.dt),
        open_end=float(np.abs(apart - turns).max()),
    )


def measure_between(scene: Scene, q: Array) -> float:
    """Return the least clearance on straight joint moves between rows (m, joints) [m]."""
    parts = scene.parameters.between
    share = np.arange(1, parts)[:, None, None] / parts
    rows = (1 - share) * q[:-1] + share * q[1:]
    gap = scene.body.measure(scene.arm, rows.reshape(-1, q.shape[1]), scene.duct)
    return float(gap.clearance.min())
