"""Plan the nozzle's path over the recognised wall: Surface -> SprayPath (thesis 4.2)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.core.profile import section_angle
from ascrcp.planning.parameter import PlanningParameters, check_parameters
from ascrcp.planning.raster import Raster, Strip
from ascrcp.planning.wall import Wall, fit_wall

Progress = Callable[[float], None]
WITHDRAW_STEPS = 4  # the withdrawal from an arch is found by repetition; it settles in two or three


@dataclass(frozen=True)
class _Pass:
    """Points of one pass in the order they are sprayed, tunnel frame; arrays (n, 3) and (n,)."""

    strip: Strip
    wall: Array
    nozzle: Array
    theta3: Array


def plan(surface: Surface, parameters: PlanningParameters, progress: Progress | None = None) -> SprayPath:
    """Plan the S-shaped path, overbreak first, then bay by bay from the right bottom.

    Planes one spray radius apart cut the wall; each point of the cut is moved one stand-off
    inward along the spray direction, which is the inward normal tilted to theta2 beside arches.
    Points on wall that was not seen, or whose nozzle would be too near the floor, are left out.

    Args:
        surface: Recognised heading.
        parameters: Distances and angles.
        progress: Called with the fraction done, 0..1; may raise to cancel.

    Returns:
        Nozzle poses in spraying order, base frame, at least one.

    Raises:
        ConfigError: A parameter outside its allowed range.
        InputError: No bay, nothing seen, or no point left.
    """
    parameters = check_parameters(parameters)
    if not surface.bays:
        raise InputError("the heading has no bay to spray: at least one is needed")
    wall = fit_wall(surface, parameters)
    raster = Raster(surface, parameters)
    strips = raster.strips()
    passes: list[_Pass] = []
    for done, strip in enumerate(strips, start=1):
        found = _lay_pass(strip, surface, wall, raster, parameters)
        if len(found.theta3):
            passes.append(found)
        if progress is not None:
            progress(done / len(strips))
    if not passes:
        raise InputError(
            f"no point of the wall can be sprayed: all are further than bridge_m {parameters.bridge_m} m "
            "from anything seen, or nearer the floor than "
            f"floor_clearance_m {parameters.floor_clearance_m} m"
        )
    return _assemble(passes, surface)


def _lay_pass(
    strip: Strip, surface: Surface, wall: Wall, raster: Raster, parameters: PlanningParameters
) -> _Pass:
    """Do the thesis's steps for one pass: thin, cut, normal, offset, leave out."""
    along = thin(*strip.along, parameters.point_spacing_m)
    if strip.falling:
        along = along[::-1]
    station = raster.stations(strip, along)
    point = wall.point(station, along)
    normal = wall.normal(station, along, np.radians(parameters.normal_limit_deg))
    theta3 = spray_angle(normal)
    direction = spray_direction(np.radians(strip.tilt_deg), theta3)
    nozzle = point - parameters.stand_off_m * direction
    nozzle = withdraw(nozzle, direction, surface, raster, parameters.arch_clearance_m)
    keep = wall.sample(wall.unseen, station, along) <= parameters.bridge_m
    keep &= nozzle[:, 2] >= wall.floor_z + parameters.floor_clearance_m
    return _Pass(strip, point[keep], nozzle[keep], theta3[keep])


def thin(first: float, last: float, spacing: float) -> Array:
    """Place points evenly from first to last arc length [m], at most `spacing` apart, shape (n,).

    The thesis thins scattered points with voxels to about 100 or 500 mm (fig. 4-4, 4-5); even
    steps along the arc give the same density without its jitter.
    """
    count = max(2, int(np.ceil((last - first) / spacing - 1e-9)) + 1)
    return np.linspace(first, last, count)


def spray_angle(normal: Array) -> Array:
    """Compute theta3 from both components of the outward normal (eq. 4-8 as corrected).

    Args:
        normal: Outward unit normals in the section plane (y, z), shape (n, 2).

    Returns:
        theta3 [rad] in [-90, 270) deg, so that it runs without a jump from the right foot over
        the crown (90 deg) to the left foot; shape (n,).
    """
    return np.pi - section_angle(normal)


def spray_direction(theta2: float | Array, theta3: Array) -> Array:
    """Compute unit spray directions in the tunnel frame (eq. 4-5, first column), shape (n, 3)."""
    s2 = np.sin(theta2)
    along = np.broadcast_to(np.cos(theta2), theta3.shape)
    return np.column_stack([along, s2 * np.cos(theta3), s2 * np.sin(theta3)])


def withdraw(nozzle: Array, direction: Array, surface: Surface, raster: Raster, clearance: float) -> Array:
    """Draw nozzles back along their spray line until they keep clear of every arch's inner flange."""
    profile = surface.profile
    for _ in range(WITHDRAW_STEPS):
        along, offset = profile.locate(nozzle[:, 1:])
        back = np.zeros(len(nozzle))
        for index, arch in enumerate(surface.arches):
            beside = np.abs(nozzle[:, 0] - raster.arch_station(index, along)) - arch.width / 2.0
            beside = np.maximum(beside, 0.0)
            needed = np.sqrt(np.maximum(clearance**2 - beside**2, 0.0))  # room to the arch line there
            near = beside < clearance
            back = np.where(near, np.maximum(back, needed - (profile.arch_line - offset)), back)
        inward = np.maximum((direction[:, 1:] * profile.normal(along)).sum(-1), 0.5)
        nozzle = nozzle - (back / inward)[:, None] * direction
    return nozzle


def _assemble(passes: list[_Pass], surface: Surface) -> SprayPath:
    """Join the passes and carry the nozzle into the base frame."""
    sizes = [len(p.theta3) for p in passes]
    wall = np.concatenate([p.wall for p in passes])
    T = surface.axis.T_base_tunnel
    return SprayPath(
        position=apply_transform(T, np.concatenate([p.nozzle for p in passes])),
        theta2=np.repeat([np.radians(p.strip.tilt_deg) for p in passes], sizes),
        theta3=np.concatenate([p.theta3 for p in passes]),
        station=wall[:, 0],
        angle=section_angle(wall[:, 1:]),
        bay=np.repeat([p.strip.bay for p in passes], sizes),
        pass_index=np.repeat(np.arange(len(passes)), sizes),
        overbreak=np.repeat([p.strip.overbreak for p in passes], sizes),
        R_base_tunnel=T[:3, :3],
    )
