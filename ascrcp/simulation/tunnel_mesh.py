"""Pieces of the tunnel's triangle mesh: roughness, grids, swept steel sections, boxes, cylinders."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ascrcp.core.geometry import Array
from ascrcp.simulation.tunnel import Octave


@dataclass(frozen=True)
class Mesh:
    """Triangles in one frame: vertices (n, 3) [m], triangles (m, 3) of vertex indices."""

    vertices: Array
    triangles: NDArray[np.int64]


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """Put meshes of one frame together."""
    parts = list(meshes)
    shift = np.cumsum([0] + [len(m.vertices) for m in parts])
    return Mesh(
        np.concatenate([m.vertices for m in parts]),
        np.concatenate([m.triangles + s for m, s in zip(parts, shift, strict=False)]),
    )


def rough(rng: np.random.Generator, u: Array, v: Array, octaves: Iterable[Octave]) -> Array:
    """Compute a seeded rough field: independent heights on a lattice per octave, interpolated.

    Args:
        rng: Source of the heights.
        u: First coordinate [m], shape (...).
        v: Second coordinate [m], shape (...).
        octaves: Scales to add up.

    Returns:
        Heights [m], shape (...), zero in the mean, each octave of its rms.
    """
    total = np.zeros(np.broadcast_shapes(u.shape, v.shape))
    for octave in octaves:
        at = np.stack(
            [np.broadcast_to((x - x.min()) / octave.wavelength + 2.0, total.shape).ravel() for x in (u, v)]
        )
        at = at + rng.uniform(size=(2, 1))
        size = np.ceil(at.max(axis=1)).astype(int) + 3
        heights = rng.standard_normal(size)
        order = 1 if octave.faceted else 3
        field = ndimage.map_coordinates(heights, at, order=order)
        # mean square of linear interpolation between unit normals is (2/3)^2, of cubic splines 0.62
        gain = 1.5 if octave.faceted else 1.27
        total += octave.rms * gain * field.reshape(total.shape)
    return total


def grid(points: Array) -> Mesh:
    """Triangulate a grid of points, shape (a, b, 3)."""
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([first, first + 1, first + columns], axis=1)
    upper = np.stack([first + 1, first + columns + 1, first + columns], axis=1)
    return Mesh(points.reshape(-1, 3), np.concatenate([lower, upper]))


def sweep(corners: Array) -> Mesh:
    """Sweep a closed polygon: corners (stations along the sweep, corners, 3) -> tube."""
    return grid(np.concatenate([corners, corners[:, :1]], axis=1))


def box(low: Array, high: Array) -> Mesh:
    """Build an axis-aligned box from its two opposite corners (3,)."""
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(low + corner * (high - low), triangles)


def cylinder(foot: Array, radius: float, height: float, sides: int = 24) -> Mesh:
    """Build an upright cylinder with a domed top from the middle of its foot (3,)."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    rings = [(radius, 0.0), (radius, height - radius), (0.7 * radius, height - 0.3 * radius), (0.0, height)]
    points = np.stack(
        [np.stack([r * np.cos(turn), r * np.sin(turn), np.full_like(turn, z)], axis=-1) for r, z in rings]
    )
    return grid(points + foot)
