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
from ascrcp.perception.arch_fit import REACH, place
from ascrcp.perception.arch_rule import ROW, check_rule, tally
from ascrcp.perception.parameter import ArchParameters, SectionParameters
from ascrcp.perception.profile_line import between, crown_height
from ascrcp.perception.raster import Unrolled, raster_over
from ascrcp.perception.ring import Ring, gap

_LEAN_STEP_DEG = 0.5
_MAX_SKEW_DEG = 3.0  # turned about the vertical; placeholder
_SKEW_STEP_DEG = 1.0
_MAX_ARCHES = 12
_SIDE = 0.02  # beside a found arch nothing is counted for another [m]; placeholder


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
    found, doubted = _separate(wall, hit, line, profile, parameters, section)
    for guess in doubted:
        # arches that lean toward each other touch at the foot: once more where it stands alone
        rivals = found + [other for other in doubted if other is not guess]
        kept = _alone(wall, hit, guess, rivals, profile, parameters, section)
        if kept is not None and _is_apart(kept, found, profile, parameters):
            found.append(kept)
    return sorted(_replaced(wall, hit, found, profile, parameters, section), key=lambda r: r.station)


def _separate(
    wall: Unrolled,
    hit: NDArray[np.bool_],
    line: _Line,
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> tuple[list[Ring], list[Ring]]:
    """Vote and check one arch after the other; return those found and the guesses the rule refused."""
    at_line = line.at_line.copy()
    found: list[Ring] = []
    doubted: list[Ring] = []
    for _ in range(_MAX_ARCHES):
        guess = _vote(line, at_line, profile, parameters)
        if guess is None:
            break
        ring = place(wall, hit, guess, profile, section)
        kept = None if ring is None else check_rule(wall, hit, ring, profile, parameters, section)
        if kept is not None and _is_apart(kept, found, profile, parameters):
            found.append(kept)
        elif ring is not None:
            doubted.append(guess)
        mid = (kept or guess).station + line.yz @ [(kept or guess).skew, (kept or guess).lean]
        at_line &= np.abs(line.station[:, None] - mid) > profile.arch_width / 2 + REACH
    return found, doubted


def _alone(
    wall: Unrolled,
    hit: NDArray[np.bool_],
    guess: Ring,
    rivals: list[Ring],
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> Ring | None:
    """Place and check an arch by the part of it beside which no other one stands."""
    own = guess.distance(wall.station, wall.yz)
    clear = np.ones(len(wall), dtype=bool)
    for rival in rivals:
        other = rival.distance(wall.station, wall.yz)
        clear &= np.abs(other) > rival.width / 2 + _SIDE
        clear &= np.abs(own - other) > profile.arch_width + 2 * REACH
    if not clear.any():
        return None
    rest = wall.pick(clear)
    ring = place(rest, hit[clear], guess, profile, section)
    return None if ring is None else check_rule(rest, hit[clear], ring, profile, parameters, section)


def _replaced(
    wall: Unrolled,
    hit: NDArray[np.bool_],
    found: list[Ring],
    profile: Profile,
    parameters: ArchParameters,
    section: SectionParameters,
) -> list[Ring]:
    """Place those arches again that stand close beside another somewhere: it drew them toward itself."""
    placed = []
    for ring in found:
        rivals = [r for r in found if r is not ring]
        near = [gap(ring, r, profile).min() for r in rivals]
        if min(near, default=np.inf) < profile.arch_width + 2 * REACH:
            again = _alone(wall, hit, ring, rivals, profile, parameters, section)
            # its span is that of the whole arch, not of what stands alone
            ring = ring if again is None else replace(again, along=ring.along)
        placed.append(ring)
    return placed


def _is_apart(ring: Ring, found: list[Ring], profile: Profile, parameters: ArchParameters) -> bool:
    """Whether a ring is another one than those found: clear of each over the arc of the rule."""
    gaps = [gap(ring, other, profile) for other in found]
    return all(np.mean(free > profile.arch_width) * profile.length >= parameters.arc for free in gaps)


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
    raster = raster_over(first, last, ROW, section.column, profile)
    inside, count = tally(raster, wall.station, wall.along, hit, wall.offset > between(profile))
    at_line = (count > 0) & (inside >= parameters.share * count)
    return _Line(raster.station, profile.point(raster.along, profile.arch_line), at_line)


def _vote(
    line: _Line, at_line: NDArray[np.bool_], profile: Profile, parameters: ArchParameters
) -> Ring | None:
    """Find the plane with the most arc at the arch line within an arch's width and little beside it."""
    row, column = np.nonzero(at_line)
    if len(row) < 10:
        return None
    width = max(1, round(profile.arch_width / ROW))
    # cells just beside the arch speak against a place, so that its middle wins
    kernel = np.concatenate([-0.5 * np.ones(width // 2), np.ones(width), -0.5 * np.ones(width // 2)])
    start = line.station[0] - 2.0
    best, guess = 0.6 * parameters.arc, None
    for lean in np.tan(np.radians(_steps(parameters.max_lean_deg, _LEAN_STEP_DEG))):
        for skew in np.tan(np.radians(_steps(_MAX_SKEW_DEG, _SKEW_STEP_DEG))):
            shift = line.yz @ [skew, lean]
            level = np.floor((line.station[row] - shift[column] - start) / ROW).astype(np.int64)
            score = np.convolve(np.bincount(np.maximum(level, 0)), kernel, mode="same")
            top = int(score.argmax())
            arc = float(score[top]) / width * float(np.hypot(*(line.yz[1] - line.yz[0])))
            if arc > best * (1.0 + 0.01 * (skew != 0.0)):
                best = arc
                guess = Ring(start + top * ROW, float(lean), float(skew), profile.arch_width, (0, 0))
    return guess


def _steps(limit_deg: float, step_deg: float) -> Array:
    n = int(np.floor(limit_deg / step_deg))
    return np.asarray(np.arange(-n, n + 1) * step_deg, dtype=float)
