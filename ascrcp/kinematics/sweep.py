"""Clearance between the rows of a motion: rows of joints -> the least kept on the way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.obstacle import Obstacles

STEP_M = 0.02
"""Looked at so close together that nothing moves further between two looks [m]: 1 cm from either."""


@dataclass(frozen=True)
class Sweep:
    """What a motion keeps clear, straight in joint space from row to row.

    Attributes:
        distance: Least on the way from each row to the next [m], exact to 1 cm below the floor asked for,
            no more than that above; shape (rows - 1,).
        text: Link, obstacle, distance and place where it is least of all.
        at: Index of that interval.
    """

    distance: Array
    text: str
    at: int


def sweep_clearance(arm: Arm, q: Array, obstacles: Obstacles, floor: float) -> Sweep:
    """Measure what rows of joints keep clear between them.

    No point of the arm is further from one of two rows than half of what moves most between them: only
    intervals that could come below the floor by that are looked at closely.

    Args:
        arm: An arm with capsules.
        q: Rows [rad, m], shape (rows, joints), two or more.
        obstacles: The surroundings.
        floor: Distance of interest [m].

    Raises:
        InputError: Fewer than two rows, or bad ones.
    """
    if q.ndim != 2 or len(q) < 2:
        raise InputError(f"a motion has two rows or more of {arm.n} joints, not shape {q.shape}")
    seen = clearance(arm, q, obstacles)
    travel = _travel(arm, q)
    distance = np.minimum(seen.distance[:-1], seen.distance[1:])
    worst = int(seen.distance.argmin())
    best, text, at = float(seen.distance[worst]), seen.describe(arm, worst), min(worst, len(q) - 2)
    for i in np.flatnonzero(~(distance - travel / 2.0 >= floor) & (travel > STEP_M)).tolist():
        share = np.linspace(0.0, 1.0, int(np.ceil(travel[i] / STEP_M)) + 1)[:, None]
        close = clearance(arm, q[i] + share * (q[i + 1] - q[i]), obstacles)
        least = int(close.distance.argmin())
        distance[i] = close.distance[least]
        if distance[i] < best:
            best, text, at = float(distance[i]), close.describe(arm, least), i
    return Sweep(distance, text, at)


def _travel(arm: Arm, q: Array) -> NDArray[np.float64]:
    """Bound how far any point of the arm moves from each row to the next [m], shape (rows - 1,).

    Joint by joint: a slide moves everything beyond it by its step, a turn by its angle times the reach.
    """
    step = np.abs(np.diff(q, axis=0))
    frames = arm.frames(q)
    tip = arm.forward(q)[:, None, :3, 3]
    reach = np.linalg.norm(frames[..., :3, 3] - tip, axis=-1)
    lever = np.where(arm.prismatic, 1.0, np.maximum(reach[:-1], reach[1:])[:, : arm.n])
    return np.asarray((step * lever).sum(axis=1))
