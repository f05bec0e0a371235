"""Check a candidate by the rule of thesis figure 3-18: slices in a row with 3 m of arc at the arch line."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import ArchParameters, SectionParameters
from ascrcp.perception.profile_line import between
from ascrcp.perception.raster import Raster, Unrolled, raster_over
from ascrcp.perception.ring import Ring

ROW = 0.025  # half a slice: an arch cut anywhere still fills slices of this length [m]
_PHASES = (0.0, 0.25, 0.5, 0.75)  # of a half slice
_SHOWN = 0.2  # share of a cell's points on steel from which the others are rock behind it; placeholder
_LEAST_RUN = 3  # half slices, of the narrowest arch; placeholder
_TOO_WIDE = 1.75  # times the width: more of the arch line in a row is sprayed surface, not an arch


def check_rule(
    wall: Unrolled,
    hit: NDArray[np.bool_],
    ring: Ring,
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> Ring | None:
    """Apply the rule of figure 3-18 on half slices that lean with the candidate.

    n slices of 5 cm cut anywhere cover at least 2 n - 2 whole half slices of an arch. Where the half
    slices begin is as arbitrary, so that the best of several beginnings counts.
    """
    if not abs(np.degrees(np.arctan(ring.lean))) <= parameters.max_lean_deg:
        return None
    distance = ring.distance(wall.station, wall.yz)
    near = np.abs(distance) < profile.arch_width * 2
    distance, along, hit = distance[near], wall.along[near], hit[near]
    behind = wall.offset[near] > between(profile)
    run = max(
        _longest(_rule(distance + phase * ROW, along, hit, behind, profile, parameters, section))
        for phase in _PHASES
    )
    # an arch narrower than the slices of the rule cannot fill them all
    wanted = max(_LEAST_RUN, min(2 * parameters.slices, int(profile.arch_width / ROW + 1e-6)) - 2)
    if not wanted <= run <= _TOO_WIDE * profile.arch_width / ROW:
        return None
    middle = np.abs(distance) < 0.4 * profile.arch_width
    raster = raster_over(-1.0, 1.0, 2.0, section.column, profile)
    inside, count = tally(raster, distance[middle], along[middle], hit[middle], behind[middle])
    return replace(ring, along=_span(inside[0], count[0], raster.column))


def _rule(
    distance: Array,
    along: Array,
    hit: NDArray[np.bool_],
    behind: NDArray[np.bool_],
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> list[bool]:
    """Whether each half slice has the arc the rule asks for, at distances from the arch's plane."""
    half = profile.arch_width * 1.5
    raster = raster_over(-half, half, ROW, section.column, profile)
    inside, count = tally(raster, distance, along, hit, behind)
    return [
        stretch(inside[i], count[i], parameters.share)[2] * raster.column >= parameters.arc
        for i in range(raster.shape[0])
    ]


def tally(
    raster: Raster, station: Array, along: Array, hit: NDArray[np.bool_], behind: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Count the points at the arch line, and all, in each cell, shape (rows, columns).

    From the lidar the wall shows slantwise past the near edge of a flange, at the flange's own
    stations. Where a cell shows steel, rock behind it does not speak against the arch.
    """
    index = raster.index(station, along)
    count, inside = raster.total(index), raster.total(index, hit.astype(float))
    hidden = raster.total(index, behind.astype(float))
    return inside, np.where((inside > 0) & (inside >= _SHOWN * count), count - hidden, count)


def _span(inside: Array, count: Array, column: float) -> tuple[float, float]:
    """First and last arc length at which three columns in a row show the arch [m].

    Gaps between them are bumps, pockets seen behind it or things that stand before it.
    """
    hit = inside >= np.maximum(0.5 * count, 1.0)
    runs = np.convolve(hit, np.ones(3), mode="valid") >= 3
    places = np.flatnonzero(runs)
    if not len(places):
        return 0.0, 0.0
    return float(places[0] * column), float((places[-1] + 3) * column)


def stretch(inside: Array, count: Array, share: float) -> tuple[int, int, int]:
    """Find the longest stretch of columns in which at least `share` of those seen are at the line.

    A column is at the line if at least `share` of its points are. Columns without points neither
    help nor hurt: what stands before the wall must not end an arch.

    Args:
        inside: Points at or inside R1 in each column, shape (columns,).
        count: All points in each column, shape (columns,).
        share: Share wanted.

    Returns:
        First column, last column, and how many columns of them were seen.
    """
    seen = np.flatnonzero(count > 0)
    if not len(seen):
        return 0, -1, 0
    gain = np.where(inside[seen] >= share * count[seen], 1.0 - share, -share)
    total = np.concatenate([[0.0], np.cumsum(gain)])
    # the farthest later place at which the sum is not lower: running maximum from the right
    reach = np.maximum.accumulate(total[::-1])[::-1]
    last = len(reach) - 1 - np.searchsorted(reach[::-1], total[:-1] - 1e-9)
    length = last - np.arange(len(seen))
    i = int(length.argmax())
    if length[i] <= 0:
        return 0, -1, 0
    return int(seen[i]), int(seen[last[i] - 1]), int(length[i])


def _longest(flags: list[bool]) -> int:
    """Most flags in a row, of which one may be missing: half a slice is no slice of the rule."""
    best = run = since_gap = 0
    for flag in flags:
        run, since_gap = (run + 1, since_gap + 1) if flag else (since_gap, 0)
        best = max(best, run)
    return best
