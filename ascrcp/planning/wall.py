"""The wall as the planner needs it: smooth, without holes, to be cut anywhere: Surface -> Wall."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, map_coordinates

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Label, Surface
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.planning.parameter import PlanningParameters

MIN_FLOOR_POINTS = 50  # fewer ground points than this tell nothing about the floor; placeholder
FLOOR_BEHIND_M = 3.0  # ground up to one round behind the unsprayed part counts, design.md section 1
HEAP_M = 0.08  # what stands so far inside the arch line is muck or the like, no wall; placeholder
FACE_M = 0.15  # the face bulges by less than this into the unsprayed part; placeholder
STANDING_SHARE = (
    0.5  # of the way from design to arch line: further in stands face or heap, no wall; placeholder
)


@dataclass(frozen=True)
class Wall:
    """The unrolled wall with its roughness averaged and its holes bridged.

    Attributes:
        profile: Design profile the offsets count from.
        station: Stations of the rows [m], shape (ns,).
        along: Arc lengths of the columns [m], shape (na,).
        offset: Outward offset from the design line [m], finite, shape (ns, na).
        raw: The same before its roughness is averaged, shape (ns, na).
        slope: d offset / d along of the more strongly smoothed wall, shape (ns, na).
        slope_along_axis: d offset / d station of the same, shape (ns, na).
        unseen: Distance to the nearest cell with a value [m], shape (ns, na).
        floor_z: Height of the floor in the section plane [m].
    """

    profile: Profile
    station: Array
    along: Array
    offset: Array
    raw: Array
    slope: Array
    slope_along_axis: Array
    unseen: Array
    floor_z: float

    def sample(self, grid: Array, station: Array, along: Array) -> Array:
        """Read one of the grids at stations and arc lengths, both (n,), linearly between cells.

        Between two neighbouring rows this is the thesis's cut: cells of one column are each
        other's nearest neighbours in adjacent slices, and the value is where the line through
        the pair meets the plane (eq. 4-3 as corrected, 4-4).
        """
        row = (station - self.station[0]) / (self.station[1] - self.station[0])
        column = (along - self.along[0]) / (self.along[1] - self.along[0])
        return np.asarray(map_coordinates(grid, [row, column], order=1, mode="nearest"), dtype=float)

    def point(self, station: Array, along: Array) -> Array:
        """Return wall points in the tunnel frame (s, y, z) [m], shape (n, 3)."""
        yz = self.profile.point(along, self.sample(self.offset, station, along))
        return np.column_stack([station, yz])

    def normal(self, station: Array, along: Array, limit: float) -> Array:
        """Return the wall's outward unit normals in the section plane, shape (n, 2).

        Args:
            station: Stations [m], shape (n,).
            along: Arc lengths [m], shape (n,).
            limit: Largest angle from the design line's normal [rad].
        """
        n = self.profile.normal(along)
        t = np.column_stack([n[:, 1], -n[:, 0]])  # tangent, toward rising section angle
        step = self.along[1] - self.along[0]
        ahead, behind = self.profile.normal(along + step), self.profile.normal(along - step)
        curvature = ((ahead - behind) * t).sum(-1) / (2 * step)
        stretch = 1.0 + curvature * self.sample(self.offset, station, along)
        lean = np.arctan2(-self.sample(self.slope, station, along), stretch)
        lean = np.clip(lean, -limit, limit)[:, None]
        return np.asarray(np.cos(lean) * n + np.sin(lean) * t, dtype=float)


def fit_wall(surface: Surface, parameters: PlanningParameters) -> Wall:
    """Average the wall's roughness and bridge its holes.

    Args:
        surface: Recognised heading; `offset` may hold any number of NaN.
        parameters: Smoothing windows.

    Raises:
        InputError: Grid smaller than 2 x 2 or without any value.
    """
    if min(surface.offset.shape) < 2:
        raise InputError(f"the unrolled wall must have at least 2 x 2 cells, not {surface.offset.shape}")
    known = np.isfinite(surface.offset) & ~_is_face(surface)
    if not known.any():
        raise InputError("the unrolled wall holds no value: nothing was seen, so nothing can be planned")
    step = (surface.station[1] - surface.station[0], surface.along[1] - surface.along[0])
    unseen, nearest = distance_transform_edt(~known, sampling=step, return_indices=True)
    offset = surface.offset.astype(float)[tuple(nearest)]
    straight = past_heaps(offset, surface.profile.arch_line)
    soft = _smooth(straight, parameters.normal_smooth_m, step)
    return Wall(
        profile=surface.profile,
        station=surface.station,
        along=surface.along,
        offset=_smooth(offset, parameters.position_smooth_m, step),
        raw=offset,
        slope=np.gradient(soft, step[1], axis=1),
        slope_along_axis=np.gradient(soft, step[0], axis=0),
        unseen=unseen,
        floor_z=find_floor(surface),
    )


def find_floor(surface: Surface) -> float:
    """Find the floor's height in the section plane [m]: ground points, else the profile's feet."""
    ground = surface.points[surface.labels == Label.GROUND]
    relative = ground - surface.axis.point
    T = surface.axis.T_base_tunnel
    s, z = relative @ T[:3, 0], relative @ T[:3, 2]
    z = z[(s > surface.unsprayed[0] - FLOOR_BEHIND_M) & (s < surface.unsprayed[1])]
    if len(z) >= MIN_FLOOR_POINTS:
        return float(np.median(z))
    profile = surface.profile
    return float(profile.point(np.array([0.0, profile.length]))[:, 1].min())


def _is_face(surface: Surface) -> NDArray[np.bool_]:
    """Mark cells of the last rows that show the face's own rock, bulging before the wall, shape (ns, na)."""
    last = surface.station > surface.unsprayed[1] - FACE_M
    with np.errstate(invalid="ignore"):
        return np.asarray(last[:, None] & (surface.offset < STANDING_SHARE * surface.profile.arch_line))


def past_heaps(offset: Array, arch_line: float) -> Array:
    """Continue the wall past what stands before it: a heap's flank is no slope of the wall above it."""
    heap = binary_dilation(offset < STANDING_SHARE * arch_line, np.ones((3, 3)))
    if not heap.any() or heap.all():
        return offset
    nearest = distance_transform_edt(heap, return_distances=False, return_indices=True)
    return np.asarray(offset[tuple(nearest)])


def _smooth(grid: Array, sigma: float, step: tuple[float, float]) -> Array:
    return np.asarray(gaussian_filter(grid, (sigma / step[0], sigma / step[1]), mode="nearest"), dtype=float)
