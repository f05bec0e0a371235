"""Machine code of the distance field: points -> distance to what is nearest, and the way from it.

Callers use `obstacle.py`.
"""

import math

import numpy as np
from numba import float32, float64
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_compiler import array_of, part, table_of, whole
from ascrcp.kinematics.kernel_table import FieldTable

LINES = array_of(float64, 2)
FIELD = table_of(FieldTable, LINES, array_of(float32, 3), float64)


@part
def _split(u: float, count: int) -> tuple[int, float]:
    """Split a place along one axis into the node before it and the rest; on the grid, NaN at its begin."""
    if not u > 0.0:
        return 0, 0.0
    if not u < count - 1:
        return count - 2, 1.0
    return int(u), u - int(u)


@part
def _find_node(field: FieldTable, point: Array, axis: int) -> float:
    """Place of a point (3,) [m] on the grid along one axis."""
    to = field.to_nodes[axis]
    return to[0] * point[0] + to[1] * point[1] + to[2] * point[2] + to[3]


@part
def _round(u: float, count: int) -> int:
    """Find the node nearest to a place along one axis; on the grid, NaN at its begin."""
    if not u > 0.0:
        return 0
    return int(u + 0.5) if u < count - 1 else count - 1


@part
def read_nearest(field: FieldTable, point: Array) -> float:
    """Read the field at the node nearest to a point."""
    values = field.values
    i = _round(_find_node(field, point, 0), values.shape[0])
    j = _round(_find_node(field, point, 1), values.shape[1])
    k = _round(_find_node(field, point, 2), values.shape[2])
    return values[i, j, k]


@part
def _read_between(values: NDArray[np.float32], u: float, v: float, w: float) -> float:
    """Read the field at a place on the grid, linear between nodes; beyond the grid it goes on as it ends."""
    i, a = _split(u, values.shape[0])
    j, b = _split(v, values.shape[1])
    k, c = _split(w, values.shape[2])
    low = (values[i, j, k] * (1.0 - c) + values[i, j, k + 1] * c) * (1.0 - b)
    low += (values[i, j + 1, k] * (1.0 - c) + values[i, j + 1, k + 1] * c) * b
    high = (values[i + 1, j, k] * (1.0 - c) + values[i + 1, j, k + 1] * c) * (1.0 - b)
    high += (values[i + 1, j + 1, k] * (1.0 - c) + values[i + 1, j + 1, k + 1] * c) * b
    return low * (1.0 - a) + high * a


@part
def read(field: FieldTable, point: Array) -> float:
    """Read the field at a point, linear between nodes."""
    u, v, w = _find_node(field, point, 0), _find_node(field, point, 1), _find_node(field, point, 2)
    return _read_between(field.values, u, v, w)


@part
def lead_away(field: FieldTable, point: Array, away: Array) -> None:
    """Put the unit direction away from what a point (3,) is nearest to into away (3,), base frame."""
    values, to = field.values, field.to_nodes
    u, v, w = _find_node(field, point, 0), _find_node(field, point, 1), _find_node(field, point, 2)
    a = _read_between(values, u + 0.5, v, w) - _read_between(values, u - 0.5, v, w)
    b = _read_between(values, u, v + 0.5, w) - _read_between(values, u, v - 0.5, w)
    c = _read_between(values, u, v, w + 0.5) - _read_between(values, u, v, w - 0.5)
    if not a * a + b * b + c * c > 0.0:
        a, b, c = 0.0, 0.0, 1.0  # half-way between two things there is no way out, nor beyond the field: up
    size = 0.0
    for i in range(3):
        away[i] = a * to[0, i] + b * to[1, i] + c * to[2, i]
        size += away[i] ** 2
    size = math.sqrt(size)
    for i in range(3):
        away[i] /= size


@whole(FIELD, LINES)
def read_field(field: FieldTable, points: Array) -> Array:
    """Read the field at points (n, 3) of the base frame, linear between nodes; (n,) [m]."""
    found = np.empty(len(points))
    for row in range(len(points)):
        found[row] = read(field, points[row])
    return found


@whole(FIELD, LINES)
def find_away(field: FieldTable, points: Array) -> Array:
    """Find the unit directions away from what points (n, 3) are nearest to, base frame, (n, 3)."""
    away = np.empty((len(points), 3))
    for row in range(len(points)):
        lead_away(field, points[row], away[row])
    return away
