"""A duct as contours: points inside it -> clearance to its wall (duct paper 2.1, projection intersection).

The paper projects point and interpolated contour onto the duct's xoy plane, which is exact only for
contours parallel to it. Here both are projected onto the plane of the interpolated contour (errata 3.2).
"""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array, unit

FLAT = 0.02
"""Farthest a contour's points may lie off its plane, as a share of its size; placeholder."""

STEEPEST_DEG = 60.0
"""Largest angle between a contour's normal and the way to the next contour; placeholder."""

LARGEST_TWIST_DEG = 45.0
"""Largest turn of the first point from contour to contour: points of one number are joined; placeholder."""

SIZES = (0.3, 100.0)
"""Length round a contour [m]; anything else is in another unit."""

BLOCK = 4096
"""Points judged at once against all edges of a contour: some 30 MB."""


@dataclass(frozen=True)
class Duct:
    """Closed contours along a duct, in the arm's base frame.

    Attributes:
        name: What messages call it.
        contour: m contours of k points, the same point of each about in line, shape (m, k, 3) [m].
        centre: Mean of each contour's outline (m, 3) [m].
        normal: Unit normals of the contours' planes, into the duct, shape (m, 3).
    """

    name: str
    contour: Array
    centre: Array
    normal: Array

    @classmethod
    def from_contours(cls, name: str, contour: Array) -> "Duct":
        """Check contours and find their planes.

        Args:
            name: What messages call the duct.
            contour: Points, shape (m, k, 3) [m], contours in order into the duct, m >= 2, k >= 8.

        Raises:
            InputError: Too few, not finite, not flat, or not in order along the duct.
        """
        contour = np.array(contour, dtype=float)
        if contour.ndim != 3 or contour.shape[2] != 3 or contour.shape[0] < 2 or contour.shape[1] < 8:
            raise InputError(f"{name}: needs at least 2 contours of at least 8 points x, y, z each")
        if not np.isfinite(contour).all():
            raise InputError(f"{name}: a contour holds a value that is not a finite number")
        following = np.roll(contour, -1, axis=1)
        edge = np.linalg.norm(following - contour, axis=2, keepdims=True)
        length = edge.sum(axis=1)
        if not (edge > 0.0).all():
            raise InputError(f"{name}: contour {_first(~(edge > 0.0))} has a point twice in a row")
        if not (length.min() >= SIZES[0] and length.max() <= SIZES[1]):
            raise InputError(
                f"{name}: contours of {length.min():.4g} to {length.max():.4g} m round, "
                f"allowed {SIZES[0]:g} to {SIZES[1]:g}: is the file in metres?"
            )
        centre = (edge * (contour + following) / 2).sum(axis=1) / length
        around = contour - centre[:, None]
        area = np.cross(around, np.roll(around, -1, axis=1)).sum(axis=1) / 2
        size = np.linalg.norm(area, axis=1, keepdims=True)
        if not (size > 1e-3 * length**2).all():
            raise InputError(f"{name}: contour {_first(size <= 1e-3 * length**2)} encloses no area")
        normal = area / size
        off = np.abs((around * normal[:, None]).sum(axis=2)).max(axis=1)
        if not (off <= FLAT * length[:, 0]).all():
            raise InputError(f"{name}: contour {_first(off > FLAT * length[:, 0])} is not flat")
        way = np.diff(centre, axis=0)
        if (normal[0] @ way[0]) < 0.0:  # counted the other way round
            contour, normal = contour[:, ::-1], -normal
        steep = np.cos(np.radians(STEEPEST_DEG)) * np.linalg.norm(way, axis=1)
        good = np.minimum((normal[:-1] * way).sum(axis=1), (normal[1:] * way).sum(axis=1)) > steep
        if not good.all():
            raise InputError(
                f"{name}: contours {_first(~good)} and the next are not in order along the duct, "
                "or their points run round it in opposite directions"
            )
        start = unit(contour[:, 0] - centre)
        twisted = (start[1:] * start[:-1]).sum(axis=1) < np.cos(np.radians(LARGEST_TWIST_DEG))
        if twisted.any():
            raise InputError(
                f"{name}: the first points of contour {_first(twisted)} and the next are not in line"
            )
        contour.flags.writeable = False
        return cls(name, contour, centre, normal)

    @property
    def station(self) -> Array:
        """Length along the centres up to each contour [m], shape (m,)."""
        steps = np.linalg.norm(np.diff(self.centre, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def section(self, station: float) -> tuple[Array, Array, Array]:
        """Interpolate the contour at a station [m]: points (k, 3), centre (3,), unit normal (3,).

        Raises:
            InputError: A station outside the duct.
        """
        along = self.station
        if not 0.0 <= station <= along[-1]:
            raise InputError(f"{self.name}: station {station:g} m is not in 0..{along[-1]:.3f} m")
        j = min(int(np.searchsorted(along, station, side="right")) - 1, len(along) - 2)
        share = np.array([(station - along[j]) / (along[j + 1] - along[j])])
        points, centre, normal = self._between(np.array([j]), share)
        return points[0], centre[0], normal[0]

    def _between(self, j: Array, share: Array) -> tuple[Array, Array, Array]:
        """Interpolate between contours j and j + 1, shapes (n, k, 3), (n, 3), (n, 3)."""
        K = share[:, None]
        points = (1 - K[..., None]) * self.contour[j] + K[..., None] * self.contour[j + 1]
        centre = (1 - K) * self.centre[j] + K * self.centre[j + 1]
        return points, centre, unit((1 - K) * self.normal[j] + K * self.normal[j + 1])

    def measure(self, p: Array, radius: Array) -> "Gap":
        """Measure spheres against the wall.

        A sphere that lies wholly before the first contour is in the open; beyond the last contour the
        duct is taken to go on as it ends.

        Args:
            p: Centres in the base frame [m], shape (n, 3).
            radius: Radii [m], shape (n,).
        """
        parts = [
            self._measure(p[i : i + BLOCK], radius[i : i + BLOCK]) for i in range(0, max(len(p), 1), BLOCK)
        ]
        return Gap(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _measure(self, p: Array, radius: Array) -> tuple[Array, Array, Array]:
        depth = np.einsum("nmi,mi->nm", p[:, None] - self.centre, self.normal)
        # the pair of planes the point lies between; where planes cross at a bend, the nearest such pair
        between = (depth[:, :-1] >= 0.0) & (depth[:, 1:] < 0.0)
        far = np.linalg.norm(p[:, None] - (self.centre[:-1] + self.centre[1:]) / 2, axis=2)
        j = np.where(between, far, far + 1e3).argmin(axis=1)
        row = np.arange(len(p))
        d1, d2 = depth[row, j], -depth[row, j + 1]
        share = np.clip(d1 / np.maximum(d1 + d2, 1e-12), 0.0, 1.0)
        points, centre, normal = self._between(j, share)
        a = points - p[:, None]
        a -= (a @ normal[:, :, None]) * normal[:, None]  # into the plane, the point at its origin
        e = np.roll(a, -1, axis=1) - a
        part = np.clip(-(a * e).sum(axis=2) / np.maximum((e * e).sum(axis=2), 1e-18), 0.0, 1.0)
        near = a + part[..., None] * e
        distance = np.linalg.norm(near, axis=2)
        nearest = distance.argmin(axis=1)
        cross = np.einsum("nki,ni->nk", np.cross(a, a + e), normal)
        turns = np.arctan2(cross, (a * (a + e)).sum(axis=2)).sum(axis=1)  # once round if inside
        side = np.where(turns > np.pi, 1.0, -1.0)
        wall = near[row, nearest]
        inward = -side[:, None] * wall / np.maximum(distance[row, nearest], 1e-12)[:, None]
        escape = centre - p
        escape -= (escape * normal).sum(axis=1, keepdims=True) * normal
        clear = side * distance[row, nearest] - radius
        return np.where(depth[:, 0] < -radius, np.inf, clear), inward, escape


@dataclass(frozen=True)
class Gap:
    """How far spheres are from a duct's wall.

    Attributes:
        clearance: Surface to wall in the local plane, negative outside, inf in the open [m], (n,).
        inward: Unit direction in which it grows fastest, shape (n, 3).
        escape: Paper's escape vector e_m, from the centre to the contour's centre in its plane [m], (n, 3).
    """

    clearance: Array
    inward: Array
    escape: Array


def _first(wrong: Array) -> int:
    """Number of the first contour where anything is wrong, from 1."""
    return int(np.flatnonzero(wrong.reshape(len(wrong), -1).any(axis=1))[0]) + 1
