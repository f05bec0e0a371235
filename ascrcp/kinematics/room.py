"""The hollow of the heading: Surface -> points on wall, arches, floor and face, and what is solid."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Label, Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.core.profile import Profile

COLUMN = 0.25
"""Side of the columns that floor and face are averaged over [m]."""

SPAN_SLACK_DEG = 5.0
"""An arch goes on this far beyond the span in which it was seen [deg]: its feet stand in shadow."""


class Room:
    """The hollow as height maps: wall over (s, along), floor over (s, y), face over (y, z).

    Wall that was not seen takes the nearest that was. Behind the scanned part the arch line stands for
    the sprayed lining, which covers the arches.

    Args:
        surface: The heading.
        s, y, z: Rising nodes along the tunnel frame's axes, evenly spaced [m].

    Raises:
        InputError: A wall without any value.
    """

    def __init__(self, surface: Surface, s: Array, y: Array, z: Array) -> None:
        self._profile = surface.profile
        self._s, self._y, self._z = s, y, z
        self._cell = float(s[1] - s[0])
        local = apply_transform(inverse_transform(surface.axis.T_base_tunnel), surface.points.astype(float))
        self._floor = self._find_floor(local[surface.labels == Label.GROUND])
        face = local[surface.labels == Label.FACE]
        self._face = _column_means(face[:, 1:], face[:, 0], y, z) if len(face) else None
        self._along = np.asarray(surface.along, dtype=float)
        self._station, self._offset, self._steel = self._find_wall(surface)

    def wall_points(self) -> Array:
        """Return points on the rock and on the rims of its pockets, tunnel frame (n, 3) [m]."""
        return self._lining(~self._steel)

    def arch_points(self) -> Array:
        """Return points on the arches' inner flanges and sides, tunnel frame (n, 3) [m]."""
        return self._lining(self._steel)

    def floor_points(self) -> Array:
        """Return points on the floor, tunnel frame (n, 3) [m]."""
        S, Y = np.meshgrid(self._s, self._y, indexing="ij")
        return np.stack([S, Y, self._floor], axis=-1).reshape(-1, 3)

    def face_points(self) -> Array:
        """Return points on the face, tunnel frame (n, 3) [m]; none if there is no face."""
        if self._face is None:
            return np.zeros((0, 3))
        Y, Z = np.meshgrid(self._y, self._z, indexing="ij")
        return np.stack([self._face, Y, Z], axis=-1).reshape(-1, 3)

    def is_solid(self) -> NDArray[np.bool_]:
        """Mark nodes inside rock, steel or ground, shape (ns, ny, nz)."""
        Y, Z = np.meshgrid(self._y, self._z, indexing="ij")
        along, off = self._profile.locate(np.column_stack([Y.ravel(), Z.ravel()]))
        row, column = _nearest_index(self._station, self._s), _nearest_index(self._along, along)
        solid = (off > self._offset[row][:, column]).reshape(len(self._s), len(self._y), len(self._z))
        solid |= self._z < self._floor[:, :, None]
        if self._face is not None:
            solid |= self._s[:, None, None] > self._face
        return np.asarray(solid)

    def inside(self, local: Array) -> Array:
        """How far points (n, 3) of the tunnel frame lie inside the wall along its normal [m], (n,)."""
        along, off = self._profile.locate(local[:, 1:])
        row, column = _nearest_index(self._station, local[:, 0]), _nearest_index(self._along, along)
        return np.asarray(self._offset[row, column] - off)

    def _find_wall(self, surface: Surface) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Put the arches back before the unrolled wall and the lining behind it: s, offset, steel."""
        known = np.isfinite(surface.offset)
        if not known.any():
            raise InputError("the unrolled wall holds no value: nothing was seen, so nothing can be avoided")
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        seen = surface.offset.astype(float)[tuple(nearest)]
        profile = surface.profile
        before = np.arange(self._s[0], surface.station[0] - self._cell / 2, self._cell)
        station = np.concatenate([before, surface.station])
        offset = np.concatenate([np.full((len(before), len(surface.along)), profile.arch_line), seen])
        height = profile.point(surface.along)[:, 1]
        height = height - height.max()
        angle = np.degrees(np.unwrap(profile.angle(surface.along)))
        steel = np.zeros(offset.shape, dtype=bool)
        for arch in surface.arches:
            middle = arch.station + np.tan(np.radians(arch.lean_deg)) * height
            beside = np.abs(station[:, None] - middle) <= arch.width / 2.0 + self._cell / 4
            first, last = arch.span_deg[0] - SPAN_SLACK_DEG, arch.span_deg[1] + SPAN_SLACK_DEG
            steel |= beside & (angle >= first) & (angle <= last)
        steel &= offset > profile.arch_line
        return station, np.where(steel, profile.arch_line, offset), steel

    def _lining(self, mine: NDArray[np.bool_]) -> Array:
        """Points of the cells marked, and of the cliffs between them and their outer neighbours."""
        i, j = np.nonzero(mine)
        parts = [(self._station[i], self._along[j], self._offset[i, j])]
        for axis, grid in ((0, self._station), (1, self._along)):
            offset, own = (np.moveaxis(array, axis, 0) for array in (self._offset, mine))
            rise = offset[1:] - offset[:-1]
            owner = np.where(rise > 0.0, own[:-1], own[1:])  # the cell further inward owns the cliff
            a, b = np.nonzero(owner & (np.abs(rise) > self._cell))
            middle, beside = (grid[a] + grid[a + 1]) / 2, (self._along if axis == 0 else self._station)[b]
            for share in (0.25, 0.5, 0.75):
                at = offset[a, b] + share * rise[a, b]
                parts.append((middle, beside, at) if axis == 0 else (beside, middle, at))
        s, along, off = (np.concatenate(column) for column in zip(*parts, strict=True))
        return np.column_stack([s, self._profile.point(along, off)])

    def _find_floor(self, ground: Array) -> Array:
        """Height of the floor over the nodes (s, y) [m]; the profile's feet where no ground was seen."""
        if len(ground):
            return _column_means(ground[:, :2], ground[:, 2], self._s, self._y)
        feet = _feet(self._profile)
        return np.full((len(self._s), len(self._y)), feet)


def _feet(profile: Profile) -> float:
    return float(profile.point(np.array([0.0, profile.length]))[:, 1].min())


def _column_means(at: Array, value: Array, first: Array, second: Array) -> Array:
    """Average values over columns of two coordinates, holes from their nearest, read at nodes."""
    origin = np.array([first[0], second[0]])
    shape = tuple(int((axis[-1] - axis[0]) / COLUMN) + 1 for axis in (first, second))
    index = np.clip(np.floor((at - origin) / COLUMN).astype(np.int64), 0, np.array(shape) - 1)
    flat = index[:, 0] * shape[1] + index[:, 1]
    count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
    total = np.bincount(flat, value, minlength=shape[0] * shape[1]).reshape(shape)
    nearest = distance_transform_edt(count == 0, return_distances=False, return_indices=True)
    mean = (total / np.maximum(count, 1))[tuple(nearest)]
    u = [(axis - axis[0]) / COLUMN - 0.5 for axis in (first, second)]
    return np.asarray(map_coordinates(mean, np.meshgrid(*u, indexing="ij"), order=1, mode="nearest"))


def _nearest_index(axis: Array, value: Array) -> NDArray[np.int64]:
    """Index of the entry of a rising axis nearest to each value."""
    after = np.clip(np.searchsorted(axis, value), 1, len(axis) - 1)
    return np.asarray(after - (value - axis[after - 1] < axis[after] - value))
