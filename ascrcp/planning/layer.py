"""Layers: how often a place is sprayed so that no layer falls off, and the wall between two of them."""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter, label

from ascrcp.core.geometry import Array
from ascrcp.planning.parameter import PlanningParameters
from ascrcp.planning.process import LayerParameters, ProcessParameters
from ascrcp.planning.target import Target, mean_patch
from ascrcp.planning.wall import Wall, past_heaps

T = TypeVar("T")
SMALLEST_M2 = 0.08  # a smaller part of a further layer is left to the last one; about a patch
EVENNESS = 0.5  # mean over largest thickness of one layer: passes in a deep place are few and end in it
OVERLAP_M = 0.06  # a layer's passes reach so far beyond where it is needed; half a footprint's core


def limit_layer(target: Target, parameters: LayerParameters) -> Array:
    """Thickest layer that stays up [m], by column, shape (na,): the wall's, overhead the crown's."""
    up = np.clip(target.profile.normal(target.along)[:, 1], 0.0, 1.0) ** 2
    return np.asarray(parameters.wall_m + (parameters.crown_m - parameters.wall_m) * up)


def count_layers(target: Target, process: ProcessParameters) -> NDArray[np.int64]:
    """Count the layers every cell needs, at least one, shape (ns, na)."""
    thickness = mean_patch(
        target.thickness, target.inside & ~target.arch, target.cell, process.target.patch_m
    )
    limit = limit_layer(target, process.layer)
    need = np.nan_to_num(thickness)
    layers = np.where(need <= limit, 1.0, np.ceil(need / (EVENNESS * limit) - 1e-9))
    return np.maximum(layers, 1.0).astype(np.int64)


def find_parts(mask: NDArray[np.bool_], cell: tuple[float, float]) -> list[NDArray[np.bool_]]:
    """Split a layer into connected parts worth spraying, widened a little, by first row and column."""
    reach = max(1, round(OVERLAP_M / min(cell)))
    joined, count = label(binary_dilation(mask, iterations=reach), structure=np.ones((3, 3)))
    parts = [joined == number for number in range(1, count + 1)]
    return [part for part in parts if (mask & part).sum() * cell[0] * cell[1] >= SMALLEST_M2]


def take_turns(parts: Sequence[Sequence[T]]) -> list[T]:
    """Order the layers of all deep parts in turn, each part's spread evenly over the whole time.

    A layer laid at once onto the one before it hangs on what has not set, and both fall off.

    Args:
        parts: The layers of each part in their order.

    Returns:
        The layers of all parts, shape (sum of the parts' lengths,).
    """
    turns = [((i + 0.5) / len(part), layer) for part in parts for i, layer in enumerate(part)]
    return [layer for _, layer in sorted(turns, key=lambda turn: turn[0])]


def wall_before(target: Target, layers: NDArray[np.int64], layer: int) -> Array:
    """The wall as it stands when a layer begins [m], shape (ns, na).

    Args:
        target: Present and wanted surface.
        layers: Layers of each cell.
        layer: The one about to be sprayed; the last one is 1.
    """
    left = np.minimum(layer, layers) / layers
    return np.asarray(
        np.where(target.arch, target.offset, target.wanted + (target.offset - target.wanted) * left)
    )


def smooth_wall(target: Target, offset: Array, wall: Wall, parameters: PlanningParameters) -> Wall:
    """Make a wall of an intermediate surface, to be cut like the first one; arches are taken away."""
    ds, da = target.cell
    rock = np.where(target.arch, target.rock, offset)

    def smooth(grid: Array, sigma: float) -> Array:
        return np.asarray(gaussian_filter(grid, (sigma / ds, sigma / da), mode="nearest"))

    straight = past_heaps(rock, target.profile.arch_line)
    station, along = np.meshgrid(target.station, target.along, indexing="ij")
    unseen = wall.sample(wall.unseen, station.ravel(), along.ravel()).reshape(rock.shape)
    soft = smooth(straight, parameters.normal_smooth_m)
    return Wall(
        profile=target.profile,
        station=target.station,
        along=target.along,
        offset=smooth(rock, parameters.position_smooth_m),
        raw=rock,
        slope=np.gradient(soft, da, axis=1),
        slope_along_axis=np.gradient(soft, ds, axis=0),
        unseen=unseen,
        floor_z=wall.floor_z,
    )
