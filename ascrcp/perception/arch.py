"""Recognise the steel arches: four slices in a row with 3 m of arc at the arch line (thesis figure 3-18).

An arch leans, so it crosses many slices at right angles to the axis and fills none. The slices are
therefore laid along the arch: a vote over station, lean and skew finds candidates, a fit places
them, and the thesis's rule decides on slices that lean with the candidate.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Arch
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import ArchParameters, SectionParameters
from ascrcp.perception.profile_line import between, crown_height
from ascrcp.perception.raster import Raster, Unrolled, raster_over

_ROW = 0.025  # half a slice: an arch cut anywhere still fills slices of this length [m]
_PHASES = (0.0, 0.25, 0.5, 0.75)  # of a half slice
_LEAN_STEP_DEG = 0.5
_MAX_SKEW_DEG = 3.0  # turned about the vertical; placeholder
_SKEW_STEP_DEG = 1.0
_MAX_ARCHES = 12
_REACH = 0.05  # an arch's edges are looked for this far beyond half its width [m]
_SIDE = 0.02  # beside a found arch nothing is counted for another [m]; placeholder
_NEAR_EDGE, _FAR_EDGE = 0.04, 0.99  # quantiles of an arch's points taken for its edges; synthetic headings
_SHOWN = (
    0.2  # share of a cell's points on the steel from which the others are rock seen behind it; placeholder
)
_LEAST_RUN = 3  # half slices, of the narrowest arch; placeholder
_TOO_WIDE = 1.75  # times the width: more of the arch line in a row is sprayed surface, not an arch


@dataclass(frozen=True)
class Ring:
    """The middle plane of one arch: station = station + lean * z + skew * y, in the tunnel frame.

    Attributes:
        station: Where the plane meets the axis [m].
        lean: Metres of station per metre of height.
        skew: Metres of station per metre to the left.
        width: Along the axis [m].
        along: First and last arc length at which it was seen [m].
    """

    station: float
    lean: float
    skew: float
    width: float
    along: tuple[float, float]

    def distance(self, station: Array, yz: Array) -> Array:
        """Signed distance along the axis from the plane [m], shape (n,)."""
        return station - self.station - self.lean * yz[:, 1] - self.skew * yz[:, 0]


@dataclass(frozen=True)
class _Line:
    """Counts of points near the arch line on a raster of half slices."""

    station: Array  # of every row, shape (rows,)
    yz: Array  # of every column at the arch line, shape (columns, 2)
    at_line: NDArray[np.bool_]  # cells whose points are at or inside R1, shape (rows, columns)


def find_arches(
    wall: Unrolled,
    first: float,
    last: float,
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> list[Ring]:
    """Find the arches between two stations.

    Args:
        wall: Points of the wall band.
        first: Where the sprayed part ends [m]: it lies at the arch line too and is left out.
        last: Face [m].
        profile: Design profile.
        parameters: The rule's numbers.
        section: Column width.

    Returns:
        Arches by rising station.
    """
    keep = (wall.station > first) & (wall.station < last)
    keep &= wall.offset > profile.arch_line - parameters.inward
    wall = wall.pick(keep)
    if last - first < profile.arch_width or len(wall) < 100:
        return []
    hit = wall.offset <= profile.arch_line + parameters.tolerance
    line = _count(wall, hit, first, last, profile, parameters, section)
    at_line = line.at_line.copy()
    found: list[Ring] = []
    doubted: list[Ring] = []
    for _ in range(_MAX_ARCHES):
        guess = _vote(line, at_line, profile, parameters)
        if guess is None:
            break
        ring = _place(wall, hit, guess, profile, section)
        kept = None if ring is None else _checked(wall, hit, ring, profile, parameters, section)
        if kept is not None and _is_apart(kept, found, profile):
            found.append(kept)
        elif ring is not None:
            doubted.append(guess)
        mid = (kept or guess).station + line.yz @ [(kept or guess).skew, (kept or guess).lean]
        at_line &= np.abs(line.station[:, None] - mid) > profile.arch_width / 2 + _REACH
    for guess in doubted if found else []:
        # arches that lean toward each other stand side by side at the foot: once more without the others
        alone = np.all(
            [np.abs(r.distance(wall.station, wall.yz)) > r.width / 2 + _SIDE for r in found], axis=0
        )
        rest = wall.pick(alone)
        ring = _place(rest, hit[alone], guess, profile, section)
        kept = None if ring is None else _checked(rest, hit[alone], ring, profile, parameters, section)
        if kept is not None and _is_apart(kept, found, profile):
            found.append(kept)
    return sorted(found, key=lambda r: r.station)


def _is_apart(ring: Ring, found: list[Ring], profile: Profile) -> bool:
    """Whether a ring is another one than those found."""
    return all(abs(ring.station - other.station) > profile.arch_width for other in found)


def to_arch(ring: Ring, profile: Profile) -> Arch:
    """Describe a ring as the flow's Arch, whose station counts at the crown."""
    angle = np.degrees(profile.angle(np.array(ring.along)))
    return Arch(
        station=ring.station + ring.lean * crown_height(profile),
        width=ring.width,
        lean_deg=float(np.degrees(np.arctan(ring.lean))),
        span_deg=(float(angle[0]), float(angle[1])),
    )


