"""The layered graph: one layer of candidates per key point, the cheapest chain through them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.spacing import NEAREST

REPOSITION = 10.0
"""A move that is not sprayed through counts as one over this distance [m]; placeholder."""

EXCESS = 0.1
"""Share of a transition's cost beyond the break cost that still counts, so that the nearer of two
configurations wins after a break too; placeholder."""


def find_chain(
    layers: Sequence[Array],
    own_cost: Sequence[Array],
    scale: Array,
    distance: Array,
    break_cost: float,
    start: Array,
) -> NDArray[np.int64]:
    """Find the chain of least cost (Dijkstra on a layered graph: one sweep forth, one back).

    A transition costs the squared travel time over the distance, up to the break cost.

    Args:
        layers: Per key point its candidates [rad, m], each (k_i, joints), k_i >= 1.
        own_cost: Per key point the candidates' own cost, each (k_i,).
        scale: Weighted time per unit of each joint [s/rad, s/m], shape (joints,).
        distance: Distance from the key point before [m], shape (layers,); the first is unused,
            infinite where the nozzle does not spray through.
        break_cost: Cost at which a transition counts as a break.
        start: Joint vector the arm comes from, shape (joints,).

    Returns:
        Index of the chosen candidate per layer, shape (layers,).
    """
    scaled = [layer * scale for layer in layers]
    from_start = ((scaled[0] - start * scale) ** 2).sum(axis=1)
    total = own_cost[0] + from_start / REPOSITION
    came_from: list[NDArray[np.int64]] = []
    for i in range(1, len(layers)):
        a, b = scaled[i - 1], scaled[i]
        square = (b * b).sum(axis=1)[:, None] + (a * a).sum(axis=1) - 2.0 * (b @ a.T)
        if np.isfinite(distance[i]):
            step = _capped(np.maximum(square, 0.0) / max(float(distance[i]), NEAREST), break_cost)
        else:
            step = square / REPOSITION
        reach = step + total
        best = reach.argmin(axis=1)
        came_from.append(best)
        total = reach[np.arange(len(b)), best] + own_cost[i]
    chain = np.empty(len(layers), dtype=np.int64)
    chain[-1] = total.argmin()
    for i in range(len(layers) - 1, 0, -1):
        chain[i - 1] = came_from[i - 1][chain[i]]
    return chain


def _capped(cost: Array, cap: float) -> Array:
    return np.minimum(cost, cap + EXCESS * (cost - cap))
