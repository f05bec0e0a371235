"""The wall of a simulated heading as a spray meets it: Heading -> Bare, and the heading with its layer on."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.core.profile import Profile
from ascrcp.simulation.heading import Heading

MARGIN_M = 0.6  # wall kept beyond the unsprayed part
AHEAD_M = 0.4  # rays begin so far inside the arch line
ON_FLANGE_M = 0.05  # an arch's flange is looked for so near the arch line
SAME_M = 0.04  # a vertex so near the wall or a flange belongs to it
BURIED_M = 0.10  # what stands so far before the wall hides it; bolt heads do not


@dataclass(frozen=True)
class Bare:
    """The wall of a heading before spraying, in its true tunnel frame.

    Attributes:
        profile: Design profile.
        station, along: Middles of rows [m] (ns,) and columns [m] (na,), even.
        rock: Offset of the rock [m], behind arches too, shape (ns, na).
        flange: Offset of the inner flange on arches, NaN beside them, shape (ns, na).
        face: Station where the face stands in each column [m], infinite if there is none, shape (na,).
        buried: Cells before which floor, muck or the face's own rock stand, not those wholly beneath the
            floor, shape (ns, na).
        outer: Depth of an arch from inner to outer flange [m].
    """

    profile: Profile
    station: Array
    along: Array
    rock: Array
    flange: Array
    face: Array
    buried: NDArray[np.bool_]
    outer: float


def lay_bare(heading: Heading, cell: float, arch_depth: float) -> Bare:
    """Measure the mesh of a heading: rays outward through every cell, to the rock and to the arches."""
    truth, T = heading.truth, heading.truth.axis.T_base_tunnel
    first, last = truth.unsprayed
    station = _even(first - MARGIN_M, last + MARGIN_M, cell)
    along = _even(0.0, truth.profile.length, cell)
    start = truth.profile.arch_line - AHEAD_M
    yz, normal = truth.profile.point(along, start), truth.profile.normal(along)
    S, A = np.meshgrid(station, np.arange(len(along)), indexing="ij")
    origin = apply_transform(T, np.column_stack([S.ravel(), yz[A.ravel()]]))
    outward = np.column_stack([np.zeros(S.size), normal[A.ravel()]]) @ T[:3, :3].T
    rock, steel, nearest = (
        start + _cast(heading.vertices, triangles, origin, outward).reshape(S.shape)
        for triangles in np.split(heading.triangles, [heading.rock, heading.built])
    )
    flange = np.where(np.abs(steel - truth.profile.arch_line) < ON_FLANGE_M, steel, np.nan)
    buried = nearest < np.minimum(rock, steel) - BURIED_M
    rows = np.arange(len(station))
    for column in rock.T:
        known = np.isfinite(column)
        column[:] = np.interp(rows, rows[known], column[known]) if known.any() else 0.0
    # the face, seen along the axis just inside the arches
    origin = apply_transform(T, np.column_stack([np.full(len(along), first), yz]))
    face = first + _cast(heading.vertices, heading.triangles, origin, np.tile(T[:3, 0], (len(along), 1)))
    return Bare(truth.profile, station, along, rock, flange, face, buried, arch_depth)


def _cast(vertices: NDArray[np.float32], triangles: NDArray[np.uint32], origin: Array, ray: Array) -> Array:
    """Find how far rays go to the first triangle [m], infinite if they meet none, (n,)."""
    import open3d.core  # takes a second to load
    from open3d.t.geometry import RaycastingScene

    if not len(triangles):
        return np.full(len(origin), np.inf)
    tensor: Any = open3d.core.Tensor
    scene = RaycastingScene(nthreads=1)
    scene.add_triangles(tensor(vertices), tensor(np.ascontiguousarray(triangles)))
    reach = scene.cast_rays(tensor(np.hstack([origin, ray]).astype(np.float32)))["t_hit"].numpy()
    return np.asarray(reach, dtype=float)


def grow_heading(heading: Heading, bare: Bare, rock: Array, flange: Array) -> Heading:
    """Move the mesh where concrete lies, for a second scan.

    Args:
        heading: As it was built.
        bare: Its wall.
        rock: Growth of the rock [m], shape (ns, na).
        flange: Growth on arches [m], shape (ns, na).
    """
    T = heading.truth.axis.T_base_tunnel
    local = apply_transform(inverse_transform(T), heading.vertices.astype(float))
    along, offset = bare.profile.locate(local[:, 1:])
    row = (local[:, 0] - bare.station[0]) / (bare.station[1] - bare.station[0])
    column = (along - bare.along[0]) / (bare.along[1] - bare.along[0])
    inside = (row > 0) & (row < len(bare.station) - 1) & (column > -0.5) & (column < len(bare.along) - 0.5)
    on_rock = inside & (np.abs(offset - sample(bare.rock, row, column)) < SAME_M)
    # the flange's corners lie on the edge of its cells: the nearest cell on it counts
    known = np.isfinite(bare.flange)
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    r = np.clip(np.rint(row), 0, known.shape[0] - 1).astype(np.int64)
    c = np.clip(np.rint(column), 0, known.shape[1] - 1).astype(np.int64)
    place = tuple(axis[r, c] for axis in nearest)
    close = np.abs(place[0] - row) < 1.5
    on_flange = inside & ~on_rock & close & (np.abs(offset - bare.flange[place]) < SAME_M / 2)
    by = np.where(on_rock, sample(rock, row, column), 0.0) + np.where(on_flange, flange[place], 0.0)
    inward = np.column_stack([np.zeros(len(by)), -bare.profile.normal(along)]) * by[:, None]
    vertices = heading.vertices + inward @ T[:3, :3].T
    return replace(heading, vertices=vertices.astype(np.float32))


def sample(grid: Array, row: Array, column: Array) -> Array:
    """Read a grid at fractional rows and columns, linearly."""
    return np.asarray(map_coordinates(grid, [row, column], order=1, mode="nearest"))


def _even(first: float, last: float, step: float) -> Array:
    count = max(2, int(np.ceil((last - first) / step)))
    return np.asarray(first + (np.arange(count) + 0.5) * (last - first) / count)
