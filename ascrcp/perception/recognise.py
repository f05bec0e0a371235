"""Recognise a heading: Cloud -> Surface, the steps of thesis chapter 3 in their order."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Axis, Cloud, Label, Surface
from ascrcp.core.profile import Profile
from ascrcp.perception.arch import find_arches, to_arch
from ascrcp.perception.axis import find_axis, find_bare_axis, refine_axis, thin
from ascrcp.perception.bay import find_bays
from ascrcp.perception.cluster import cluster
from ascrcp.perception.crop import crop
from ascrcp.perception.ground import find_ground, is_ground
from ascrcp.perception.label import label_points
from ascrcp.perception.overbreak import find_overbreak
from ascrcp.perception.parameter import PerceptionParameters
from ascrcp.perception.raster import Unrolled, unroll
from ascrcp.perception.ring import Ring
from ascrcp.perception.section import Extent, find_extent, is_wall
from ascrcp.perception.voxel import voxel
from ascrcp.perception.wall import build_wall, wall_end

Progress = Callable[[str, float], None]
"""Called as (step, fraction done 0..1) when a step begins; may raise CancelledError."""

_FEW_ARCHES_DEG = 0.4  # bare rock with one arch or none tilts the axis by so much more: synthetic headings
_LEAST_SPRAYED = 0.3  # a shorter sprayed part is none [m]; placeholder

# share of the whole time done when each step begins, measured on 1 M points
_BEGINS = {
    "crop": 0.0, "voxel": 0.02, "ground": 0.22, "cluster": 0.26, "axis": 0.32, "section": 0.68,
    "arch": 0.80, "overbreak": 0.92, "label": 0.96,
}  # fmt: skip


class _Steps:
    """Times the steps and announces them; what it measures changes no result."""

    def __init__(self, progress: Progress | None, timing: dict[str, float] | None) -> None:
        self._progress = progress
        self._timing = timing

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        if self._progress is not None:
            self._progress(name, _BEGINS[name])
        start = time.perf_counter()
        yield
        if self._timing is not None:
            self._timing[name] = time.perf_counter() - start


def recognise(
    cloud: Cloud,
    profile: Profile,
    parameters: PerceptionParameters,
    progress: Progress | None = None,
    timing: dict[str, float] | None = None,
) -> Surface:
    """Recognise axis, arches, overbreak and bays of a heading.

    Args:
        cloud: Points in the base frame [m]; points that are not finite are dropped.
        profile: Design profile.
        parameters: Settings of every step.
        progress: Told when each step begins; may raise to cancel.
        timing: If given, filled with the seconds each step took.

    Returns:
        The recognised heading.

    Raises:
        RecognitionError: If there is no tunnel of this profile in the cloud.
    """
    step = _Steps(progress, timing)
    with step("crop"):
        points = crop(cloud.points, profile, parameters.crop)
    with step("voxel"):
        points = voxel(points, parameters.voxel)
    with step("ground"):
        ground = _ground(points, parameters)
        above = points[~ground]
    with step("cluster"):
        owner = cluster(above, parameters.cluster)
    with step("axis"):
        tunnel = thin(above[owner == 0])
        axis = find_axis(tunnel, profile, parameters.axis)
    with step("section"):
        slices = _cut(above, owner, axis, profile, parameters)
        _check_heading(slices, profile)
    with step("arch"):
        rings = _arches(slices, profile, parameters)
        if not (_is_sprayed(slices.extent) and "sprayed" in axis.evidence):
            bare = find_bare_axis(tunnel, axis, profile, parameters.axis)
            again = _cut(above, owner, bare, profile, parameters)
            through = _arches(again, profile, parameters)
            if through and len(through) >= len(rings):
                axis, slices, rings = bare, again, through
        if rings:
            # where an arch leans its slices are half rock: now that it is known, fit once more
            axis = refine_axis(tunnel, axis, rings, profile, parameters.axis)
            slices = _cut(above, owner, axis, profile, parameters)
            rings = _arches(slices, profile, parameters)
    flat, extent = slices.flat, slices.extent
    with step("overbreak"):
        wall = build_wall(slices.wall, extent, rings, profile, parameters.wall)
        regions, cells = find_overbreak(
            wall, extent, profile, parameters.overbreak, floor_seen=bool(ground.any())
        )
    with step("label"):
        labels = np.full(len(points), Label.GROUND, dtype=np.uint8)
        labels[~ground] = label_points(flat, extent, rings, wall, cells, profile, parameters.section)
    unsprayed = (extent.sprayed_end, extent.end)
    arches = tuple(to_arch(ring, profile) for ring in rings)
    return Surface(
        axis=_with_evidence(axis, rings, extent),
        profile=profile,
        unsprayed=unsprayed,
        arches=arches,
        overbreak=tuple(regions),
        bays=find_bays(arches, unsprayed),
        station=wall.raster.station,
        along=wall.raster.along,
        offset=wall.offset.astype(np.float32),
        filled=wall.filled,
        points=points,
        labels=labels,
    )


@dataclass(frozen=True)
class _Slices:
    """All points above the floor in the tunnel's coordinates, those of the wall, and the extent."""

    flat: Unrolled
    wall: Unrolled
    extent: Extent


