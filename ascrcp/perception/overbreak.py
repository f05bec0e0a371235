"""Recognise overbreak: runs of 20 cm beyond R2 along the arc, joined over slices (thesis figure 3-16)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from ascrcp.core.flow import Overbreak
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import OverbreakParameters
from ascrcp.perception.profile_line import curvature
from ascrcp.perception.section import Extent
from ascrcp.perception.wall import Wall

_RIM = 2  # cells beside a shadow whose depth is not trusted
_AROUND = np.ones((3, 3), dtype=bool)


def find_overbreak(
    wall: Wall, extent: Extent, profile: Profile, parameters: OverbreakParameters, floor_seen: bool = True
) -> tuple[list[Overbreak], NDArray[np.bool_]]:
    """Find the overbreak regions of the unsprayed part.

    Args:
        wall: Unrolled wall.
        extent: Where the unsprayed part lies.
        profile: Design profile.
        parameters: The rule's numbers and the smallest region worth naming.
        floor_seen: Whether what lies below the floor is gone. If not, standing water may mirror the
            wall, and what reaches the foot of the design line is not believed.

    Returns:
        Regions by falling volume seen, and the cells that belong to them, shape (ns, na).
    """
    line = profile.overbreak_line
    unsprayed = wall.raster.station > extent.sprayed_end
    with np.errstate(invalid="ignore"):
        deep = (wall.offset > line) & unsprayed[:, None]
    seen = deep & ~wall.filled & beyond_runs(wall, line, parameters)
    # cells in shadow join what is seen on both sides of an arch, but found nothing themselves
    shadow = (deep & wall.filled) | (across_shadow(seen, wall.filled) & unsprayed[:, None])
    parts, count = label(seen | shadow, structure=_AROUND)
    area, volume = cell_area(wall, profile) * wall.share, cell_volume(wall, profile) * wall.share
    regions: list[tuple[Overbreak, int]] = []
    for part in range(1, count + 1):
        mine = (parts == part) & seen
        if not floor_seen and (mine[:, 0].any() or mine[:, -1].any()):
            continue
        if area[mine].sum() < parameters.min_area:
            continue
        depth = float((wall.offset[mine] - line).max())
        mean = float(volume[mine].sum() / area[mine].sum())
        if depth >= parameters.min_depth and mean >= parameters.min_mean_depth:
            region = _region(wall, parts == part, mine, area, volume, depth, profile)
            last = min(region.station[1], extent.end)  # the last row may reach into the face
            regions.append((replace(region, station=(region.station[0], last)), part))
    regions.sort(key=lambda r: -r[0].volume_m3)
    chosen = np.isin(parts, [part for _, part in regions])
    return [region for region, _ in regions], chosen


def across_shadow(seen: NDArray[np.bool_], filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark shadows along the axis that have overbreak at both their ends: one pocket cut by an arch.

    At a shadow's rim some cells hold echoes that mix steel and rock, so that the next few count too.

    Args:
        seen: Cells found to be overbreak, shape (ns, na).
        filled: Cells in shadow, shape (ns, na).

    Returns:
        Cells in shadow, and rims, that join what lies on both sides, shape (ns, na).
    """
    row = np.arange(len(seen))[:, None]
    before = np.maximum.accumulate(np.where(seen, row, -1), axis=0)
    after = np.minimum.accumulate(np.where(seen, row, len(seen))[::-1], axis=0)[::-1]
    between_both = ~seen & (before >= 0) & (after < len(seen))
    # open cells passed on the way from one side to the other: rims only
    opened = np.cumsum(~filled & ~seen, axis=0)
    first, last = np.maximum(before, 0), np.minimum(after, len(seen) - 1)
    passed: NDArray[np.int64] = np.take_along_axis(opened, last, 0) - np.take_along_axis(opened, first, 0)
    shaded = (last - first - 1) - passed
    return np.asarray(between_both & (passed <= 2 * _RIM) & (shaded > 0))


def beyond_runs(wall: Wall, line: float, parameters: OverbreakParameters) -> NDArray[np.bool_]:
    """Mark cells within a run along the arc in which enough of the points lie beyond R2.

    A cell that was bridged over a sampling gap counts as one point.
    """
    bridged = (wall.count == 0) & ~np.isnan(wall.offset) & ~wall.filled
    with np.errstate(invalid="ignore"):
        beyond = np.where(bridged, wall.offset > line, wall.beyond)
    count = np.where(bridged, 1.0, wall.count)
    cells = max(1, round(parameters.run / wall.raster.column))
    if count.shape[1] < cells:
        return np.zeros(count.shape, dtype=bool)
    points = np.lib.stride_tricks.sliding_window_view(count, cells, axis=1).sum(axis=-1)
    outside = np.lib.stride_tricks.sliding_window_view(beyond, cells, axis=1).sum(axis=-1)
    run = (points >= cells / 2) & (outside >= parameters.share * points)
    marked = np.zeros(count.shape, dtype=bool)
    for shift in range(cells):
        marked[:, shift : shift + run.shape[1]] |= run
    return marked


def cell_area(wall: Wall, profile: Profile) -> Array:
    """Area of each cell on the overbreak line [m2], shape (ns, na)."""
    flat = wall.raster.row * wall.raster.column
    row = flat * (1.0 + profile.overbreak_line * curvature(profile, wall.raster.along))
    return np.broadcast_to(row, wall.offset.shape)


def cell_volume(wall: Wall, profile: Profile) -> Array:
    """Volume of each cell between overbreak line and wall [m3], 0 where the wall lies inside, (ns, na).

    Of a ring sector: the cell widens with the radius.
    """
    line = profile.overbreak_line
    depth = np.maximum(np.nan_to_num(wall.offset, nan=line) - line, 0.0)
    widening = 1.0 + curvature(profile, wall.raster.along) * (line + depth / 2)
    return np.asarray(wall.raster.row * wall.raster.column * depth * widening)


def _region(
    wall: Wall,
    whole: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    area: Array,
    volume: Array,
    depth: float,
    profile: Profile,
) -> Overbreak:
    rows, columns = np.nonzero(whole)
    half_row, half_column = wall.raster.row / 2, wall.raster.column / 2
    station = wall.raster.station[[rows.min(), rows.max()]] + [-half_row, half_row]
    along = wall.raster.along[[columns.min(), columns.max()]] + [-half_column, half_column]
    angle = np.degrees(profile.angle(along))
    # what was seen of it, times how clearly its points lie beyond the line
    clear = float(wall.beyond[seen].sum() / max(1.0, wall.count[seen].sum()))
    return Overbreak(
        station=(float(station[0]), float(station[1])),
        angle_deg=(float(angle[0]), float(angle[1])),
        area_m2=float(area[whole].sum()),
        volume_m3=float(volume[whole].sum()),
        max_depth_m=depth,
        confidence=float(seen.sum() / whole.sum()) * clear,
    )
