"""The poses of one scoop of muck: a place on the invert -> bucket poses -> postures clear of wall and beam.

Start pose, scoop, along the wall, above the main beam, tip (muck paper 3.3, fig. 11). A pose fixes the
bucket's lip and pitch; where along the tunnel it is (the carriage makes up for it) and how the bucket's joint
shares the pitch are free.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.planning.muck import MuckParameters

OVER = np.diag([1.0, -1.0, -1.0, 1.0])
"""A bucket turned over about its own length."""

ALONG_LINK = 8
"""Points of each link at which its clearance is looked at."""


@dataclass(frozen=True)
class Pose:
    """A place of the bucket's lip.

    Attributes:
        name: What happens there.
        y, z: Of the lip in the base frame, z down [m]; y is None where the arm's plane decides it.
        pitch: Of the bucket below the outward horizontal [rad]; pi points inward.
        ahead: How far along the tunnel from the scoop's begin [m]; None where it is free.
        at_wall: Whether the lip may be at the wall.
    """

    name: str
    y: float | None
    z: float
    pitch: float
    ahead: float | None = None
    at_wall: bool = False


def list_poses(parameters: MuckParameters, angle: float) -> list[Pose]:
    """List the poses of a scoop at an angle from the invert's lowest line [rad] (fig. 11 a to d)."""
    p = parameters

    def place(at: float, radius: float) -> tuple[float, float]:
        return radius * np.sin(at), p.base_above_axis_m + radius * np.cos(at)

    side = 1.0 if angle >= 0.0 else -1.0
    floor, above = p.tunnel_radius_m - p.floor_gap_m, p.tunnel_radius_m - p.lift_m
    pitches = np.radians(p.scoop_pitch_deg)
    share = np.linspace(0.0, 1.0, len(pitches))
    poses = [Pose("start", *place(angle, above), float(pitches[0]))]
    poses += [
        Pose("scoop", *place(angle, floor), float(pitch), float(s) * p.muck_length_m, at_wall=True)
        for pitch, s in zip(pitches, share, strict=True)
    ]
    poses.append(Pose("lift", *place(angle, above), 0.0, p.muck_length_m, at_wall=True))
    first, last, step = (np.radians(d) for d in (p.wall_from_deg, p.wall_to_deg, p.wall_step_deg))
    count = int(np.ceil((last - first) / step - 1e-9)) + 1
    for at in np.linspace(first, last, count).tolist():
        poses.append(Pose("wall", *place(side * at, p.tunnel_radius_m - p.wall_gap_m), 0.0, at_wall=True))
    poses.append(Pose("tip", None, p.beam.top_z_m - p.tip_height_m, np.pi))
    return poses


def bucket_pose(arm: Arm, slew: float, x: float, y: float, z: float, pitch: float) -> Array:
    """Return T_base_tool (4, 4) of a bucket in the arm's upright plane, its lip at x, y, z [m]."""
    straight = np.array([slew, 0.0, np.pi / 2, arm.lower[3], 0.0, np.pi / 2 - pitch])
    T = arm.forward(straight)
    T[:3, 3] = x, y, z
    return T


def find_pitch(arm: Arm, q: Array) -> Array:
    """Return how far the bucket points below the horizontal at joints (..., joints) [rad], shape (...)."""
    return np.asarray(np.arcsin(np.clip(arm.forward(q)[..., 2, 0], -1.0, 1.0)))


def find_candidates(
    arm: Arm, parameters: MuckParameters, pose: Pose, side: float
) -> tuple[Array, NDArray[np.int64]]:
    """Find every posture for a pose: joints (m, 6), and which place along the tunnel each is for, (m,)."""
    p = parameters
    poses = []
    for x in np.arange(p.x_from_m, p.x_to_m + 1e-9, p.x_step_m).tolist():
        if pose.y is None:  # over the beam: x stands for the slew, the lip lies beyond the base's axis
            slew = side * np.pi / 2 * min((x - p.x_from_m) / (p.x_to_m - p.x_from_m), 1.0)
            lip = -p.tip_inward_m * np.array([np.cos(slew), np.sin(slew)])
        else:
            lip = np.array([x + (pose.ahead or 0.0), pose.y])
            slew = float(np.arctan2(lip[1], lip[0]))
        T = bucket_pose(arm, slew, lip[0], lip[1], pose.z, pose.pitch)
        poses += [T, T @ OVER]  # the hand's own roll is left out of the model: either way up
    bend = np.arange(arm.lower[5], arm.upper[5] + 1e-9, np.radians(p.bucket_step_deg))
    near = np.zeros((len(poses) * len(bend), arm.n))
    near[:, 5] = np.tile(bend, len(poses))
    found = arm.inverse(np.repeat(np.array(poses), len(bend), axis=0), near=near)
    good = found.within_limits
    where = np.broadcast_to(np.repeat(np.arange(len(poses)) // 2, len(bend))[:, None], good.shape)[good]
    q, first = np.unique(found.q[good].round(9), axis=0, return_index=True)
    where = where[first]
    clear = np.ones(len(q), dtype=bool)
    if len(q):
        clear = measure_clearance(arm, p, q[:, None], pose.at_wall)[:, 0] >= p.clearance_m
    if not clear.any():
        why = "clear of wall and beam" if len(q) else "within the ranges"
        raise UnreachableError(f"{arm.name}: no posture {why} reaches the pose '{pose.name}'")
    return q[clear], where[clear]


def measure_clearance(arm: Arm, parameters: MuckParameters, q: Array, lip_at_wall: bool = True) -> Array:
    """Return the least distance of boom, fore-arm and bucket from the wall and from the beam.

    Args:
        arm: The arm.
        parameters: Tunnel, beam and the links' radius.
        q: Joints [rad, m], shape (..., joints).
        lip_at_wall: Whether the bucket itself may touch the wall, as in scooping.

    Returns:
        Shape (...) [m].
    """
    p = parameters
    frames = arm.frames(q)
    shoulder, elbow, wrist, lip = (frames[..., i, :3, 3] for i in (0, 1, 4, 6))
    s = np.linspace(0.0, 1.0, ALONG_LINK)[:, None]
    links = [(1 - s) * a[..., None, :] + s * b[..., None, :] for a, b in ((shoulder, elbow), (elbow, wrist))]
    bucket = (1 - s) * wrist[..., None, :] + s * lip[..., None, :]
    arm_points = np.concatenate(links, axis=-2)
    everything = np.concatenate([arm_points, bucket], axis=-2)
    off_axis = np.hypot(arm_points[..., 1], arm_points[..., 2] - p.base_above_axis_m)
    wall = p.tunnel_radius_m - off_axis.max(axis=-1)
    if not lip_at_wall:
        reach = np.hypot(bucket[..., 1], bucket[..., 2] - p.base_above_axis_m)
        wall = np.minimum(wall, p.tunnel_radius_m - reach.max(axis=-1))
    aside = np.maximum(np.abs(everything[..., 1]) - p.beam.half_width_m, 0.0)
    above = np.maximum(p.beam.top_z_m - everything[..., 2], everything[..., 2] - p.beam.bottom_z_m)
    beam = np.where((aside == 0.0) & (above < 0.0), above, np.hypot(aside, np.maximum(above, 0.0))).min(
        axis=-1
    )
    return np.asarray(np.minimum(wall, beam) - p.link_radius_m)
