"""Find the tunnel axis: direction from normals, place from the profile, then a robust fit (thesis 3.3.2)."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Axis
from ascrcp.core.geometry import Array, unit
from ascrcp.core.profile import Profile
from ascrcp.perception.fit import DROPPED, NO_ARCH, approach_axis, fit_axis, steel_agreement
from ascrcp.perception.fit_check import check_fit
from ascrcp.perception.normal import direction_from_normals, estimate_normals
from ascrcp.perception.parameter import AxisParameters
from ascrcp.perception.profile_line import between
from ascrcp.perception.raster import unroll
from ascrcp.perception.ring import Ring
from ascrcp.perception.voxel import first_of_each

_PIXEL = 0.10  # of the section picture the profile is matched in [m]
_SLAB = 0.5  # stations are counted once per slab, so that the face does not outweigh the wall [m]
_FIT_VOXEL = 0.08  # the fit takes one point of each [m]
_FIRST_VOXEL = 0.16  # likewise its first, wide steps [m]
_SIDE = 0.01  # an arch's very edges, where echoes mix, are left out of the second fit [m]
_TURN_DEG = 1.5  # bare rock alone leads the first fit so far astray; synthetic headings
_TURNS = ((0.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0))
_BAND = 0.10  # wall is looked for this far inside the arch line and outside the overbreak line [m]


def thin(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Keep the points the fit needs, shape (m, 3): even in space, few near the lidar, all far from it."""
    return points[first_of_each(points, _FIT_VOXEL)]


def find_axis(points: NDArray[np.float32], profile: Profile, parameters: AxisParameters) -> Axis:
    """Find the axis of the tunnel a cluster of points belongs to.

    Args:
        points: The tunnel's points without floor, thinned, base frame [m], shape (n, 3).
        profile: Design profile.
        parameters: Bounds and cells of the fit.

    Returns:
        Axis with its uncertainty and the evidence it rests on.

    Raises:
        RecognitionError: If the points are not a tunnel of this profile.
    """
    normals, flatness = estimate_normals(points)
    direction = direction_from_normals(normals, flatness, parameters.max_yaw_deg)
    start = axis_through(match_profile(points, direction, profile), direction)
    # far off a coarse fit does, the fine one then needs few steps
    few = points[first_of_each(points, _FIRST_VOXEL)]
    start = approach_axis(few, start, profile, parameters)
    fit = fit_axis(points, start, profile, parameters)
    check_fit(fit, profile, parameters)
    return fit.axis


def find_bare_axis(
    points: NDArray[np.float32], axis: Axis, profile: Profile, parameters: AxisParameters
) -> Axis:
    """Find the axis where no sprayed part is seen: everything at the arch line is one ring of steel.

    Args:
        points: The tunnel's points without floor, thinned, base frame [m], shape (n, 3).
        axis: Axis as `find_axis` found it.
        profile: Design profile.
        parameters: Cells of the fit.

    Returns:
        The axis, to be believed if arches are found with it: bumps of rock touch the line too.
    """
    middle = float(np.median((points - axis.point) @ axis.direction))
    _, left, up = axis.T_base_tunnel[:3, :3].T
    found = []
    for aside, above in _TURNS:
        turned = axis.direction + np.tan(np.radians(_TURN_DEG)) * (aside * left + above * up)
        start = axis_through(axis.point + middle * axis.direction, turned)
        try:
            fit = fit_axis(points, start, profile, parameters, one_ring=True)
        except RecognitionError:
            continue
        found.append((steel_agreement(points, fit.axis, profile, parameters), fit.axis))
    return max(found, key=lambda f: f[0])[1] if found else axis


def refine_axis(
    points: NDArray[np.float32],
    axis: Axis,
    rings: list[Ring],
    profile: Profile,
    parameters: AxisParameters,
) -> Axis:
    """Fit once more with the arches known: each is one ring, however it leans.

    Args:
        points: The tunnel's points without floor, thinned, base frame [m], shape (n, 3).
        axis: Axis the arches were found with.
        rings: Arches.
        profile: Design profile.
        parameters: Cells of the fit.

    Returns:
        The better axis.
    """
    flat = unroll(points, axis, profile)
    arch = np.full(len(flat), NO_ARCH, dtype=np.int64)
    inner = flat.offset < between(profile)
    for number, ring in enumerate(rings):
        distance = np.abs(ring.distance(flat.station, flat.yz))
        # the arch's sides and what hides behind its edges belong to no ring
        arch[inner & (distance < ring.width / 2 + _SIDE)] = DROPPED
        arch[inner & (distance < ring.width / 2 - _SIDE)] = number
    return fit_axis(points, axis, profile, parameters, arch).axis


def axis_through(point: Array, direction: Array) -> Axis:
    """Build an axis whose station 0 is the point nearest the base origin (design.md section 1)."""
    direction = unit(np.asarray(direction, dtype=float))
    return Axis(point - direction * (point @ direction), direction)


def match_profile(points: NDArray[np.float32], direction: Array, profile: Profile) -> Array:
    """Find where in the section the profile lies: the best overlap of two pictures.

    The mean of all points (eq. 3-5) is biased where part of the ring is missing, see errata; the
    profile's own shape is not.

    Args:
        points: Tunnel points, base frame [m], shape (n, 3).
        direction: Unit direction, shape (3,).
        profile: Design profile.

    Returns:
        A point on the axis [m], base frame, shape (3,).
    """
    frame = Axis(np.zeros(3), direction).T_base_tunnel[:3, :3]
    local = points @ frame
    low = local.min(axis=0)
    pixel = ((local[:, 1:] - low[1:]) / _PIXEL).astype(np.int64)
    slab = ((local[:, 0] - low[0]) / _SLAB).astype(np.int64)
    height, width = pixel[:, 0].max() + 1, pixel[:, 1].max() + 1
    seen = np.zeros((slab.max() + 1, height, width), dtype=bool)
    seen[slab, pixel[:, 0], pixel[:, 1]] = True
    picture = seen.sum(axis=0).astype(float)
    template, origin = _template(profile)
    overlap = fftconvolve(picture, template[::-1, ::-1], mode="full")
    best = np.array(np.unravel_index(int(overlap.argmax()), overlap.shape))
    shift = best - (np.array(template.shape) - 1)
    yz = low[1:] + (shift + origin + 0.5) * _PIXEL
    return np.asarray(frame @ np.array([0.0, yz[0], yz[1]]))


def _template(profile: Profile) -> tuple[Array, Array]:
    """Picture of the wall band, 1 on it, and the pixel of the axis in it."""
    margin = profile.overbreak_line + 2 * _BAND
    line = profile.point(np.linspace(0.0, profile.length, 400), margin)
    low = np.floor(line.min(axis=0) / _PIXEL)
    size = (np.ceil(line.max(axis=0) / _PIXEL) - low).astype(int)
    y, z = np.meshgrid(*[(low[i] + np.arange(size[i]) + 0.5) * _PIXEL for i in (0, 1)], indexing="ij")
    along, offset = profile.locate(np.column_stack([y.ravel(), z.ravel()]))
    band = (offset > profile.arch_line - _BAND) & (offset < profile.overbreak_line + _BAND)
    beside = (along > 0.0) & (along < profile.length)
    # what lies clearly inside speaks against a place: the face is weak evidence, slabs count it once
    template = np.where(beside & band, 1.0, 0.0) - 0.1 * (offset < profile.arch_line - 4 * _BAND)
    return template.reshape(y.shape), -low - 0.5
