"""The muck on a tunnel's invert: how much, in how many scoops, and where each one is (muck paper 3.3)."""

import math
from typing import Annotated

import numpy as np
from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG

Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Length = Annotated[float, Meta(ge=-20.0, le=20.0)]
Angle = Annotated[float, Meta(ge=0.0, le=170.0)]
Share = Annotated[float, Meta(gt=0.0, le=1.0)]

FINE = 4001
"""Samples of the segment's width from which slices are cut."""


class Beam(Struct):
    """The main beam as a box along the tunnel over the base, z down [m]."""

    half_width_m: Positive
    top_z_m: Length
    bottom_z_m: Length


class MuckParameters(Struct):
    """Numbers of config/muck.yaml, which says each one's source."""

    tunnel_radius_m: Positive
    base_above_axis_m: Length
    muck_depth_m: Positive
    muck_length_m: Positive
    bulking: Annotated[float, Meta(ge=1.0, le=3.0)]
    bucket_m3: Positive
    time_limit_min: Positive
    cover_deg: Angle
    beam: Beam
    link_radius_m: Positive
    clearance_m: Annotated[float, Meta(ge=0.0, le=2.0)]
    floor_gap_m: Annotated[float, Meta(ge=0.0, le=1.0)]
    wall_gap_m: Annotated[float, Meta(ge=0.0, le=2.0)]
    lift_m: Positive
    carry_pitch_deg: Angle
    scoop_pitch_deg: list[Annotated[float, Meta(ge=-90.0, le=90.0)]]
    wall_from_deg: Angle
    wall_to_deg: Angle
    wall_step_deg: Positive
    tip_inward_m: Length
    tip_height_m: Positive
    x_from_m: Length
    x_to_m: Length
    x_step_m: Annotated[float, Meta(ge=0.02, le=1.0)]
    bucket_step_deg: Annotated[float, Meta(ge=1.0, le=45.0)]
    scoop_share: Share
    row_s: Annotated[float, Meta(ge=0.005, le=1.0)]
    hand_speed_deg_s: Positive
    hand_acceleration_deg_s2: Annotated[float, Meta(gt=0.0, le=1000.0)]

    def __post_init__(self) -> None:
        if not self.muck_depth_m < self.tunnel_radius_m:
            raise ConfigError("muck_depth_m must be less than tunnel_radius_m")
        if len(self.scoop_pitch_deg) < 2 or not self.x_from_m < self.x_to_m:
            raise ConfigError("scoop_pitch_deg needs two values or more, and x_from_m < x_to_m")
        if not (self.beam.top_z_m < self.beam.bottom_z_m and self.wall_from_deg < self.wall_to_deg):
            raise ConfigError("beam: top_z_m < bottom_z_m (z is down), and wall_from_deg < wall_to_deg")


def load_muck_parameters(**changes: float) -> MuckParameters:
    """Read config/muck.yaml, with some values replaced if given."""
    return load(CONFIG / "muck.yaml", MuckParameters, changes)


def find_segment_area(radius: float, depth: float) -> float:
    """Return the area of the circular segment that muck of a depth fills [m2] (errata 1.5)."""
    rest = radius - depth
    return radius**2 * math.acos(rest / radius) - rest * math.sqrt(2 * radius * depth - depth**2)


def find_volume(parameters: MuckParameters) -> float:
    """Return the volume to remove, bulked [m3]."""
    area = find_segment_area(parameters.tunnel_radius_m, parameters.muck_depth_m)
    return area * parameters.muck_length_m * parameters.bulking


def count_scoops(parameters: MuckParameters) -> int:
    """Return how many full buckets that is."""
    return math.ceil(find_volume(parameters) / parameters.bucket_m3 - 1e-9)


def cut_slices(parameters: MuckParameters, count: int) -> Array:
    """Cut the segment into upright slices of equal volume; their middles from right to left.

    Args:
        parameters: Radius and depth.
        count: Slices.

    Returns:
        Angle of each slice's middle from the invert's lowest line [rad], right (y < 0) negative, (count,).
    """
    radius, rest = parameters.tunnel_radius_m, parameters.tunnel_radius_m - parameters.muck_depth_m
    half = math.sqrt(radius**2 - rest**2)
    y = np.linspace(-half, half, FINE)
    height = np.sqrt(np.maximum(radius**2 - y**2, 0.0)) - rest
    area = np.concatenate([[0.0], np.cumsum((height[1:] + height[:-1]) / 2 * np.diff(y))])
    middle = np.interp((np.arange(count) + 0.5) / count * area[-1], area, y)
    return np.asarray(np.arcsin(middle / radius))
