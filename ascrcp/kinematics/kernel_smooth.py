"""Machine code of smoothing: a chain of joint vectors -> the banded system of one Gauss-Newton round.

Callers use `smooth.py`. Every point's rows are computed by themselves.
"""

import numpy as np
from numba import float64

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_chain import CHAIN, make_room
from ascrcp.kinematics.kernel_compiler import array_of, part, table_of, whole
from ascrcp.kinematics.kernel_table import ChainTable, CostTable
from ascrcp.kinematics.kernel_task import find_miss

VECTOR, LINES, BOXES = array_of(float64, 1), array_of(float64, 2), array_of(float64, 3)
COST = table_of(CostTable, LINES, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR)


@part
def _add_limits(cost: CostTable, q: Array, block: Array, gradient: Array) -> None:
    """Pull one joint vector to the middle and push it out of the margins, on the limited quantities."""
    count = len(q)
    for k in range(count):
        off = -cost.middle[k]
        for i in range(count):
            if cost.matrix[k, i] != 0.0:
                off += cost.matrix[k, i] * q[i]
        weight, slope = cost.centre[k], cost.centre[k] * off
        size, side = abs(off), 1.0 if off > 0.0 else -1.0
        if size > cost.half[k]:
            weight += cost.limit[k]
            slope += side * cost.limit[k] * (size - cost.half[k])
        if size > cost.limit_half[k]:
            weight += cost.hard[k]
            slope += side * cost.hard[k] * (size - cost.limit_half[k])
        for i in range(count):
            if cost.matrix[k, i] == 0.0:
                continue
            gradient[i] += cost.matrix[k, i] * slope
            for j in range(count):
                block[i, j] += cost.matrix[k, i] * weight * cost.matrix[k, j]


@whole(CHAIN, COST, float64, BOXES, LINES, LINES, LINES, BOXES, LINES)
def assemble(
    chain: ChainTable,
    cost: CostTable,
    stiffness: float,
    T: Array,
    q: Array,
    travel: Array,
    pull: Array,
    blocks: Array,
    slope: Array,
) -> tuple[Array, Array]:
    """Assemble the system of a chain of n joint vectors.

    Args:
        chain: The arm's motions.
        cost: Weights.
        stiffness: Weight of a squared miss.
        T: Targets, shape (n, 4, 4).
        q: Joint vectors, shape (n, joints).
        travel: Weight of a joint's squared time at the point itself and of its product with the point
            before and the one before that, shape (n, 3).
        pull: Gradient of the squared times, shape (n, joints).
        blocks, slope: Further terms of the points by themselves, (n, joints, joints) and (n, joints).

    Returns:
        Columns of the matrix from its diagonal up, the diagonal last, shape (n, joints, 2 joints + 1),
        and the gradient, shape (n, joints).
    """
    n, count = q.shape
    frames, joints = make_room(q)
    band, gradient = np.zeros((n, count, 2 * count + 1)), np.empty((n, count))
    residual, J, block = np.empty(5), np.zeros((5, count)), np.empty((count, count))
    for row in range(n):
        find_miss(chain, T[row], q[row], frames, joints, residual, J)
        for i in range(count):
            gradient[row, i] = slope[row, i] + cost.metric[i] * pull[row, i]
            for k in range(5):
                gradient[row, i] += stiffness * J[k, i] * residual[k]
            for j in range(count):
                block[i, j] = blocks[row, i, j]
                for k in range(5):
                    block[i, j] += stiffness * J[k, i] * J[k, j]
            block[i, i] += cost.metric[i] * travel[row, 0]
        _add_limits(cost, q[row], block, gradient[row])
        for j in range(count):
            for i in range(j + 1):
                band[row, j, 2 * count - (j - i)] = block[i, j]
            band[row, j, count] += cost.metric[j] * travel[row, 1]
            band[row, j, 0] += cost.metric[j] * travel[row, 2]
    return band, gradient
