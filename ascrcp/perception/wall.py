"""The unrolled wall without arches: mean offset of every 5 cm cell, shadows filled and marked as filled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, uniform_filter
from scipy.special import gammainc, gammaln

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.fill import bridge, bulge, extend
from ascrcp.perception.parameter import WallParameters
from ascrcp.perception.profile_line import between
from ascrcp.perception.raster import Raster, Unrolled, raster_over
from ascrcp.perception.ring import Ring
from ascrcp.perception.section import Extent

_SIDE = 0.03  # the arch's own side is seen this far beyond its flange [m]
_CORNER = 0.06  # the corner between wall and face is left out by this much [m]; placeholder
_PROUD = 0.25  # what stands farther inside the arch line than this is not wall [m]; placeholder
_SHADOW = 0.6  # an arch's shadow reaches this far from it along the axis [m]; placeholder
_GAP = 4  # of 8 neighbours seen make an empty cell a gap in sampling, not shadow
_NEIGHBOURS = 5  # of 8 cells: the rim of a straight shadow has five
_BEFORE = 0.05  # a lone cell so far before the wall is a mixed echo: three times the relief of a cell [m]
_FIXED_POINT = 12  # steps to the density; off by 2 % for one point a cell, by nothing for more
_LEAST_DENSITY = 0.2  # of points in a cell; below it a count of one is chance
_DENSITY = 9  # cells of the square over which the density of points is averaged
_LEAST_DARK, _MOST_DARK = 0.01, 0.40  # chance that a cell amid the wall seen is dark; synthetic headings
_CHANCE = 4  # of the eight neighbours of a cell; the others are bridged if empty by chance; placeholder
_WHOLE_RIM = 0.1  # chance that a cell at the rim of a shadow is not cut by it; synthetic headings
_SURE = 1.0  # standard deviations by which empty cells must outnumber chance to be dark; placeholder
_EDGE = 3  # cells at an open end (face, edge of the sprayed part) that take their neighbour's value


@dataclass(frozen=True)
class Wall:
    """Rock and sprayed surface on the raster.

    Attributes:
        raster: Cells, station x arc length.
        offset: Outward from the design line [m], NaN where unknown, shape (ns, na).
        filled: Cells in shadow whose offset was filled in, shape (ns, na).
        count: Points in each cell, shape (ns, na).
        beyond: Those beyond the overbreak line, shape (ns, na).
        share: Share of each cell that was in sight: 1 inside the wall seen, less at the rim of a
            shadow, 0 in it, shape (ns, na).
    """

    raster: Raster
    offset: Array
    filled: NDArray[np.bool_]
    count: Array
    beyond: Array
    share: Array


def is_arch(flat: Unrolled, rings: list[Ring], profile: Profile, side: float = 0.0) -> NDArray[np.bool_]:
    """Mark points on the steel, as against the wall seen behind it, shape (n,)."""
    steel = np.zeros(len(flat), dtype=bool)
    for ring in rings:
        steel |= np.abs(ring.distance(flat.station, flat.yz)) < ring.width / 2 + side
    return steel & (flat.offset < between(profile))


def is_steel(flat: Unrolled, rings: list[Ring], profile: Profile, depth: float) -> NDArray[np.bool_]:
    """Mark points that may lie on any part of an arch, web and outer flange too, shape (n,).

    Args:
        flat: Points.
        rings: Arches.
        profile: Design profile.
        depth: Of the arches' section [m].
    """
    steel = np.zeros(len(flat), dtype=bool)
    for ring in rings:
        steel |= np.abs(ring.distance(flat.station, flat.yz)) < ring.width / 2 + _SIDE
    return steel & (flat.offset < profile.arch_line + depth)


def is_mixed(mean: Array, near_arch: NDArray[np.bool_], longest: int) -> NDArray[np.bool_]:
    """Mark cells in an arch's shadow that hold only echoes mixed from its edge and the rock, (ns, na).

    Wall goes on round a cell, even at the rim of a shadow; mixed echoes hang one by one before the
    wall that goes past them.

    Args:
        mean: Mean offset of every cell, NaN where none was seen [m], shape (ns, na).
        near_arch: Where shadows may fall, shape (ns, na).
        longest: Shadows bridged [cells].
    """
    full = ~np.isnan(mean)
    lone = full & near_arch & (_count_around(full) < _NEIGHBOURS)
    past = bridge(np.where(lone, np.nan, mean), 0, longest)
    with np.errstate(invalid="ignore"):
        return np.asarray(lone & (mean < past - _BEFORE))


def wall_end(extent: Extent) -> float:
    """Station up to which points are wall [m]: the face's own points reach just inside the lines too."""
    return extent.end if extent.face is None else extent.end - _CORNER


