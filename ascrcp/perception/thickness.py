"""Thickness between two scans: clouds before and after spraying -> map on the unrolled wall.

Both scans are averaged over the same cells; what the wall came nearer is the layer. The part nobody
sprayed tells what two scans of an unchanged wall differ by: the noise floor.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Axis, Label, Surface
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.profile_line import crown_height, curvature
from ascrcp.perception.raster import Raster, raster_over, unroll
from ascrcp.perception.survey import ThicknessParameters

_SIDE = 0.06  # beside an arch no thickness is told: its shadow moves with the lidar [m]; placeholder
_FOOT = 2  # cells beside ground that are left out: rebound lies there; placeholder
_PROUD = 0.15  # what stands so far inside the arch line is no wall [m]; placeholder
_HEAP = 0.40  # beside it a heap still covers the wall round the arc so far [m]; placeholder
_STEEP = 1.0  # slopes beyond this are edges, not slopes
_CORNER = 0.10  # nor next to the face and to the step where the sprayed part begins [m]; placeholder
BLOCK = 1.0  # edge of the squares whose mean is judged [m]
_BLOCK_FILL = 0.5  # of a square that must be measured


@dataclass(frozen=True)
class ThicknessMap:
    """A layer on the unrolled wall.

    Attributes:
        station: Stations of the rows [m], shape (ns,).
        along: Arc lengths of the columns along the design line [m], shape (na,).
        thickness: How much the wall came nearer [m], NaN where not measured, shape (ns, na).
        sigma: Standard deviation of each cell from the scatter of its points [m], shape (ns, na).
        sprayed: Cells of the part that was to be sprayed, without its edges, shape (ns, na).
        noise_floor: Standard deviation of one cell on the unchanged part [m]; predicted from the
            scatter of the points where no unchanged part is seen.
        noise_floor_m2: The same of the mean of one square metre [m].
        bias: Median on the unchanged part, where it should be 0 [m]; NaN if none is seen.
        mean: Mean thickness of the sprayed cells [m].
        area: Area of these cells [m2].
        volume: Volume of the layer on them [m3].
    """

    station: Array
    along: Array
    thickness: Array
    sigma: Array
    sprayed: NDArray[np.bool_]
    noise_floor: float
    noise_floor_m2: float
    bias: float
    mean: float
    area: float
    volume: float


def measure_thickness(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    surface: Surface,
    parameters: ThicknessParameters,
) -> ThicknessMap:
    """Measure the layer that lies on the wall in the second scan but not in the first.

    Args:
        before: Points of the first scan, base frame [m], shape (n, 3).
        after: Points of the second, registered onto the first, shape (m, 3).
        surface: The first scan, recognised: axis, profile, arches and what was to be sprayed.
        parameters: Cells and the band that may be wall.

    Returns:
        The map with its noise floor.

    Raises:
        RecognitionError: The scans share no wall.
    """
    profile = surface.profile
    first, last = float(surface.station[0]), float(surface.station[-1])
    cell = parameters.cell
    raster = raster_over(first - cell / 2, last + cell / 2, cell, cell, profile)
    one, spread_one, place_one = _grid(before, raster, surface.axis, profile, parameters)
    two, spread_two, place_two = _grid(after, raster, surface.axis, profile, parameters)
    hidden = _beside_arch(surface, raster) | _beside_ground(surface, raster)
    hidden |= _is_edge(one, raster) | _beside_heap(one, raster, profile) | _beside_heap(two, raster, profile)
    thickness = np.where(hidden, np.nan, one - two + _slide(one, raster, place_two - place_one))
    sigma = np.where(np.isnan(thickness), np.nan, np.hypot(spread_one, spread_two))
    station = raster.station[:, None]
    known = ~np.isnan(thickness)
    wall = known & (station < surface.unsprayed[1] - _CORNER)
    sprayed = wall & (station > surface.unsprayed[0] + _CORNER)
    still = wall & (station < surface.unsprayed[0] - cell)
    if not sprayed.any():
        raise RecognitionError("thickness: the scans share no part of the wall that was to be sprayed")
    thickness[known & ~wall] = np.nan
    floor, floor_m2, bias = _noise(thickness, sigma, still, raster)
    size = raster.row * raster.column * (1.0 + curvature(profile, raster.along) * np.nan_to_num(two))
    return ThicknessMap(
        station=raster.station,
        along=raster.along,
        thickness=thickness,
        sigma=sigma,
        sprayed=sprayed,
        noise_floor=floor,
        noise_floor_m2=floor_m2,
        bias=bias,
        mean=float(np.average(thickness[sprayed], weights=size[sprayed])),
        area=float(size[sprayed].sum()),
        volume=float(np.sum((thickness * size)[sprayed])),
    )


def mean_per_block(grid: Array, mask: NDArray[np.bool_], row: float, column: float) -> Array:
    """Mean of the masked cells of every square of `BLOCK`, NaN where too few are measured.

    Args:
        grid: Values, shape (ns, na).
        mask: Cells that count, shape (ns, na).
        row: Height of a cell [m].
        column: Width of a cell [m].
    """
    rows, columns = max(1, round(BLOCK / row)), max(1, round(BLOCK / column))
    r, c = np.nonzero(mask)
    if not len(r):
        return np.full((0, 0), np.nan)
    r0, c0 = r.min(), c.min()
    shape = ((r.max() - r0) // rows + 1, (c.max() - c0) // columns + 1)
    block = (r - r0) // rows * shape[1] + (c - c0) // columns
    size = shape[0] * shape[1]
    count = np.bincount(block, minlength=size)
    total = np.bincount(block, grid[r, c], minlength=size)
    mean = np.where(count >= _BLOCK_FILL * rows * columns, total / np.maximum(count, 1), np.nan)
    return np.asarray(mean.reshape(shape))


def _grid(
    points: NDArray[np.float32], raster: Raster, axis: Axis, profile: Profile, parameters: ThicknessParameters
) -> tuple[Array, Array, Array]:
    """Average the wall over the cells.

    Returns:
        Mean offset [m], NaN where not measured, and its standard deviation, shape (ns, na), and the
        mean station and arc length of the points [m], shape (2, ns, na).
    """
    flat = unroll(points, axis, profile)
    flat = flat.pick(
        flat.beside
        & (flat.offset > profile.arch_line - parameters.inside)
        & (flat.offset < profile.overbreak_line + parameters.outside)
    )
    index = raster.index(flat.station, flat.along)
    inside = index < raster.shape[0] * raster.shape[1]
    index, offset = index[inside], flat.offset[inside]
    place = np.stack([flat.station[inside], flat.along[inside]])
    middle = np.append(_median(index, offset, raster), np.nan)
    with np.errstate(invalid="ignore"):
        near = np.abs(offset - middle[index]) <= parameters.scatter
    index, offset, place = index[near], offset[near], place[:, near]
    mean, count = raster.mean(index, offset)
    square, _ = raster.mean(index, (offset - np.nan_to_num(mean).ravel()[index]) ** 2)
    few = count < max(1, parameters.min_points)
    # the scatter of n points about their own mean is n - 1 wide
    error = np.sqrt(square / np.maximum(count - 1.0, 1.0))
    middles = np.stack([raster.mean(index, row)[0] for row in place])
    return np.where(few, np.nan, mean), np.where(few, np.nan, error), middles


def _slide(grid: Array, raster: Raster, apart: Array) -> Array:
    """What the wall's slope makes of points that lie at different places of a cell [m], shape (ns, na).

    Args:
        grid: Offset of the wall [m], shape (ns, na).
        raster: Its cells.
        apart: From the first scan's mean place in each cell to the second's [m], shape (2, ns, na).
    """
    slide = np.zeros_like(grid)
    for axis, size in ((0, raster.row), (1, raster.column)):
        if grid.shape[axis] >= 2:
            slope = np.clip(np.gradient(grid, size, axis=axis), -_STEEP, _STEEP)
            slide += np.nan_to_num(slope * apart[axis])
    return slide


def _is_edge(grid: Array, raster: Raster) -> NDArray[np.bool_]:
    """Mark cells too steep to say from their mean how far the wall came nearer, shape (ns, na)."""
    edge = np.zeros(grid.shape, dtype=bool)
    for axis, size in ((0, raster.row), (1, raster.column)):
        if grid.shape[axis] >= 2:
            with np.errstate(invalid="ignore"):
                edge |= np.abs(np.gradient(grid, size, axis=axis)) > _STEEP
    return edge


def _beside_heap(grid: Array, raster: Raster, profile: Profile) -> NDArray[np.bool_]:
    """Mark what lies or stands before the wall, and the wall round the arc beside it, shape (ns, na)."""
    proud = grid < profile.arch_line - _PROUD  # NaN is not
    reach = 2 * int(np.ceil(_HEAP / raster.column)) + 1
    return np.asarray(binary_dilation(proud, structure=np.ones((1, reach), dtype=bool)))


def _median(index: NDArray[np.int64], value: Array, raster: Raster) -> Array:
    """Median of the values in each cell, NaN where empty, flat, shape (ns * na,)."""
    order = np.lexsort((value, index))
    index, value = index[order], value[order]
    cells, first, count = np.unique(index, return_index=True, return_counts=True)
    out = np.full(raster.shape[0] * raster.shape[1], np.nan)
    out[cells] = (value[first + (count - 1) // 2] + value[first + count // 2]) / 2
    return out


def _beside_arch(surface: Surface, raster: Raster) -> NDArray[np.bool_]:
    """Mark cells at or right beside an arch, shape (ns, na)."""
    height = surface.profile.point(raster.along)[:, 1] - crown_height(surface.profile)
    near = np.zeros(raster.shape, dtype=bool)
    for arch in surface.arches:
        plane = arch.station + np.tan(np.radians(arch.lean_deg)) * height
        near |= np.abs(raster.station[:, None] - plane) < arch.width / 2 + _SIDE
    return near


def _beside_ground(surface: Surface, raster: Raster) -> NDArray[np.bool_]:
    """Mark cells at or right beside the floor, shape (ns, na)."""
    ground = unroll(surface.points[surface.labels == Label.GROUND], surface.axis, surface.profile)
    index = raster.index(ground.station, ground.along)[ground.beside & (np.abs(ground.offset) < 1.0)]
    on = np.append(np.zeros(raster.shape, dtype=bool), False)
    on[index] = True
    on = on[:-1].reshape(raster.shape)
    return np.asarray(binary_dilation(on, iterations=_FOOT) if on.any() else on)


def stable_points(surface: Surface) -> NDArray[np.float32]:
    """Pick the points that spraying does not move, for the registration, shape (m, 3).

    The part sprayed before, face and floor; not the wall in between, people or vehicles.
    """
    still = (Label.SPRAYED, Label.FACE, Label.GROUND)
    return np.asarray(surface.points[np.isin(surface.labels, still)], dtype=np.float32)


def _noise(
    thickness: Array, sigma: Array, still: NDArray[np.bool_], raster: Raster
) -> tuple[float, float, float]:
    """Noise of one cell, of one square metre's mean, and the bias, from the unchanged part [m]."""
    mean_sigma = float(np.sqrt(np.nanmean(sigma**2)))
    per_block = (BLOCK / raster.row) * (BLOCK / raster.column)
    predicted = mean_sigma / float(np.sqrt(per_block))
    if still.sum() < per_block:
        return mean_sigma, predicted, float("nan")
    bias = float(np.median(thickness[still]))
    floor = 1.4826 * float(np.median(np.abs(thickness[still] - bias)))
    blocks = mean_per_block(thickness, still, raster.row, raster.column)
    blocks = blocks[~np.isnan(blocks)]
    floor_m2 = float(np.sqrt(np.mean(blocks**2))) if len(blocks) >= 3 else predicted
    return floor, floor_m2, bias
