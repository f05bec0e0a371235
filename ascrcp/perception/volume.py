"""Volumes and rock inside the line, from the unrolled wall: Surface -> bay volumes, underbreak regions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ascrcp.core.flow import Bay, Surface
from ascrcp.core.geometry import Array
from ascrcp.perception.profile_line import crown_height, curvature
from ascrcp.perception.survey import UnderbreakParameters


@dataclass(frozen=True)
class BayVolume:
    """What a bay needs.

    Attributes:
        to_design: Volume between the wall and the design line, where the wall lies outside it [m3].
        to_arch_line: The same to the arch line, where the sprayed surface will be [m3].
        area: Area of the bay on the design line [m2].
        filled_share: Share of its known cells that were in shadow and filled in.
        unknown_share: Share of its cells of which nothing is known; the volumes leave them out.
    """

    to_design: float
    to_arch_line: float
    area: float
    filled_share: float
    unknown_share: float


@dataclass(frozen=True)
class Underbreak:
    """One region of rock inside the design line: where, how large, how far in.

    Attributes:
        station: First and last station [m].
        angle_deg: First and last section angle [deg].
        area_m2: Area on the design line [m2].
        volume_m3: Volume of the rock inside the design line [m3].
        max_depth_m: How far it reaches inside [m].
        confidence: Share of its cells that were seen, not filled.
    """

    station: tuple[float, float]
    angle_deg: tuple[float, float]
    area_m2: float
    volume_m3: float
    max_depth_m: float
    confidence: float


def volume_beyond(surface: Surface, line: float) -> Array:
    """Volume of each cell between a line and the wall outside it [m3], 0 where unknown, shape (ns, na).

    Of a ring sector: the cell widens with the radius.

    Args:
        surface: Recognised heading.
        line: Offset of the line from the design line [m], outward positive.
    """
    wall = np.maximum(np.nan_to_num(surface.offset.astype(float), nan=line), line)
    return _between(surface, np.full(wall.shape, line), wall)


def _between(surface: Surface, low: Array, high: Array) -> Array:
    """Volume of each cell between two offsets [m3], shape (ns, na)."""
    widening = 1.0 + curvature(surface.profile, surface.along) * (low + high) / 2
    return np.asarray(cell_size(surface) * (high - low) * widening)


def cell_size(surface: Surface) -> float:
    """Area of one cell of the unrolled wall on the design line [m2]."""
    return float((surface.station[1] - surface.station[0]) * (surface.along[1] - surface.along[0]))


def bay_cells(surface: Surface, bay: Bay) -> NDArray[np.bool_]:
    """Mark the cells of a bay, between its arches' edges however they lean, shape (ns, na)."""
    height = surface.profile.point(surface.along)[:, 1] - crown_height(surface.profile)
    edges = []
    for station, number in zip(bay.station, (bay.arch_before, bay.arch_after), strict=True):
        lean = 0.0 if number is None else surface.arches[number].lean_deg
        edges.append(station + np.tan(np.radians(lean)) * height)
    row = surface.station[:, None]
    return np.asarray((row > edges[0]) & (row < edges[1]))


def bay_volumes(surface: Surface) -> list[BayVolume]:
    """Compute the volume to spray of every bay, in the order of `surface.bays`."""
    to_design = volume_beyond(surface, 0.0)
    to_arch_line = volume_beyond(surface, surface.profile.arch_line)
    known = ~np.isnan(surface.offset)
    found = []
    for bay in surface.bays:
        mine = bay_cells(surface, bay)
        count, there = int(mine.sum()), int((mine & known).sum())
        found.append(
            BayVolume(
                float(to_design[mine].sum()),
                float(to_arch_line[mine].sum()),
                count * cell_size(surface),
                float((mine & surface.filled).sum()) / max(1, there),
                (count - there) / max(1, count),
            )
        )
    return found


def find_underbreak(surface: Surface, parameters: UnderbreakParameters) -> list[Underbreak]:
    """Find rock inside the design line beyond the tolerance, in the unsprayed part.

    Args:
        surface: Recognised heading.
        parameters: Tolerance and the smallest region worth naming.

    Returns:
        Regions by falling volume.
    """
    first, last = surface.unsprayed
    unsprayed = (surface.station > first) & (surface.station < last)
    with np.errstate(invalid="ignore"):
        inside = (surface.offset < -parameters.tolerance) & unsprayed[:, None]
    parts, count = label(inside, structure=np.ones((3, 3)))
    wall = np.minimum(np.nan_to_num(surface.offset.astype(float), nan=0.0), 0.0)
    volume = _between(surface, wall, np.zeros(wall.shape))
    cell, found = cell_size(surface), []
    for part in range(1, count + 1):
        mine = parts == part
        area = float(mine.sum()) * cell
        if area < parameters.min_area or not (mine & ~surface.filled).any():
            continue
        found.append(
            Underbreak(
                *_extent(surface, mine),
                area_m2=area,
                volume_m3=float(volume[mine].sum()),
                max_depth_m=float(-wall[mine].min()),
                confidence=float((mine & ~surface.filled).sum() / mine.sum()),
            )
        )
    return sorted(found, key=lambda region: -region.volume_m3)


def _extent(surface: Surface, mine: NDArray[np.bool_]) -> tuple[tuple[float, float], tuple[float, float]]:
    """First and last station [m] and section angle [deg] of some cells, their edges included."""
    rows, columns = np.nonzero(mine)
    row = float(surface.station[1] - surface.station[0]) / 2
    column = float(surface.along[1] - surface.along[0]) / 2
    along = surface.along[[columns.min(), columns.max()]] + [-column, column]
    angle = np.degrees(surface.profile.angle(along))
    return (
        (float(surface.station[rows.min()]) - row, float(surface.station[rows.max()]) + row),
        (float(angle[0]), float(angle[1])),
    )
