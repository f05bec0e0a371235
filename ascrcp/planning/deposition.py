"""Where the concrete goes: nozzle poses and a wall -> layer per cubic metre pumped (sparse, linear).

A jet widens as a cone. Within it the concrete is distributed as a bell (beta distribution of the
squared radius); a share rebounds, depending on place, angle and distance; an arch casts a shadow on
the rock behind its flanges. What lands is reckoned as growth of the wall toward the axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_matrix

from ascrcp.core.geometry import Array
from ascrcp.perception.profile_line import curvature
from ascrcp.planning.process import ProcessParameters, ReboundParameters, SprayParameters
from ascrcp.planning.target import ArchLid, Target

WINDOW = 1.6  # half width of the window of cells looked at, in footprint radii: tilt and stand-off included
SLOPE_SIGMA_M = 0.10  # one sigma of the slope that tells the rebound: steeper rims are edges, not slopes
CATCH_SIGMA_M = 0.03  # and of the slope that tells what a cell catches of the jet: half a cell
MAX_REBOUND = 0.9
LEAST_DEPTH_M = 0.05  # before the nozzle: nearer cells count as so far


@dataclass(frozen=True)
class Jet:
    """Nozzles at one instant each, tunnel frame.

    Attributes:
        position: (s, y, z) [m], shape (n, 3).
        direction: Unit spray directions, shape (n, 3).
    """

    position: Array
    direction: Array

    def pick(self, rows: NDArray[np.int64] | slice) -> "Jet":
        """Return some of them."""
        return Jet(self.position[rows], self.direction[rows])


def footprint(tangent: Array, spray: SprayParameters) -> Array:
    """Share of the flow per unit area of the plane 1 m before the nozzle [1/m2], of any shape.

    Args:
        tangent: Tangent of the angle off the jet's axis.
        spray: Radius and shape; the density integrates to one.
    """
    inside = np.maximum(1.0 - (tangent / spray.radius_m) ** 2, 0.0)
    density = spray.beta / (np.pi * spray.radius_m**2) * inside ** (spray.beta - 1.0)
    return np.asarray(np.where(inside > 0.0, density, 0.0))


def rebound(upward: Array, square: Array, distance: Array, parameters: ReboundParameters) -> Array:
    """Share that does not stick.

    Args:
        upward: z of the wall's outward normal: 1 at the crown, 0 on an upright wall; below it the wall's.
        square: Cosine of the angle between jet and normal.
        distance: Nozzle to wall [m].
        parameters: By place, angle and distance.
    """
    p = parameters
    place = p.wall + (p.crown - p.wall) * np.clip(upward, 0.0, 1.0) ** 2
    angle = p.angle * (1.0 - np.clip(square, 0.0, 1.0) ** 2)
    return np.asarray(np.clip(place + angle + p.distance * (distance - p.best_m) ** 2, 0.0, MAX_REBOUND))


@dataclass(frozen=True)
class _Cells:
    """The wall ready to be sprayed, as flat arrays over the cells of a target, tunnel frame."""

    point: Array  # (cells, 3)
    outward: Array  # outward normal of the design line, y and z, (cells, 2)
    slope: Array  # of the offset along the axis and along the arc, as the rebound knows it, (cells, 2)
    facing: Array  # the same as it catches the jet, (cells, 2)
    offset: Array
    arch: NDArray[np.bool_]
    stretch: Array


def deposit(jet: Jet, target: Target, offset: Array, process: ProcessParameters) -> csr_matrix:
    """Reckon how the wall grows under each jet.

    Args:
        jet: n nozzles.
        target: The grid, its arches and its cells on arches.
        offset: The wall as it stands while they spray [m], shape (ns, na).
        process: Jet and rebound.

    Returns:
        Growth toward the axis by cell per volume pumped [m/m3], shape (ns * na, n).
    """
    cells = _prepare(target, offset)
    n = len(jet.position)
    row, column, nozzle_offset = _aim(jet, target, offset)
    ds, da = target.cell
    reach = WINDOW * process.spray.radius_m
    hs, ha = (max(1, int(np.ceil(reach / step))) for step in (ds, da))
    dr, dc = (x.ravel() for x in np.meshgrid(np.arange(-hs, hs + 1), np.arange(-ha, ha + 1), indexing="ij"))
    r, c = row[:, None] + dr, column[:, None] + dc
    ok = (r >= 0) & (r < len(target.station)) & (c >= 0) & (c < len(target.along))
    which, _ = np.nonzero(ok)
    index = (r * len(target.along) + c)[ok]
    met = _is_in_cone(jet, cells, which, index, process.spray)  # a fifth of the window
    which, index = which[met], index[met]
    growth = _growth(jet, cells, which, index, process)
    lit = growth > 0.0
    which, index, growth = which[lit], index[lit], growth[lit]
    shade = _is_shaded(jet, target, cells, which, index, nozzle_offset)
    growth[shade] = 0.0
    return csr_matrix((growth, (index, which)), shape=(offset.size, n))


def _prepare(target: Target, offset: Array) -> _Cells:
    profile = target.profile
    station = np.repeat(target.station, len(target.along))
    flat = offset.ravel()
    slope, facing = (wall_slope(target, offset, sigma) for sigma in (SLOPE_SIGMA_M, CATCH_SIGMA_M))
    normal = np.tile(profile.normal(target.along), (len(target.station), 1))
    on_line = np.tile(profile.point(target.along), (len(target.station), 1))
    point = np.column_stack([station, on_line + flat[:, None] * normal])
    bend = np.tile(curvature(profile, target.along), len(target.station))
    return _Cells(point, normal, slope, facing, flat, target.arch.ravel(), 1.0 + bend * flat)


def wall_slope(target: Target, offset: Array, sigma: float) -> Array:
    """Compute the slope of the smoothed rock along axis and arc, 0 on arches, shape (cells, 2)."""
    ds, da = target.cell
    rock = np.where(target.arch, target.rock, offset)
    smooth = gaussian_filter(rock, (sigma / ds, sigma / da), mode="nearest")
    by_station, by_along = np.gradient(smooth, ds, da)
    slope = np.column_stack([by_station.ravel(), by_along.ravel()])
    slope[target.arch.ravel()] = 0.0
    return slope


def _aim(jet: Jet, target: Target, offset: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Find the cell each jet's axis meets, and the nozzle's own offset from the design line [m]."""
    along, nozzle_offset = target.profile.locate(jet.position[:, 1:])
    outward = (jet.direction[:, 1:] * target.profile.normal(along)).sum(axis=1)
    wall = target.sample(offset, jet.position[:, 0], along)
    reach = (wall - nozzle_offset) / np.maximum(outward, 0.2)
    hit = jet.position + reach[:, None] * jet.direction
    along, _ = target.profile.locate(hit[:, 1:])
    ds, da = target.cell
    row = np.rint((hit[:, 0] - target.station[0]) / ds).astype(np.int64)
    column = np.rint((along - target.along[0]) / da).astype(np.int64)
    return row, column, nozzle_offset


