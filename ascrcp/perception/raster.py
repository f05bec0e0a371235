"""The unrolled surface as a raster: station x arc length, counted and averaged in O(points)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Axis
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile


@dataclass(frozen=True)
class Unrolled:
    """Points in the coordinates of the tunnel.

    Attributes:
        station: Along the axis [m], shape (n,).
        along: Arc length along the design line [m], shape (n,).
        offset: Outward from the design line [m], shape (n,).
        yz: In the section plane, left and up [m], shape (n, 2).
        beside: Whether the design line runs beside the point (not past its ends), shape (n,).
    """

    station: Array
    along: Array
    offset: Array
    yz: Array
    beside: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.station)

    def pick(self, mask: NDArray[np.bool_]) -> "Unrolled":
        """Return the points under a mask, shape (n,)."""
        return Unrolled(
            self.station[mask], self.along[mask], self.offset[mask], self.yz[mask], self.beside[mask]
        )


def unroll(points: NDArray[np.float32], axis: Axis, profile: Profile) -> Unrolled:
    """Carry points of the base frame, shape (n, 3) [m], onto the unrolled surface."""
    T = axis.T_base_tunnel
    shift = axis.point @ T[:3, :3]
    # column by column: three times as fast as a product with a 3 x 3 matrix
    x, y, z = (column.astype(float) for column in points.T)
    station, left, up = (x * a + y * b + z * c - d for (a, b, c), d in zip(T[:3, :3].T, shift, strict=True))
    yz = np.column_stack([left, up])
    along, offset = profile.locate(yz)
    beside = (along > 0.0) & (along < profile.length)
    return Unrolled(station, along, offset, yz, beside)


@dataclass(frozen=True)
class Raster:
    """Equal cells on the unrolled surface; row r spans start + [r, r + 1) * row.

    Attributes:
        start: Station at which row 0 begins [m].
        row: Height of a row along the axis [m].
        column: Width of a column along the arc [m].
        shape: Rows and columns.
    """

    start: float
    row: float
    column: float
    shape: tuple[int, int]

    @property
    def station(self) -> Array:
        """Stations of the rows' middles [m], shape (rows,)."""
        return np.asarray(self.start + (np.arange(self.shape[0]) + 0.5) * self.row, dtype=float)

    @property
    def along(self) -> Array:
        """Arc lengths of the columns' middles [m], shape (columns,)."""
        return np.asarray((np.arange(self.shape[1]) + 0.5) * self.column, dtype=float)

    def index(self, station: Array, along: Array) -> NDArray[np.int64]:
        """Return the flat cell of each point, one past the last cell for points outside, shape (n,)."""
        r = np.floor((station - self.start) / self.row).astype(np.int64)
        c = np.minimum((along / self.column).astype(np.int64), self.shape[1] - 1)
        outside = (r < 0) | (r >= self.shape[0])
        return np.where(outside, self.shape[0] * self.shape[1], r * self.shape[1] + c)

    def total(self, index: NDArray[np.int64], weight: Array | None = None) -> Array:
        """Sum weights (ones by default) over cells, shape (rows, columns)."""
        size = self.shape[0] * self.shape[1]
        return np.bincount(index, weight, minlength=size + 1)[:size].reshape(self.shape).astype(float)

    def mean(self, index: NDArray[np.int64], value: Array) -> tuple[Array, Array]:
        """Average values over cells: the mean (NaN where empty) and the count, shape (rows, columns)."""
        count = self.total(index)
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.total(index, value) / count, count


def raster_over(first: float, last: float, row: float, column: float, profile: Profile) -> Raster:
    """Lay a raster from station `first` to at least `last` [m] over the whole design line.

    Columns are fitted to the design line, so that they are at most `column` wide [m] and all alike.
    """
    rows = max(1, int(np.ceil((last - first) / row - 1e-9)))
    columns = max(1, int(np.ceil(profile.length / column - 1e-9)))
    return Raster(first, row, profile.length / columns, (rows, columns))
