"""The muck job: places on the invert -> joints of every scoop, each cycle timed.

Each pose is solved in closed form, and the whole way is chosen by least weighted travel (muck paper eq. 5,
in seconds instead of its sum of radians and metres).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.choice import travel_cost
from ascrcp.planning.muck import MuckParameters
from ascrcp.planning.muck_leg import Leg, time_leg
from ascrcp.planning.muck_pose import Pose, find_candidates, find_pitch, list_poses, measure_clearance

COVER_PITCHES_DEG = (90.0, 60.0, 30.0, 0.0)
"""Pitches of the bucket tried at each place of the invert."""


@dataclass(frozen=True)
class Postures:
    """What the arm does in one scoop, without times.

    Attributes:
        angle: Where it digs, from the invert's lowest line [rad].
        names: The poses, in order.
        q: Joints at the poses [rad, m], shape (poses, joints).
        loaded: Pose from which on the bucket is full.
        travel: Weighted travel (eq. 5) [s].
    """

    angle: float
    names: tuple[str, ...]
    q: Array
    loaded: int
    travel: float


@dataclass(frozen=True)
class Scoop:
    """One working cycle: from the start pose through scooping and tipping to the next start pose.

    Attributes:
        postures: What it goes through.
        legs: Scooping, carrying, returning.
        tip_s: Time the hand takes to turn over above the beam; it turns back on the way [s].
        clearance: Least distance of the arm from wall and beam on the way [m].
        floor: Least distance of the bucket's lip from the wall on the way [m].
        steepest: Most that the full bucket points up or down [rad].
    """

    postures: Postures
    legs: tuple[Leg, ...]
    tip_s: float
    clearance: float
    floor: float
    steepest: float

    @property
    def cycle_s(self) -> float:
        """Duration of the cycle [s]."""
        return sum(float(leg.t[-1]) for leg in self.legs) + self.tip_s


def plan_muck(
    arm: Arm, parameters: MuckParameters, angles: Sequence[float], progress: Callable[[float], None]
) -> tuple[Scoop, ...]:
    """Plan the whole job: one scoop at each angle, in order; the last one returns to its own start.

    Args:
        arm: The muck arm.
        parameters: Tunnel, beam, bucket.
        angles: From the invert's lowest line [rad].
        progress: Called with the share done.

    Raises:
        UnreachableError: A pose no posture reaches clear of wall and beam, or a way between poses that comes
            too near; the message names it.
    """
    postures = [plan_postures(arm, parameters, angle) for angle in angles]
    scoops = []
    for k, mine in enumerate(postures):
        following = postures[min(k + 1, len(postures) - 1)]
        scoops.append(_time_scoop(arm, parameters, mine, following.q[0]))
        progress((k + 1) / len(postures))
    return tuple(scoops)


def plan_postures(arm: Arm, parameters: MuckParameters, angle: float) -> Postures:
    """Choose the postures of one scoop at an angle from the invert's lowest line [rad]."""
    poses = list_poses(parameters, angle)
    side = 1.0 if angle >= 0.0 else -1.0
    names = tuple(pose.name for pose in poses)
    loaded = names.index("lift")
    layers = [find_candidates(arm, parameters, pose, side) for pose in poses]
    q, travel = _choose(arm, parameters, poses, layers, loaded)
    return Postures(angle, names, q, loaded, travel)


def _time_scoop(arm: Arm, parameters: MuckParameters, mine: Postures, end: Array) -> Scoop:
    p, q, k = parameters, mine.q, mine.loaded
    scooping = time_leg(arm, "scoop", q[:k], p.row_s, p.scoop_share)
    carrying = time_leg(arm, "carry", q[k - 1 :], p.row_s, 1.0)
    returning = time_leg(arm, "return", np.vstack([q[k:][::-1], end]), p.row_s, 1.0)
    legs = (scooping, carrying, returning)
    rows = np.vstack([leg.q for leg in legs])
    lip = arm.forward(rows)[:, :3, 3]
    clearance = float(measure_clearance(arm, p, rows).min())
    floor = float(p.tunnel_radius_m - np.hypot(lip[:, 1], lip[:, 2] - p.base_above_axis_m).max())
    if not min(clearance, floor) >= 0.0:
        raise UnreachableError(
            f"{arm.name}: between the poses of the scoop at {np.degrees(mine.angle):.1f} deg the arm comes "
            f"{1e3 * clearance:.0f} mm to wall or beam, the lip {1e3 * floor:.0f} mm to the wall"
        )
    return Scoop(
        postures=mine,
        legs=legs,
        tip_s=180.0 / p.hand_speed_deg_s + p.hand_speed_deg_s / p.hand_acceleration_deg_s2,
        clearance=clearance,
        floor=floor,
        steepest=float(np.abs(find_pitch(arm, carrying.q)).max()),
    )


def find_cover(arm: Arm, parameters: MuckParameters, step: float) -> float:
    """Return how far up the invert the lip reaches clear of wall and beam, in steps [rad], 0 if not at all.

    The carriage and the bucket's pitch are free (errata 1.4); the two sides mirror each other.
    """
    p, reached = parameters, 0.0
    for angle in np.arange(0.0, np.pi, step).tolist():
        y, z = p.tunnel_radius_m * np.sin(angle), p.base_above_axis_m + p.tunnel_radius_m * np.cos(angle)
        pitches = np.radians(COVER_PITCHES_DEG)
        if not any(_is_reached(arm, p, Pose("cover", y, z, pitch, at_wall=True)) for pitch in pitches):
            break
        reached = angle
    return reached


def _is_reached(arm: Arm, parameters: MuckParameters, pose: Pose) -> bool:
    try:
        return len(find_candidates(arm, parameters, pose, 1.0)[0]) > 0
    except UnreachableError:
        return False


def _choose(
    arm: Arm,
    parameters: MuckParameters,
    poses: Sequence[Pose],
    layers: Sequence[tuple[Array, NDArray[np.int64]]],
    loaded: int,
) -> tuple[Array, float]:
    """Choose one posture per pose by least weighted travel over the whole way (eq. 5).

    From pose `loaded` on the bucket is full: moves that would tip it on the way are left out.
    """
    steepest = np.radians(parameters.carry_pitch_deg)
    cost = np.zeros(len(layers[0][0]))
    came: list[NDArray[np.intp]] = []
    for k in range(1, len(layers)):
        (before, where_before), (after, where_after) = layers[k - 1], layers[k]
        step = np.stack([travel_cost(arm, before, q) for q in after])  # same both ways
        if None not in (poses[k - 1].ahead, poses[k].ahead):  # a scoop is dug from one place of the carriage
            step = np.where(where_after[:, None] == where_before, step, np.inf)
        if k > loaded:
            halfway = (after[:, None] + before) / 2
            step = np.where(np.abs(find_pitch(arm, halfway)) <= steepest, step, np.inf)
        total = cost + step
        came.append(total.argmin(axis=1))
        cost = total.min(axis=1)
    if not np.isfinite(cost).any():
        raise UnreachableError(f"{arm.name}: no way serves the whole scoop from one place, bucket level")
    row = int(cost.argmin())
    rows = [row]
    for back in reversed(came):
        row = int(back[row])
        rows.append(row)
    return np.array([q[i] for (q, _), i in zip(layers, reversed(rows), strict=True)]), float(cost.min())
