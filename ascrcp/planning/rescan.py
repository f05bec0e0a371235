"""What a second scan found on the grid of the target: points -> surface after spraying."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, median_filter

from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array
from ascrcp.perception.raster import Unrolled, unroll
from ascrcp.planning.target import Target

BEFORE_M = 0.15  # echoes further before the wanted surface are no wall: people, dust, hose; placeholder
BEHIND_M = 0.05  # and further behind the wall of the first scan; twice its roughness in a cell
STEEL_M = 0.02  # an echo beside an arch is of rock only so far outside its outer flange; placeholder
LEAST_POINTS = 2  # in a cell
BRIDGE_CELLS = 2.5  # unseen cells no further than this from seen ones take their value
AROUND_CELLS = 4  # seen cells so near tell by how much an unseen one misses what was expected


def find_after(
    points: NDArray[np.float32], surface: Surface, target: Target, expected: Array | None = None
) -> Array:
    """Average the wall a second scan saw over the target's cells.

    Of what it did not see, behind arches and rims, the mean of two guesses is believed: between the cells
    that were seen, and what was sprayed there. Against the true wall of 24 simulated headings each errs by
    40 to 55 mm.

    Args:
        points: The second scan, registered onto the first, base frame [m], shape (n, 3).
        surface: The first scan, recognised.
        target: Grid, and the wall before spraying.
        expected: Offset that was to be left by what was sprayed [m], shape (ns, na); None if not known.

    Returns:
        Offset from the design line [m], NaN where not seen, shape (ns, na).
    """
    index, echo = _on_wall(unroll(points, surface.axis, surface.profile), surface, target)
    count = np.bincount(index, minlength=target.offset.size).reshape(target.offset.shape)

    def mean(value: Array) -> Array:
        return np.bincount(index, value, minlength=count.size).reshape(count.shape) / np.maximum(count, 1)

    station, found = mean(echo.station), np.where(count >= LEAST_POINTS, mean(echo.offset), np.nan)
    after = np.full(count.shape, np.nan)
    for mask in (target.arch, ~target.arch):
        seen = np.isfinite(found) & mask
        after[seen] = _to_middle(found, station, seen, target.station)[seen]
        _bridge(after, seen, mask)
        holes = mask & ~seen & np.isfinite(after)
        if expected is not None and holes.any():
            after[holes] = (after[holes] + _expect(after, seen, holes, expected)) / 2.0
    return after


def _on_wall(flat: Unrolled, surface: Surface, target: Target) -> tuple[NDArray[np.int64], Unrolled]:
    """Choose the echoes of the wall and of arches' inner flanges; return their cells (k,) and themselves."""
    ds, da = target.cell
    row = np.rint((flat.station - target.station[0]) / ds).astype(np.int64)
    column = np.rint((flat.along - target.along[0]) / da).astype(np.int64)
    shape = target.offset.shape
    ok = flat.beside & (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    row, column, flat = row[ok], column[ok], flat.pick(ok)
    arch, wanted, before = (grid[row, column] for grid in (target.arch, target.wanted, target.offset))
    offset = flat.offset
    # an unseen pocket may be deeper than it was taken for
    deeper = (offset < surface.profile.overbreak_line + 1.0) & ~arch & (offset > wanted)
    near = (offset > wanted - BEFORE_M) & ((offset < before + BEHIND_M) | deeper)
    # web and outer flange stand before the rock beside an arch
    for lid in target.arches:
        beside = np.abs(flat.station - lid.station[column]) < lid.half + ds / 2.0
        near &= arch | ~beside | (offset > lid.outer + STEEL_M)
    return (row * shape[1] + column)[near], flat.pick(near)


def _to_middle(found: Array, station: Array, seen: NDArray[np.bool_], middle: Array) -> Array:
    """Read the wall at the middles of cells, between the middles of their echoes and of the next cell's.

    Of a flank that turns its back to the lidar only the rim's side is seen: the mean of a cell's echoes is
    that of a place beside its middle, on a flank of 2 m/m by up to 60 mm too high.

    Args:
        found: Mean offset of each cell's echoes [m], shape (ns, na).
        station: Mean station of them [m], shape (ns, na).
        seen: Cells of one kind of surface that have echoes, shape (ns, na).
        middle: Stations of the rows [m], shape (ns,).

    Returns:
        Offset [m], shape (ns, na); a cell whose neighbour on that side has no echoes keeps its mean.
    """
    after = found.copy()
    short = middle[:, None] - station
    for here, there, sign in ((np.s_[:-1], np.s_[1:], 1.0), (np.s_[1:], np.s_[:-1], -1.0)):
        ok = seen[here] & seen[there] & (sign * short[here] > 0.0)
        share = short[here][ok] / (station[there] - station[here])[ok]
        after[here][ok] += share * (found[there] - found[here])[ok]
    return after


def _expect(after: Array, seen: NDArray[np.bool_], holes: NDArray[np.bool_], expected: Array) -> Array:
    """Guess unseen cells (k,) from what was sprayed and how much the seen ones round them miss that [m]."""
    size = 2 * AROUND_CELLS + 1
    missed = np.pad(np.where(seen, after - expected, np.nan), AROUND_CELLS, constant_values=np.nan)
    around = sliding_window_view(missed, (size, size))[holes].reshape(-1, size * size)
    known = np.isfinite(around).any(axis=1)
    guess = expected[holes]
    guess[known] += np.nanmedian(around[known], axis=1)
    return np.asarray(guess)


def _bridge(after: Array, seen: NDArray[np.bool_], mask: NDArray[np.bool_]) -> None:
    """Fill small holes of one kind of surface, in place.

    A hole between two seen cells of one column is what the lidar, looking along the tunnel, did not see
    behind a rim: the chord between them is its line of sight, and the wall lies no nearer. Other holes take
    their nearest neighbours' value.
    """
    if not seen.any():
        return
    far, nearest = distance_transform_edt(~seen, return_indices=True)
    fill = mask & ~seen & (far <= BRIDGE_CELLS)
    value = median_filter(after[tuple(nearest)], 3, mode="nearest")
    for column in np.flatnonzero(fill.any(axis=0) & seen.any(axis=0)):
        known, holes = np.flatnonzero(seen[:, column]), np.flatnonzero(fill[:, column])
        between = _is_between(holes, known, mask[:, column])
        value[holes[between], column] = np.interp(holes[between], known, after[known, column])
    after[fill] = value[fill]


def _is_between(
    holes: NDArray[np.int64], known: NDArray[np.int64], mask: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether seen rows of the same surface stand close on both sides of the holes of a column, (n,)."""
    after = np.searchsorted(known, holes)
    inner = (after > 0) & (after < len(known))
    first, last = known[np.maximum(after - 1, 0)], known[np.minimum(after, len(known) - 1)]
    foreign = np.concatenate([[0], np.cumsum(~mask)])
    return np.asarray(inner & (last - first <= 2.0 * BRIDGE_CELLS + 1.0) & (foreign[last] == foreign[first]))