def build_wall(
    wall: Unrolled, extent: Extent, rings: list[Ring], profile: Profile, parameters: WallParameters
) -> Wall:
    """Average the wall's points over cells, from a little before the unsprayed part to the face.

    Args:
        wall: Points that may be wall.
        extent: Where the unsprayed part lies.
        rings: Arches, whose points are left out.
        profile: Design profile.
        parameters: Cells, gaps and shadows.

    Returns:
        The wall; a row begins exactly at the edge of the sprayed part.
    """
    cell = parameters.cell
    behind = min(parameters.behind, extent.sprayed_end - extent.first)
    before = max(0, int(np.floor(behind / cell)))
    start = extent.sprayed_end - before * cell
    raster = raster_over(start, max(extent.end, start + 2 * cell), cell, cell, profile)
    rock = wall.pick(
        ~is_steel(wall, rings, profile, parameters.steel)
        & (wall.station >= start)
        & (wall.station < wall_end(extent))
        & (wall.offset > profile.arch_line - _PROUD)
    )
    index = raster.index(rock.station, rock.along)
    mean, count = raster.mean(index, rock.offset)
    longest = int(np.ceil(parameters.fill / cell))
    mixed = is_mixed(mean, _is_near(raster, rings, profile), longest)
    mean[mixed], count[mixed] = np.nan, 0.0
    beyond = np.where(mixed, 0.0, raster.total(index, (rock.offset > profile.overbreak_line).astype(float)))
    # sprayed part and rock are different surfaces: nothing is filled across the edge between them
    parts = [_filled(mean[rows], count[rows], parameters) for rows in (slice(before), slice(before, None))]
    offset = np.concatenate([part[0] for part in parts])
    filled = np.concatenate([part[1] for part in parts])
    corner = _corner(raster, extent, filled | np.isnan(offset))
    filled &= ~corner
    share = _share(count, ~filled & ~np.isnan(offset), corner)
    filled |= ~np.isnan(offset) & (share < 0.5)
    # the last row may reach into the face
    share *= np.clip((extent.end - raster.station) / raster.row + 0.5, 0.0, 1.0)[:, None]
    return Wall(raster, offset, filled, count, beyond, share)


