"""Slices across the axis: where the sprayed part ends and where the face is (thesis 3.3.3, figure 3-13)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import SectionParameters
from ascrcp.perception.profile_line import between
from ascrcp.perception.raster import Unrolled, raster_over

_FACE_CELL = 0.3  # squares of the section in which the face is looked for [m]
_FACE_STEP = 0.1  # stations tried for it [m]
_FACE_ROUGH = 0.4  # the face lies within this of its middle [m]; placeholder
_FACE_DEPTH = (
    1.0  # wall may be seen so far beyond the face's middle: a rough face, a drilled cut [m]; placeholder
)
_FACE_DENSE = 3  # times as many points as float before it make a square of the face; placeholder
_BRIDGE = 0.5  # slices not seen, up to this length, do not end the sprayed part [m]
_SEEN = 0.25  # a slice counts if it shows this share of what a typical one shows


@dataclass(frozen=True)
class Extent:
    """What lies where along the axis.

    Attributes:
        sprayed_end: Where the sprayed surface ends, s0 [m].
        end: Face, or the last wall seen, s1 [m].
        face: Station of the face [m], None if it was not seen.
        first: First station with wall [m].
    """

    sprayed_end: float
    end: float
    face: float | None
    first: float


def is_wall(flat: Unrolled, profile: Profile, parameters: SectionParameters) -> NDArray[np.bool_]:
    """Mark points in the band that may be wall, arch or overbreak, shape (n,)."""
    return np.asarray(
        flat.beside
        & (flat.offset > profile.arch_line - parameters.inside)
        & (flat.offset < profile.overbreak_line + parameters.outside)
    )


def find_extent(flat: Unrolled, profile: Profile, parameters: SectionParameters) -> Extent:
    """Find the unsprayed part from slices of 5 cm.

    Args:
        flat: All points above the floor.
        profile: Design profile.
        parameters: Slices, columns and shares.

    Returns:
        The extent; an unsprayed part of no length if only sprayed surface is seen.
    """
    wall = flat.pick(is_wall(flat, profile, parameters))
    low, high = float(wall.station.min()), float(wall.station.max()) + 1e-6
    raster = raster_over(low, high, parameters.slice, parameters.column, profile)
    mean, count = raster.mean(raster.index(wall.station, wall.along), wall.offset)
    seen = (count >= 2).sum(axis=1)
    valid = seen >= max(4.0, _SEEN * float(np.median(seen[seen > 0])))
    rows = np.flatnonzero(valid)
    if not len(rows):
        return Extent(low, low, None, low)
    first, last = low + rows[0] * raster.row, low + (rows[-1] + 1) * raster.row
    face = find_face(flat, profile, parameters, last - _FACE_DEPTH)
    end = last if face is None else face
    inner = np.sum((mean < between(profile)) & (count >= 2), axis=1) / np.maximum(seen, 1)
    sprayed = valid & (inner >= parameters.sprayed_share) & (raster.station < end)
    edge = _last_run(sprayed, valid, parameters, raster.row)
    start = first if edge is None else _refine_edge(wall, low + edge * raster.row, profile, parameters)
    if not end - start >= parameters.slice:
        start = end  # sprayed up to the last wall seen
    return Extent(float(start), float(end), face, float(first))


def _last_run(
    sprayed: NDArray[np.bool_], valid: NDArray[np.bool_], parameters: SectionParameters, row: float
) -> int | None:
    """Row after the last long run of sprayed slices, None if there is none."""
    start = previous = edge = None
    for i in np.flatnonzero(valid):
        if not sprayed[i]:
            start = None
            continue
        if start is None or (previous is not None and (i - previous) * row > _BRIDGE):
            start = i
        previous = i
        if (i + 1 - start) * row >= parameters.sprayed_length:
            edge = int(i) + 1
    return edge


def _refine_edge(wall: Unrolled, edge: float, profile: Profile, parameters: SectionParameters) -> float:
    """Median over the columns of where the sprayed surface is last seen near `edge` [m]."""
    near = (np.abs(wall.station - edge) < 3 * parameters.slice) & (wall.offset < between(profile))
    near &= wall.offset > profile.arch_line - 3 * parameters.slice
    column = (wall.along[near] / parameters.column).astype(np.int64)
    if not len(column):
        return edge
    last = np.full(int(column.max()) + 1, -np.inf)
    np.maximum.at(last, column, wall.station[near])
    return float(np.median(last[np.isfinite(last)]))


def find_face(
    flat: Unrolled, profile: Profile, parameters: SectionParameters, nearest: float = -np.inf
) -> float | None:
    """Find the wall that closes the tunnel: a slab of points all over the section.

    People and vehicles fill only a corner of the section, dust is dense only about the lidar, where
    wall goes on beyond it.

    Args:
        flat: All points above the floor.
        profile: Design profile.
        parameters: Share of the section that must be seen.
        nearest: Station before which no face is believed, since wall is seen beyond [m].

    Returns:
        Median station of the face [m], or None.
    """
    inside = (flat.offset < profile.arch_line - parameters.inside) & (
        flat.station > nearest - 2 * _FACE_ROUGH
    )
    station, yz = flat.station[inside], flat.yz[inside]
    far = station > nearest
    if far.sum() < 200:
        return None
    low = yz.min(axis=0)
    cell = ((yz - low) / _FACE_CELL).astype(np.int64)
    columns = int(cell[:, 1].max()) + 1
    key = cell[:, 0] * columns + cell[:, 1]
    first = float(station[far].min())
    slab = np.floor((station[far] - first) / _FACE_STEP).astype(np.int64)
    pairs = np.unique(slab * (key.max() + 1) + key[far])
    cover = np.bincount(pairs // (key.max() + 1))
    near = np.convolve(cover, np.ones(3), mode="same")
    middle = first + (int(near.argmax()) + 0.5) * _FACE_STEP
    on = np.abs(station - middle) < _FACE_ROUGH
    before = (station < middle - _FACE_ROUGH) & (station > middle - 3 * _FACE_ROUGH)
    # dust lies before as well as behind, rock stops every beam
    size = int(key.max()) + 1
    held, floating = np.bincount(key[on], minlength=size), np.bincount(key[before], minlength=size)
    closed = held >= _FACE_DENSE * (floating + 1)
    if closed.sum() < parameters.face_share * _section_cells(flat, profile, parameters):
        return None
    on &= closed[key]
    return float(np.median(station[on]))


def _section_cells(flat: Unrolled, profile: Profile, parameters: SectionParameters) -> float:
    """Squares of the section inside the wall band and above the lowest points seen."""
    floor = float(np.percentile(flat.yz[:, 1], 1.0))
    line: Array = profile.point(np.linspace(0.0, profile.length, 200))
    axes = [np.arange(line[:, i].min(), line[:, i].max(), _FACE_CELL) for i in (0, 1)]
    y, z = np.meshgrid(*axes, indexing="ij")
    _, offset = profile.locate(np.column_stack([y.ravel(), z.ravel()]))
    return float(np.sum((offset < profile.arch_line - parameters.inside) & (z.ravel() > floor)))