def _count(
    wall: Unrolled,
    hit: NDArray[np.bool_],
    first: float,
    last: float,
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> _Line:
    raster = raster_over(first, last, _ROW, section.column, profile)
    inside, count = _tally(raster, wall.station, wall.along, hit, wall.offset > between(profile))
    at_line = (count > 0) & (inside >= parameters.share * count)
    return _Line(raster.station, profile.point(raster.along, profile.arch_line), at_line)


def _vote(
    line: _Line, at_line: NDArray[np.bool_], profile: Profile, parameters: ArchParameters
) -> Ring | None:
    """Find the plane with the most arc at the arch line within an arch's width and little beside it."""
    row, column = np.nonzero(at_line)
    if len(row) < 10:
        return None
    width = max(1, round(profile.arch_width / _ROW))
    # cells just beside the arch speak against a place, so that its middle wins
    kernel = np.concatenate([-0.5 * np.ones(width // 2), np.ones(width), -0.5 * np.ones(width // 2)])
    start = line.station[0] - 2.0
    best, guess = 0.6 * parameters.arc, None
    for lean in np.tan(np.radians(_steps(parameters.max_lean_deg, _LEAN_STEP_DEG))):
        for skew in np.tan(np.radians(_steps(_MAX_SKEW_DEG, _SKEW_STEP_DEG))):
            shift = line.yz @ [skew, lean]
            level = np.floor((line.station[row] - shift[column] - start) / _ROW).astype(np.int64)
            score = np.convolve(np.bincount(np.maximum(level, 0)), kernel, mode="same")
            top = int(score.argmax())
            arc = float(score[top]) / width * float(np.hypot(*(line.yz[1] - line.yz[0])))
            if arc > best * (1.0 + 0.01 * (skew != 0.0)):
                best = arc
                guess = Ring(start + top * _ROW, float(lean), float(skew), profile.arch_width, (0, 0))
    return guess


def _steps(limit_deg: float, step_deg: float) -> Array:
    n = int(np.floor(limit_deg / step_deg))
    return np.asarray(np.arange(-n, n + 1) * step_deg, dtype=float)


def _place(
    wall: Unrolled, hit: NDArray[np.bool_], guess: Ring, profile: Profile, section: SectionParameters
) -> Ring | None:
    """Fit station, lean and skew to the middles between both edges of the flange, column by column."""
    ring = guess
    half = profile.arch_width / 2 + _REACH
    columns = int(np.ceil(profile.length / section.column))
    for _ in range(4):
        distance = ring.distance(wall.station, wall.yz)
        on = hit & (np.abs(distance) < half)
        column = np.minimum((wall.along[on] / section.column).astype(np.int64), columns - 1)
        low, high = np.full(columns, np.inf), np.full(columns, -np.inf)
        np.minimum.at(low, column, distance[on])
        np.maximum.at(high, column, distance[on])
        width = high - low
        good = np.flatnonzero((width > 0.5 * profile.arch_width) & (width < 1.3 * profile.arch_width))
        if len(good) < 8:
            return None
        yz = profile.point(np.asarray((good + 0.5) * section.column, dtype=float), profile.arch_line)
        fit = _robust_plane((low[good] + high[good]) / 2, yz)
        ring = Ring(
            ring.station + float(fit[0]),
            ring.lean + float(fit[1]),
            ring.skew + float(fit[2]),
            float(np.median(width[good])),
            ring.along,
        )
    return _centred(ring, ring.distance(wall.station, wall.yz)[hit], half)


def _centred(ring: Ring, distance: Array, half: float) -> Ring:
    """Move a ring to the middle between its edges, taken from all columns together.

    Column by column the near edge lies too near, since its side is seen densely and the least of many
    noisy points counts, and the far edge too near, since it is seen sparsely.
    """
    low, high = np.quantile(distance[np.abs(distance) < half], [_NEAR_EDGE, _FAR_EDGE])
    return replace(ring, station=ring.station + float(low + high) / 2, width=float(high - low))


def _robust_plane(middle: Array, yz: Array) -> Array:
    """Fit middle = a + b z + c y with weights against bumps that touch the arch, shape (3,)."""
    design = np.column_stack([np.ones(len(middle)), yz[:, 1], yz[:, 0]])
    prior = np.diag([0.0, 1e-3, 1.0]) * len(middle) * 1e-2  # a short stretch must not invent skew
    weight = np.ones(len(middle))
    solution: Array = np.zeros(3)
    for _ in range(5):
        normal = (design * weight[:, None]).T @ design + prior
        solution = np.linalg.solve(normal, design.T @ (weight * middle)).astype(float)
        error = middle - design @ solution
        scale = max(0.004, 1.4826 * float(np.median(np.abs(error))))
        weight = np.maximum(0.0, 1.0 - (error / (4.0 * scale)) ** 2) ** 2
    return solution


def _checked(
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
        _longest(_rule(distance + phase * _ROW, along, hit, behind, profile, parameters, section))
        for phase in _PHASES
    )
    # an arch narrower than the slices of the rule cannot fill them all
    wanted = max(_LEAST_RUN, min(2 * parameters.slices, int(profile.arch_width / _ROW + 1e-6)) - 2)
    if not wanted <= run <= _TOO_WIDE * profile.arch_width / _ROW:
        return None
    middle = np.abs(distance) < 0.4 * profile.arch_width
    raster = raster_over(-1.0, 1.0, 2.0, section.column, profile)
    inside, count = _tally(raster, distance[middle], along[middle], hit[middle], behind[middle])
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
    raster = raster_over(-half, half, _ROW, section.column, profile)
    inside, count = _tally(raster, distance, along, hit, behind)
    return [
        stretch(inside[i], count[i], parameters.share)[2] * raster.column >= parameters.arc
        for i in range(raster.shape[0])
    ]


def _tally(
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