def _is_in_cone(
    jet: Jet,
    cells: _Cells,
    which: NDArray[np.int64],
    index: NDArray[np.int64],
    spray: SprayParameters,
) -> NDArray[np.bool_]:
    """Whether cell `index` lies within the cone of jet `which`."""
    depth, square = np.zeros(len(index)), np.zeros(len(index))
    for k in range(3):
        view = cells.point[:, k][index] - jet.position[:, k][which]
        depth += view * jet.direction[:, k][which]
        square += view**2
    return np.asarray(square - depth**2 < (spray.radius_m * np.maximum(depth, LEAST_DEPTH_M)) ** 2)


def _growth(
    jet: Jet,
    cells: _Cells,
    which: NDArray[np.int64],
    index: NDArray[np.int64],
    process: ProcessParameters,
) -> Array:
    """Growth of cell `index` under jet `which` per volume pumped [m/m3], shadows not counted."""
    view = cells.point[index] - jet.position[which]
    d = jet.direction[which]
    depth = (view * d).sum(axis=1)
    across = np.linalg.norm(view - depth[:, None] * d, axis=1)
    depth = np.maximum(depth, LEAST_DEPTH_M)
    density = footprint(across / depth, process.spray)
    outward = cells.outward[index]
    radial = (view[:, 1:] * outward).sum(axis=1)
    around = view[:, 1] * outward[:, 1] - view[:, 2] * outward[:, 0]  # toward rising section angle
    slope, stretch = cells.slope[index], cells.stretch[index]

    def caught(slope: Array) -> Array:
        """(v . n) / (n . e_r): what a cell of this slope catches, per area of the design surface."""
        by_arc = slope[:, 1] / stretch * around
        return np.asarray(np.maximum(radial - slope[:, 0] * view[:, 0] - by_arc, 0.0))

    distance = np.linalg.norm(view, axis=1)
    size = np.sqrt(1.0 + slope[:, 0] ** 2 + (slope[:, 1] / stretch) ** 2)
    square = caught(slope) / (size * distance)
    lost = rebound(outward[:, 1], square, distance, process.rebound)
    return np.asarray((1.0 - lost) * density * caught(cells.facing[index]) / depth**3)


def _is_shaded(
    jet: Jet,
    target: Target,
    cells: _Cells,
    which: NDArray[np.int64],
    index: NDArray[np.int64],
    nozzle_offset: Array,
) -> NDArray[np.bool_]:
    """Whether an arch stands between jet `which` and cell `index`."""
    shaded = np.zeros(len(index), dtype=bool)
    column = index % len(target.along)
    s0, s1 = jet.position[which, 0], cells.point[index, 0]
    o0, o1 = nozzle_offset[which], cells.offset[index]
    for lid in target.arches:
        shaded |= ~cells.arch[index] & _crosses(lid, column, s0, s1, o0, o1)
    return shaded


def _crosses(
    lid: ArchLid, column: NDArray[np.int64], s0: Array, s1: Array, o0: Array, o1: Array
) -> NDArray[np.bool_]:
    """Whether the way from nozzle (s0, o0) to wall (s1, o1) goes through a flange or the web."""
    middle = lid.station[column]
    rise = np.maximum(o1 - o0, 1e-3)
    inner = s0 + np.clip((lid.inner - o0) / rise, 0.0, 1.0) * (s1 - s0) - middle
    outer = s0 + np.clip((lid.outer - o0) / rise, 0.0, 1.0) * (s1 - s0) - middle
    flange = (np.abs(inner) < lid.half) & (o1 > lid.inner)
    flange |= (np.abs(outer) < lid.half) & (o1 > lid.outer)
    return np.asarray(flange | (inner * outer < 0.0))
