"""Fit the axis robustly to everything that runs along it: sprayed surface, arch rings, rock.

Each ring of cells (one slice, inner or outer surface) may have any offset from the design line of
its own; only how the offset changes round the ring and from ring to ring moves the axis. So the
sprayed part, arches and rock agree about one axis although they lie on different lines, and smooth
rings count more than rough ones.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Axis
from ascrcp.core.geometry import Array, unit
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import AxisParameters
from ascrcp.perception.profile_line import between
from ascrcp.perception.raster import Raster, Unrolled, raster_over, unroll

NO_ARCH, DROPPED = -1, -2  # points on no arch; points beside an arch that belong to no ring

_INSIDE, _OUTSIDE = 0.45, 0.45  # band about the two lines that is looked at in the first steps [m]
_AGREES = 0.03  # cells this far off a ring of steel are no part of it [m]; placeholder
_FLOOR = 0.003  # a ring is not believed to be smoother than this [m]: ranging noise of a cell's mean
_SETTING_OUT = 0.015  # rings are not concentric, concrete is sprayed by hand; placeholder [m]
_ARCH_SETTING_OUT = 0.004  # arches are set out with an instrument; placeholder [m]
_STEEL = 0.01  # an arch's cells scatter by no more than this about it [m]; placeholder
_ROCK_BLOCKS = 0.10  # rock is off by whole blocks, many cells alike: as if each by so much [m]; placeholder
_TUKEY = 4.0  # cells farther off than this many scales are no evidence; usual choice 4..6
_FIRST_SCALE = 0.15  # of the cells' errors, before the axis is near [m]
_NEAR = 5e-4  # a smaller move ends the approach [m, rad]
_CONVERGED = 2e-5  # a smaller move ends the fit [m, rad]
_MIN_CELLS = 8  # a ring with fewer cells says nothing about its centre
_SPRAYED_LENGTH = 1.5  # more of the arch line than this seen is the sprayed part, not arches [m]
_ONE_SURFACE = 0.10  # points spread over all of the band would have 0.19 m, rock in a cell has 0.03 m
_ARCH_ASIDE = 0.004  # an arch stands aside of the axis as a whole by this much, one sigma [m]; placeholder
_ARCH_ALIKE = 0.003  # offsets of arches from the design line differ by this much; placeholder [m]
_ALIKE_CELLS = 20.0  # so many cells of an arch are off alike: 2.5 m, a rolled segment
_ROUND_ASIDE = 0.004  # a round of sprayed concrete likewise; placeholder [m]
_ROUND = 3.0  # its length, thesis 3.3.1: about 3 m
_ARC_SEEN = 0.5  # wall is seen at a place of the arc if over this much of station [m]; placeholder
_BLOCK = 1.5  # roughness is taken as independent beyond this [m], for the uncertainty


@dataclass(frozen=True)
class Fit:
    """The fitted axis with what is needed to judge it.

    Attributes:
        axis: The axis.
        ring_station: Station of each ring used [m], shape (k,).
        ring_offset: Its offset from the design line [m], shape (k,).
        ring_outer: Whether it is an outer ring (rock) rather than one at the arch line, shape (k,).
        share: Share of the points that lie between the two lines (0.15 m more either side).
        beyond: Share of the points outside the arch line that lie farther out than that.
        compact: Share of the cells there whose points lie on one surface, not scattered in depth.
        cover: Metres of station whose wall was seen over at least a third of the arc.
        arc: Share of the arc at which wall was seen over at least _ARC_SEEN of station.
    """

    axis: Axis
    ring_station: Array
    ring_offset: Array
    ring_outer: NDArray[np.bool_]
    share: float
    beyond: float
    compact: float
    cover: float
    arc: float


@dataclass(frozen=True)
class _Cells:
    """Cells of the wall: which ring, how far off, where; all shape (m,)."""

    ring: NDArray[np.int64]
    station: Array
    along: Array
    offset: Array
    outer: NDArray[np.bool_]
    steel: NDArray[np.bool_]


def fit_axis(
    points: NDArray[np.float32],
    start: Axis,
    profile: Profile,
    parameters: AxisParameters,
    arch: NDArray[np.int64] | None = None,
    one_ring: bool = False,
) -> Fit:
    """Fit the axis by iterated, reweighted least squares.

    Args:
        points: Tunnel points, base frame [m], shape (n, 3).
        start: First estimate, good to what `approach_axis` leaves.
        profile: Design profile.
        parameters: Cells and number of iterations.
        arch: Once arches are known, the arch each point lies on, NO_ARCH or DROPPED, shape (n,).
            `start` is then good, and each arch is one ring however it leans.
        one_ring: Whether everything at the arch line is taken for one ring: arches not yet known, and
            no sprayed part. Rings of their own would let each slice of a leaning arch turn the axis.

    Returns:
        The axis with one-sigma uncertainties, and its rings.

    Raises:
        RecognitionError: If too little wall is seen to fit anything.
    """
    axis = start
    for _ in range(parameters.iterations):
        flat = unroll(points, axis, profile)
        cells = _gather(flat, profile, parameters, False, _one_ring(flat, profile) if one_ring else arch)
        axis, move = _step(axis, cells, profile, _FLOOR)
        if float(np.abs(move).max()) < _CONVERGED:
            break
    flat = unroll(points, axis, profile)
    cells = _gather(flat, profile, parameters, False, _one_ring(flat, profile) if one_ring else arch)
    _, spread, weight = _solve(cells, profile, _FLOOR)
    axis = replace(
        axis,
        direction_sigma_deg=float(np.degrees(np.hypot(spread[2], spread[3]))),
        position_sigma=float(np.hypot(spread[0], spread[1])),
        evidence=_evidence(cells, weight, parameters),
    )
    return _describe(axis, flat, cells, profile, parameters)


def steel_agreement(
    points: NDArray[np.float32], axis: Axis, profile: Profile, parameters: AxisParameters
) -> float:
    """Count the cells at the arch line that lie on one ring, those farther off it for less."""
    flat = unroll(points, axis, profile)
    cells = _gather(flat, profile, parameters, False, _one_ring(flat, profile))
    if not cells.steel.any():
        return 0.0
    error = cells.offset[cells.steel] - np.median(cells.offset[cells.steel])
    return float(np.sum(np.maximum(0.0, 1.0 - (error / _AGREES) ** 2) ** 2))


def _one_ring(flat: Unrolled, profile: Profile) -> NDArray[np.int64]:
    """Take all at the arch line for one arch, shape (n,)."""
    return np.where(flat.offset < between(profile), 0, NO_ARCH)


def approach_axis(
    points: NDArray[np.float32], start: Axis, profile: Profile, parameters: AxisParameters
) -> Axis:
    """Bring the axis near: a wide band at first, in which far cells may count, then ever narrower.

    Args:
        points: Tunnel points, few are enough, base frame [m], shape (n, 3).
        start: First estimate, good to about 2 deg and 0.3 m.
        profile: Design profile.
        parameters: Cells and number of iterations.

    Returns:
        The axis, good to about 0.1 deg and 10 mm.

    Raises:
        RecognitionError: If too little wall is seen to fit anything.
    """
    axis, scale = start, _FIRST_SCALE
    for step in range(parameters.iterations):
        wide = step < parameters.iterations // 2
        flat = unroll(points, axis, profile)
        axis, move = _step(axis, _gather(flat, profile, parameters, wide, None), profile, scale)
        if not wide and scale <= _FLOOR and float(np.abs(move).max()) < _NEAR:
            break
        scale = max(_FLOOR, scale * 0.5)
    return axis


def _step(axis: Axis, cells: _Cells, profile: Profile, scale: float) -> tuple[Axis, Array]:
    move, _, weight = _solve(cells, profile, scale)
    return _moved(axis, move, float(np.average(cells.station, weights=weight))), move


def _gather(
    flat: Unrolled,
    profile: Profile,
    parameters: AxisParameters,
    wide: bool,
    arch: NDArray[np.int64] | None,
) -> _Cells:
    low = profile.arch_line - (_INSIDE if wide else 0.5 * _INSIDE)
    high = profile.overbreak_line + (_OUTSIDE if wide else 0.5 * _OUTSIDE)
    on = flat.beside & (flat.offset > low) & (flat.offset < high)
    if arch is not None:
        on &= arch != DROPPED
        arch = arch[on]
    if on.sum() < 500:
        raise RecognitionError(
            f"no tunnel found: only {int(on.sum())} points lie near the line of profile {profile.name}"
        )
    flat = flat.pick(on)
    raster = raster_over(
        float(flat.station.min()),
        float(flat.station.max()) + 1e-6,
        parameters.cell_station,
        parameters.cell_along,
        profile,
    )
    index = raster.index(flat.station, flat.along)
    # inner and outer surface of one slice are rings of their own: arch and the rock beside it
    outer = (flat.offset > between(profile)) & (not wide)
    group = outer.astype(np.int64)
    if arch is not None:
        group = np.where(arch >= 0, 2 + arch, group)
    return _average(raster, index, flat, group)


def _average(raster: Raster, index: NDArray[np.int64], flat: Unrolled, group: NDArray[np.int64]) -> _Cells:
    """Average points over cells; group 0 inner and 1 outer surface by slice, others one arch each."""
    rows, columns = raster.shape
    size = rows * columns
    key = index + group * size
    count = np.bincount(key)
    full = np.flatnonzero(count >= 2)
    total = [np.bincount(key, v)[full] / count[full] for v in (flat.offset, flat.station, flat.along)]
    owner = full // size
    ring = np.where(owner < 2, (full % size) // columns + owner * rows, 2 * rows + owner)
    enough = np.bincount(ring)[ring] >= _MIN_CELLS
    if enough.sum() < 4 * _MIN_CELLS:
        raise RecognitionError("no tunnel found: too little wall is seen to fit an axis to it")
    _, ring = np.unique(ring[enough], return_inverse=True)
    return _Cells(
        ring, total[1][enough], total[2][enough], total[0][enough], owner[enough] == 1, owner[enough] >= 2
    )


def _medians(value: Array, ring: NDArray[np.int64]) -> Array:
    """Median of the values of each ring, shape (rings,)."""
    order = np.lexsort((value, ring))
    count = np.bincount(ring)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    low, high = first + (count - 1) // 2, first + count // 2
    return np.asarray((value[order[low]] + value[order[high]]) / 2)


def _solve(cells: _Cells, profile: Profile, scale: float) -> tuple[Array, Array, Array]:
    """One reweighted step.

    Returns:
        Move of the axis (dy, dz [m], dyaw, dpitch [rad]) about the cells' weighted mean station,
        its standard deviations, both shape (4,), and the cells' weights, shape (m,).
    """
    ring = cells.ring
    error = cells.offset - _medians(cells.offset, ring)[ring]
    rock = _ROCK_BLOCKS if cells.steel.any() else _SETTING_OUT  # where there is nothing better it counts
    set_out = np.where(cells.steel, _ARCH_SETTING_OUT, np.where(cells.outer, rock, _SETTING_OUT))
    sigma = np.maximum(1.4826 * _medians(np.abs(error), ring), scale)[ring]
    if scale <= _FLOOR:  # steel is smooth: what lies off it is rock that touches the line
        sigma = np.where(cells.steel, np.minimum(sigma, _STEEL), sigma)
    weight = np.maximum(0.0, 1.0 - (error / (_TUKEY * sigma)) ** 2) ** 2 / (sigma**2 + set_out**2)
    lever = cells.station - np.average(cells.station, weights=weight)
    normal = profile.normal(cells.along)
    design: Array = np.column_stack([normal, normal * lever[:, None]]).astype(float)
    total: Array = np.bincount(ring, weight).astype(float)
    full, full_error = design, cells.offset
    design = design - _ring_mean(design, weight, ring, total)
    error = error - _ring_mean(error[:, None], weight, ring, total)[:, 0]
    information = (design * weight[:, None]).T @ design
    target = design.T @ (weight * error)
    if cells.steel.any():
        more, pull = _alike(full, full_error, weight, cells)
        information, target = information + more, target + pull
    if not np.linalg.cond(information) < 1e9:
        raise RecognitionError("no tunnel found: the wall seen is too narrow to place the axis")
    move: Array = np.linalg.solve(information, target).astype(float)
    left = error - design @ move
    return move, _spread(cells, design, weight, left, information), weight


def _alike(design: Array, offset: Array, weight: Array, cells: _Cells) -> tuple[Array, Array]:
    """What it says of the axis that all arches are bent alike: information (4, 4) and right side (4,).

    Each arch may lie off the design line by what it likes, but by nearly the same as the others.
    """
    steel = cells.steel
    _, group = np.unique(cells.ring[steel], return_inverse=True)
    total = np.bincount(group, weight[steel])
    rows = np.column_stack([design, offset])[steel]
    mean = np.stack([np.bincount(group, weight[steel] * c) for c in rows.T], axis=-1) / total[:, None]
    belief = _ALIKE_CELLS / _ARCH_ALIKE**2
    tie = total * belief / (total + belief)
    mean = mean - np.average(mean, axis=0, weights=tie)
    both = (mean * tie[:, None]).T @ mean
    return both[:4, :4], both[:4, 4]


def _ring_mean(value: Array, weight: Array, ring: NDArray[np.int64], total: Array) -> Array:
    sums = np.stack([np.bincount(ring, weight * column) for column in value.T], axis=-1)
    return np.asarray((sums / np.maximum(total, 1e-12)[:, None])[ring])


def _spread(cells: _Cells, design: Array, weight: Array, left: Array, information: Array) -> Array:
    """Standard deviations of the move, shape (4,).

    Roughness is alike within blocks (sandwich estimate), and each arch, each round of sprayed concrete
    stands aside as a whole by what setting out leaves: dy or dz of a group moves the axis as its own
    share of the information says.
    """
    inverse = np.linalg.inv(information)
    block = np.floor(cells.station / _BLOCK).astype(np.int64) * 1000 + (cells.along / _BLOCK).astype(np.int64)
    block = 2 * block + cells.outer
    _, block = np.unique(block, return_inverse=True)
    sums = np.stack([np.bincount(block, weight * left * column) for column in design.T], axis=-1)
    covariance = sums.T @ sums
    round_ = np.floor(cells.station / _ROUND).astype(np.int64)
    group = np.where(cells.steel, cells.ring, -1 - (round_ - round_.min()))
    for number in np.unique(group[~cells.outer]):
        mine = (group == number) & ~cells.outer
        aside = _ARCH_ASIDE if number >= 0 else _ROUND_ASIDE
        share = (design[mine] * weight[mine, None]).T @ design[mine][:, :2]
        covariance = covariance + aside**2 * share @ share.T
    return np.sqrt(np.diag(inverse @ covariance @ inverse))


def _moved(axis: Axis, move: Array, middle: float) -> Axis:
    T = axis.T_base_tunnel
    left, up = T[:3, 1], T[:3, 2]
    direction = unit(axis.direction + move[2] * left + move[3] * up)
    point = axis.point + middle * axis.direction + move[0] * left + move[1] * up
    return Axis(point - direction * (point @ direction), direction)


def _evidence(cells: _Cells, weight: Array, parameters: AxisParameters) -> tuple[str, ...]:
    """Name the surfaces that carry at least a tenth of the weight."""
    inner = ~cells.outer
    row = np.floor((cells.station[inner] - cells.station.min()) / parameters.cell_station).astype(np.int64)
    length = float(np.sum(np.bincount(row) >= _MIN_CELLS)) * parameters.cell_station
    names = []
    if weight[inner].sum() > 0.1 * weight.sum():
        names.append("sprayed" if length > _SPRAYED_LENGTH else "arches")
    if weight[~inner].sum() > 0.1 * weight.sum():
        names.append("rock")
    return (*names, "profile")


def _describe(axis: Axis, flat: Unrolled, cells: _Cells, profile: Profile, parameters: AxisParameters) -> Fit:
    size = np.bincount(cells.ring)
    row = np.round(cells.station / parameters.cell_station).astype(np.int64)
    row -= row.min()
    columns = profile.length / parameters.cell_along
    cover = float(np.sum(np.bincount(row) > columns / 3) * parameters.cell_station)
    column = (cells.along / parameters.cell_along).astype(np.int64)
    pairs = np.unique(row * (column.max() + 1) + column) % (column.max() + 1)
    arc = float(np.sum(np.bincount(pairs) * parameters.cell_station >= _ARC_SEEN) / columns)
    low, high = profile.arch_line - _INSIDE / 3, profile.overbreak_line + _OUTSIDE / 3
    wall = flat.beside & (flat.offset > low) & (flat.offset < high)
    return Fit(
        axis,
        np.bincount(cells.ring, cells.station) / size,
        _medians(cells.offset, cells.ring),
        np.bincount(cells.ring, cells.outer) / size > 0.5,
        float(wall.mean()),
        float(np.mean(flat.offset[flat.beside & (flat.offset > low)] > high)),
        _compactness(flat.pick(wall), profile, parameters),
        cover,
        arc,
    )


def _compactness(flat: Unrolled, profile: Profile, parameters: AxisParameters) -> float:
    """Share of the cells with at least 3 points whose standard deviation is that of one surface."""
    if not len(flat):
        return 0.0
    first, last = float(flat.station.min()), float(flat.station.max()) + 1e-6
    raster = raster_over(first, last, parameters.cell_station, parameters.cell_along, profile)
    index = raster.index(flat.station, flat.along)
    mean, count = raster.mean(index, flat.offset)
    square, _ = raster.mean(index, flat.offset**2)
    full = count >= 3
    variance = square[full] - mean[full] ** 2
    return float(np.mean(variance < _ONE_SURFACE**2)) if full.any() else 0.0
