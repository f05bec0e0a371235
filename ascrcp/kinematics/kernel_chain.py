"""Machine code of the chain: a joint vector -> the frames on the way to the tool."""

import math

import numpy as np
from numba import float64, int64

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_compiler import array_of, part, table_of
from ascrcp.kinematics.kernel_table import SLIDE, SWAP, ChainTable

CHAIN = table_of(ChainTable, array_of(int64, 2), array_of(float64, 2))


@part
def walk(chain: ChainTable, q: Array, frames: Array, joints: Array) -> None:
    """Carry a frame along the chain.

    Args:
        chain: The motions.
        q: One joint vector, shape (n,).
        frames: Takes axes x, y, z and origin after each joint, and of the tool last, shape (n + 1, 4, 3).
        joints: Takes each joint's axis and a point on it, shape (n, 2, 3).
    """
    at = frames[-1]
    at[:] = 0.0
    at[0, 0] = at[1, 1] = at[2, 2] = 1.0
    done = 0
    for k in range(len(chain.motion)):
        kind, axis, joint = chain.motion[k, 0], chain.motion[k, 1], chain.motion[k, 2]
        sign, value = chain.amount[k, 0], chain.amount[k, 1]
        if joint >= 0:
            value += q[joint]
            for i in range(3):
                joints[joint, 0, i] = sign * at[axis, i]
                joints[joint, 1, i] = at[3, i]
        if kind == SLIDE:
            for i in range(3):
                at[3, i] += sign * value * at[axis, i]
        else:
            s, c = (sign, 0.0) if kind == SWAP else (sign * math.sin(value), math.cos(value))
            first, second = (axis + 1) % 3, (axis + 2) % 3
            for i in range(3):
                a, b = at[first, i], at[second, i]
                at[first, i] = c * a + s * b
                at[second, i] = c * b - s * a
        if chain.motion[k, 3]:
            for i in range(4):
                for j in range(3):
                    frames[done, i, j] = at[i, j]
            done += 1


@part
def make_room(q: Array) -> tuple[Array, Array]:
    """Make room for what a walk leaves behind."""
    return np.empty((q.shape[1] + 1, 4, 3)), np.empty((q.shape[1], 2, 3))
