"""Fill cells of the unrolled wall that nobody saw: gaps in sampling, shadows, the last cells at an end."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array

_SLOPE_CELLS = 3  # cells beyond a shadow's rim that give the slope there; synthetic headings
_STEEPEST = 0.1  # a rim deepens by no more than this into the shadow [m per cell]; placeholder


def bulge(grid: Array, longest: int) -> Array:
    """Fill shadows along the axis, going on at the slopes that both rims have, never nearer than straight.

    A pocket whose rim still deepens where its shadow begins is deeper within; straight lines from rim
    to rim would miss a third of it. What stood nearer than the straight line would mostly be in sight.

    Args:
        grid: Offsets [m], NaN where unknown, shape (ns, na).
        longest: Shadows filled [cells].

    Returns:
        The grid with those cells filled: a cubic from rim to rim (Hermite), shape (ns, na).
    """
    n = len(grid)
    row, before, after, gap = _rims(grid, longest)

    def at(rows: NDArray[np.int64]) -> Array:
        value = np.take_along_axis(grid, np.clip(rows, 0, n - 1), axis=0)
        return np.where((rows >= 0) & (rows < n), value, np.nan)

    length = np.maximum(after - before, 1)
    straight = (at(after) - at(before)) / length
    rising = (at(before - 1) - at(before - 1 - _SLOPE_CELLS)) / _SLOPE_CELLS - straight
    falling = straight - (at(after + 1 + _SLOPE_CELLS) - at(after + 1)) / _SLOPE_CELLS
    rim = [np.clip(np.nan_to_num(slope), -_STEEPEST, _STEEPEST) for slope in (rising, falling)]
    part = (row - before) / length
    more = length * part * (1.0 - part) * ((1.0 - part) * rim[0] + part * rim[1])
    return np.where(gap, bridge(grid, 0, longest) + np.maximum(more, 0.0), grid)


def _rims(
    g: Array, longest: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Rows, the known rows before and after each cell, and whether it lies in a gap that may be filled."""
    n = len(g)
    row = np.arange(n).reshape((n,) + (1,) * (g.ndim - 1))
    known = ~np.isnan(g)
    before = np.maximum.accumulate(np.where(known, row, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, row, n)[::-1], axis=0)[::-1]
    gap = ~known & (before >= 0) & (after < n) & (after - before - 1 <= longest)
    return row, before, after, gap


def bridge(grid: Array, axis: int, longest: int) -> Array:
    """Fill runs of at most `longest` NaN between two values linearly along one direction."""
    g = np.moveaxis(grid, axis, 0)
    row, before, after, gap = _rims(g, longest)
    n = len(g)
    low = np.take_along_axis(g, np.maximum(before, 0), axis=0)
    high = np.take_along_axis(g, np.minimum(after, n - 1), axis=0)
    part = (row - before) / np.maximum(after - before, 1)
    return np.moveaxis(np.where(gap, low + (high - low) * part, g), 0, axis)


def extend(grid: Array, cells: int) -> Array:
    """Carry the first and last known value of each column outward along the axis by some rows."""
    n = len(grid)
    row = np.arange(n)[:, None]
    known = ~np.isnan(grid)
    before = np.maximum.accumulate(np.where(known, row, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, row, n)[::-1], axis=0)[::-1]
    low = np.take_along_axis(grid, np.maximum(before, 0), axis=0)
    high = np.take_along_axis(grid, np.minimum(after, n - 1), axis=0)
    out = np.where(~known & (before >= 0) & (row - before <= cells), low, grid)
    return np.where(np.isnan(out) & (after < n) & (after - row <= cells), high, out)
