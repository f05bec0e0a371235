"""The wall in cells for the reach map: Surface -> one wall point and nozzle pose per cell."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Axis, Label, SprayPath, Surface
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.core.profile import Profile, section_angle
from ascrcp.kinematics.task import spray_pose
from ascrcp.kinematics.workspace import HeadingConfig
from ascrcp.planning.parameter import PlanningParameters
from ascrcp.planning.path import spray_angle, spray_direction
from ascrcp.planning.wall import fit_wall

STEP = 0.05
"""Cells of the smooth wall that stands in for a recognised one [m]."""


@dataclass(frozen=True)
class WallCells:
    """Cells of the unsprayed wall, station by arc length; arrays of m = ns * na cells, station first.

    Attributes:
        station: Middles of the rows [m], shape (ns,).
        along: Middles of the columns along the design line [m], shape (na,).
        point: Wall points in the base frame [m], shape (m, 3).
        arc_angle: Section angle of the columns on the design line, rising [rad], shape (na,).
        angle: Section angle of the wall points [rad], shape (m,).
        T: Nozzle poses square to the wall, roll free, base frame, shape (m, 4, 4).
        path: The same as points of a spray path.
        asked: Whether the planner would spray there: seen, and the nozzle clear of the floor, (m,).
        floor: Height of the floor in the section plane [m].
    """

    station: Array
    along: Array
    arc_angle: Array
    point: Array
    angle: Array
    T: Array
    path: SprayPath
    asked: NDArray[np.bool_]
    floor: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the map."""
        return len(self.station), len(self.along)


def lay_cells(surface: Surface, parameters: PlanningParameters, cell: float) -> WallCells:
    """Divide the unsprayed wall into cells of about one size and aim the nozzle at each.

    Args:
        surface: Recognised heading.
        parameters: Stand-off, smoothing and clearances of the planner.
        cell: Size wanted [m].
    """
    wall = fit_wall(surface, parameters)
    station = _middles(*surface.unsprayed, cell)
    along = _middles(0.0, surface.profile.length, cell)
    s, a = (grid.ravel() for grid in np.meshgrid(station, along, indexing="ij"))
    point = wall.point(s, a)
    theta3 = spray_angle(wall.normal(s, a, np.radians(parameters.normal_limit_deg)))
    nozzle = point - parameters.stand_off_m * spray_direction(np.pi / 2, theta3)
    asked = wall.sample(wall.unseen, s, a) <= parameters.bridge_m
    asked &= nozzle[:, 2] >= wall.floor_z + parameters.floor_clearance_m
    T = surface.axis.T_base_tunnel
    m = len(s)
    path = SprayPath(
        position=apply_transform(T, nozzle),
        theta2=np.full(m, np.pi / 2),
        theta3=theta3,
        station=s,
        angle=section_angle(point[:, 1:]),
        bay=np.zeros(m, dtype=np.int64),
        pass_index=np.zeros(m, dtype=np.int64),
        overbreak=np.zeros(m, dtype=bool),
        R_base_tunnel=T[:3, :3],
    )
    return WallCells(
        station,
        along,
        np.unwrap(section_angle(surface.profile.point(along))),
        apply_transform(T, point),
        path.angle,
        spray_pose(path),
        path,
        asked,
        wall.floor_z,
    )


def imagine_heading(profile: Profile, heading: HeadingConfig) -> Surface:
    """Build a heading exactly on its design line, straight ahead of the machine."""
    axis = Axis(np.array([0.0, heading.axis_left_m, heading.axis_height_m]), np.array([1.0, 0.0, 0.0]))
    station = np.arange(heading.unsprayed_m[0], heading.unsprayed_m[1] + STEP, STEP)
    along = np.arange(0.0, profile.length + STEP, STEP)
    shape = (len(station), len(along))
    return Surface(
        axis=axis,
        profile=profile,
        unsprayed=heading.unsprayed_m,
        arches=(),
        overbreak=(),
        bays=(),
        station=station,
        along=along,
        offset=np.zeros(shape, dtype=np.float32),
        filled=np.zeros(shape, dtype=bool),
        points=np.zeros((0, 3), dtype=np.float32),
        labels=np.zeros(0, dtype=np.asarray(Label.OTHER, dtype=np.uint8).dtype),
    )


def _middles(first: float, last: float, cell: float) -> Array:
    count = max(1, round((last - first) / cell))
    edges = np.linspace(first, last, count + 1)
    return np.asarray((edges[:-1] + edges[1:]) / 2)
