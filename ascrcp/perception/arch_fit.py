"""Place an arch: station, lean and skew from the middles between both edges of its flange."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import SectionParameters
from ascrcp.perception.raster import Unrolled
from ascrcp.perception.ring import Ring

REACH = 0.05  # an arch's edges are looked for this far beyond half its width [m]
_NEAR_EDGE, _FAR_EDGE = 0.04, 0.99  # quantiles of an arch's points taken for its edges; synthetic headings
_LEAST_WHOLE = 12  # columns that show an arch whole: the arc of the rule; with fewer all count


def place(
    wall: Unrolled, hit: NDArray[np.bool_], guess: Ring, profile: Profile, section: SectionParameters
) -> Ring | None:
    """Fit station, lean and skew to the middles between both edges of the flange, column by column."""
    ring = guess
    half = profile.arch_width / 2 + REACH
    columns = int(np.ceil(profile.length / section.column))
    yz = profile.point(
        np.asarray((np.arange(columns) + 0.5) * section.column, dtype=float), profile.arch_line
    )
    column = np.minimum((wall.along / section.column).astype(np.int64), columns - 1)
    ends = float(wall.station.min()) + half, float(wall.station.max()) - half
    whole = np.ones(columns, dtype=bool)
    for _ in range(4):
        distance = ring.distance(wall.station, wall.yz)
        on = hit & (np.abs(distance) < half)
        low, high = np.full(columns, np.inf), np.full(columns, -np.inf)
        np.minimum.at(low, column[on], distance[on])
        np.maximum.at(high, column[on], distance[on])
        width = high - low
        full = (width > 0.5 * profile.arch_width) & (width < 1.3 * profile.arch_width)
        # where the face or the sprayed part cuts an arch, its middle is not that of what is seen
        middle = -ring.distance(np.zeros(columns), yz)
        whole = (middle > ends[0]) & (middle < ends[1])
        if (full & whole).sum() < _LEAST_WHOLE:
            whole[:] = True
        good = np.flatnonzero(full & whole)
        if len(good) < 8:
            return None
        fit = _robust_plane((low[good] + high[good]) / 2, yz[good])
        ring = Ring(
            ring.station + float(fit[0]),
            ring.lean + float(fit[1]),
            ring.skew + float(fit[2]),
            float(np.median(width[good])),
            ring.along,
        )
    return _centred(ring, ring.distance(wall.station, wall.yz)[hit & whole[column]], half)


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