def _corner(raster: Raster, extent: Extent, dark: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark the cells between the last wall used and the face: left out, yet in sight, (ns, na)."""
    first = int(np.searchsorted(raster.station + raster.row / 2, wall_end(extent)))
    corner = np.zeros(dark.shape, dtype=bool)
    if extent.face is not None and 0 < first < len(dark):
        corner[first:] = ~dark[first - 1]
    return corner


def _share(count: Array, seen: NDArray[np.bool_], corner: NDArray[np.bool_]) -> Array:
    """Share of each cell that was in sight, from how many points it holds beside its neighbours, (ns, na).

    Where points lie close all round, a cell with few is partly dark, and one with none nearly always
    lies in a shadow too narrow to be seen as one; in a thin cloud such a cell says little.

    Args:
        count: Points in each cell, shape (ns, na).
        seen: Cells not taken for shadow, shape (ns, na).
        corner: Cells left out beside the face, yet in sight, shape (ns, na).
    """
    full = count > 0
    inner = full & (_count_around(full) == 8.0)
    if not inner.any():
        return seen.astype(float)
    weight = uniform_filter(inner.astype(float), _DENSITY)
    usual = np.where(inner, count, 0.0)
    near = uniform_filter(usual, _DENSITY) / np.maximum(weight, 1e-9)
    density = density_of_full(np.where(weight > 1e-6, near, usual.sum() / inner.sum()))
    empty = np.exp(-density)
    rim = _is_rim(seen | corner)
    amid = seen & ~rim & ~corner
    # more cells round about without a point than chance leaves empty are dark; as many are cut by a rim
    excess = uniform_filter(np.where(amid, ~full - empty, 0.0), _DENSITY)
    cells = uniform_filter(amid.astype(float), _DENSITY)
    cells = np.maximum(cells, 1.0 / _DENSITY**2)
    by_chance = _SURE * np.sqrt(empty * (1.0 - empty) / cells) / _DENSITY
    shaded = np.clip(excess / cells - by_chance, _LEAST_DARK, _MOST_DARK)
    # a shadow has its rim, however narrow it is
    dark = seen & ~corner & ~full & (shaded > (1.0 - 2.0 * shaded) * empty)
    edge = rim | (_is_rim((seen & ~dark) | corner) & full)
    # in a thin cloud a neighbour goes unseen by mere chance, which makes no rim
    chance = 1.0 - (1.0 - empty) ** _CHANCE
    whole = np.where(edge, _WHOLE_RIM + (1.0 - _WHOLE_RIM) * chance, 1.0 - 2.0 * shaded)
    share = expected_share(count, density, whole, np.where(edge, 0.0, shaded))
    return np.where(corner, 1.0, np.where(seen, share, 0.0))


def _is_rim(lit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark cells with a neighbour that is not lit; the raster's own edges are no rims, shape (ns, na)."""
    rim = _count_around(lit) < 8.0
    rim[[0, -1]] = rim[:, [0, -1]] = False
    return np.asarray(rim)


def density_of_full(mean: Array) -> Array:
    """Density of a Poisson process from the mean count of those cells that hold a point at all, (...).

    In a thin cloud the empty cells are missing from that mean: m = d / (1 - exp(-d)), solved for d.
    """
    density = np.asarray(mean, dtype=float)
    for _ in range(_FIXED_POINT):
        density = mean * -np.expm1(-density)
    return np.maximum(density, _LEAST_DENSITY)


def expected_share(count: Array, density: Array, whole: Array, dark: Array) -> Array:
    """Expect the share x of a cell in sight: points come as a Poisson process of density times x.

    Before they are counted the cell is whole, dark, or cut anywhere with equal chance.

    Args:
        count: Points found in the cell, shape (...).
        density: Points expected in a whole one, shape (...).
        whole: Chance that the cell is whole, shape (...).
        dark: Chance that it is dark, shape (...).

    Returns:
        The mean share given the count, shape (...).
    """
    count = np.minimum(count, 3.0 * density + 30.0)  # more says no more, but would underflow
    at_whole = whole * np.exp(count * np.log(density) - density - gammaln(count + 1.0))
    at_dark = np.where(count > 0, 0.0, dark)
    cut = (1.0 - whole - dark) * gammainc(count + 1.0, density) / density
    of_cut = (1.0 - whole - dark) * (count + 1.0) * gammainc(count + 2.0, density) / density**2
    return np.asarray((at_whole + of_cut) / (at_whole + at_dark + cut))


def _is_near(raster: Raster, rings: list[Ring], profile: Profile) -> NDArray[np.bool_]:
    """Whether cells lie so near an arch that its shadow may fall on them, shape (ns, na)."""
    near = np.zeros(raster.shape, dtype=bool)
    station = np.repeat(raster.station, raster.shape[1])
    yz = np.tile(profile.point(raster.along), (raster.shape[0], 1))
    for ring in rings:
        near |= (np.abs(ring.distance(station, yz)) < ring.width / 2 + _SHADOW).reshape(raster.shape)
    return near


def _filled(mean: Array, count: Array, parameters: WallParameters) -> tuple[Array, NDArray[np.bool_]]:
    """Bridge sampling gaps, then fill shadows; return the grid and which cells were in shadow."""
    if not mean.size:
        return mean, np.zeros(mean.shape, dtype=bool)
    grid = bridge(mean, 1, parameters.bridge)
    grid = bridge(grid, 0, parameters.bridge)
    # a gap between the lidar's lines has wall round it, the rim of a shadow on one side only
    full = ~np.isnan(mean)
    unseen = np.isnan(grid) | (~full & (_count_around(full) < _GAP * _chance_full(count)))
    longest = int(np.ceil(parameters.fill / parameters.cell))
    grid = bulge(grid, longest)
    grid = bridge(grid, 1, longest)
    grid = extend(grid, _EDGE)
    return grid, np.asarray(unseen & ~np.isnan(grid))


def _chance_full(count: Array) -> Array:
    """Chance that a cell in sight holds a point, from the cells about it that hold any, (ns, na)."""
    points = uniform_filter(count, _DENSITY, mode="constant")
    cells = uniform_filter((count > 0).astype(float), _DENSITY, mode="constant")
    return np.asarray(-np.expm1(-density_of_full(np.maximum(points / np.maximum(cells, 1e-9), 1.0))))


def _count_around(full: NDArray[np.bool_]) -> Array:
    """How many of its 8 neighbours are marked, for each cell, shape (ns, na)."""
    return np.asarray(convolve(full.astype(float), np.ones((3, 3)), mode="constant") - full)