def _cut(
    above: NDArray[np.float32],
    owner: NDArray[np.int32],
    axis: Axis,
    profile: Profile,
    parameters: PerceptionParameters,
) -> _Slices:
    flat = unroll(above, axis, profile)
    wall = is_tunnel(flat, owner, profile) & is_wall(flat, profile, parameters.section)
    return _Slices(flat, flat.pick(wall), find_extent(flat, profile, parameters.section))


def _arches(slices: _Slices, profile: Profile, parameters: PerceptionParameters) -> list[Ring]:
    first, last = slices.extent.sprayed_end, wall_end(slices.extent)
    return find_arches(slices.wall, first, last, profile, parameters.arch, parameters.section)


def is_tunnel(flat: Unrolled, owner: NDArray[np.int32], profile: Profile) -> NDArray[np.bool_]:
    """Mark the points of the largest cluster and of clusters that continue the same wall.

    The shadow of an arch can cut the wall in two; people and vehicles do not lie on the wall's lines.

    Args:
        flat: Points above the floor.
        owner: Cluster of each point, 0 the largest, shape (n,).
        profile: Design profile.

    Returns:
        Whether each point belongs to the tunnel, shape (n,).
    """
    beside_wall = flat.beside & (flat.offset > profile.arch_line - 0.15) & (flat.offset < 1.5)
    share = np.bincount(owner, beside_wall) / np.bincount(owner)
    keep = (share > 0.7) & (np.bincount(owner) >= 5)
    keep[0] = True
    return np.asarray(keep[owner])


def _ground(points: NDArray[np.float32], parameters: PerceptionParameters) -> NDArray[np.bool_]:
    if len(points) < parameters.cluster.min_points:
        raise RecognitionError(
            f"no tunnel found: only {len(points)} points lie near the machine, "
            f"at least {parameters.cluster.min_points} are needed"
        )
    return is_ground(points, find_ground(points, parameters.ground), parameters.ground.clearance)


def _check_heading(slices: _Slices, profile: Profile) -> None:
    """Refuse a heading that lies beyond the overbreak line nearly everywhere: another tunnel's profile."""
    wall, extent = slices.wall, slices.extent
    start = max(extent.sprayed_end, extent.end - profile.spray_depth)
    mine = (wall.station > start) & (wall.station < extent.end)
    if not mine.any():
        return
    share = float(np.mean(wall.offset[mine] > profile.overbreak_line))
    if not share <= 0.6:
        raise RecognitionError(
            f"profile {profile.name} does not fit: {100 * share:.0f} % of the heading's wall lies beyond "
            "its overbreak line, at most 60 % is believed; is it another tunnel's profile?"
        )


def _is_sprayed(extent: Extent) -> bool:
    """Whether a sprayed part is seen."""
    return extent.sprayed_end > extent.first + _LEAST_SPRAYED


def _with_evidence(axis: Axis, rings: list[Ring], extent: Extent) -> Axis:
    """Name only surfaces that were then really found; the axis is less sure where there are few."""
    names = [name for name in axis.evidence if name not in ("sprayed", "arches")]
    if _is_sprayed(extent):
        names.insert(0, "sprayed")
    if rings:
        names.insert(-1, "arches")
    few = 0.0 if _is_sprayed(extent) or len(rings) > 1 else _FEW_ARCHES_DEG
    sigma = float(np.hypot(axis.direction_sigma_deg, few))
    return replace(axis, evidence=tuple(names), direction_sigma_deg=sigma)
