"""Walk a chain of translations and rotations (eq. 2-1 to 2-5), one pose or a whole batch alike.

The pose is carried as twelve components (three columns and the origin). They are plain floats for
one pose and arrays for many, so that one walk serves the 20 ms cycle and the planner.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ascrcp.core.geometry import AXES, Array
from ascrcp.kinematics.description import ArmDescription, Prismatic

Number = Any
"""A float or an array: the walk only adds and multiplies."""
Column = list[Number]
Trig = Callable[[Number], Number]


@dataclass(frozen=True)
class Op:
    """One elementary motion: along or about an axis of the moving frame.

    Attributes:
        turn: Whether it rotates; else it translates.
        axis: 0, 1, 2 for x, y, z of the frame so far.
        sign: -1.0 where the axis is reversed.
        fixed: Constant angle [rad] or length [m]; the joint's value is added to it.
        joint: Index of the joint, -1 for a fixed motion.
        last: Whether this ends the step of its joint.
    """

    turn: bool
    axis: int
    sign: float = 1.0
    fixed: float = 0.0
    joint: int = -1
    last: bool = False


@dataclass
class Walk:
    """Where a walk ended and what it passed.

    Attributes:
        columns: x, y, z axes of the last frame and its origin, each three components.
        axes: Per joint, its axis in the base frame.
        origins: Per joint, a point on its axis [m].
        frames: Per joint, the columns of the frame that ends its step.
    """

    columns: list[Column]
    axes: list[Column] = field(default_factory=list)
    origins: list[Column] = field(default_factory=list)
    frames: list[list[Column]] = field(default_factory=list)


def compile_chain(description: ArmDescription) -> tuple[Op, ...]:
    """Turn a description into elementary motions, base to tool.

    A D-H row is Rot(z, theta) Trans(0, 0, d) Trans(a, 0, 0) Rot(x, alpha) (standard form).
    """
    ops: list[Op] = []
    for i, joint in enumerate(description.joints):
        turns = not isinstance(joint, Prismatic)
        if joint.dh is not None:
            row = joint.dh
            step = [
                Op(True, 2, fixed=math.radians(row.theta_deg), joint=i if turns else -1),
                Op(False, 2, fixed=row.d, joint=-1 if turns else i),
                Op(False, 0, fixed=row.a),
                Op(True, 0, fixed=math.radians(row.alpha_deg)),
            ]
        else:
            axis, offset = joint.axis or "x", joint.translate or (0.0, 0.0, 0.0)
            step = [Op(False, k, fixed=offset[k]) for k in range(3)]
            step.append(Op(turns, AXES[axis[-1]], -1.0 if axis[0] == "-" else 1.0, joint=i))
        step = [op for op in step if op.joint >= 0 or op.fixed != 0.0]
        step[-1] = Op(**{**step[-1].__dict__, "last": True})
        ops.extend(step)
    ops.extend(Op(False, k, fixed=description.tool[k]) for k in range(3) if description.tool[k] != 0.0)
    return tuple(ops)


def walk_chain(ops: Sequence[Op], q: Sequence[Number], *, record: bool = False) -> Walk:
    """Carry the base frame along the chain.

    Args:
        ops: The chain.
        q: One value or array per joint, all of one shape [rad or m].
        record: Whether to keep the joint axes and the frames on the way.
    """
    one = isinstance(q[0], float)
    cos: Trig = math.cos if one else np.cos
    sin: Trig = math.sin if one else np.sin
    walk = Walk([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    columns = walk.columns
    for op in ops:
        value = op.fixed if op.joint < 0 else q[op.joint] + op.fixed
        if record and op.joint >= 0:
            walk.axes.append([op.sign * c for c in columns[op.axis]])
            walk.origins.append(columns[3])
        if op.turn:
            j, k = (op.axis + 1) % 3, (op.axis + 2) % 3
            c, s = cos(value), op.sign * sin(value)
            (a0, a1, a2), (b0, b1, b2) = columns[j], columns[k]
            columns[j] = [c * a0 + s * b0, c * a1 + s * b1, c * a2 + s * b2]
            columns[k] = [c * b0 - s * a0, c * b1 - s * a1, c * b2 - s * a2]
        else:
            length = op.sign * value
            (a0, a1, a2), (p0, p1, p2) = columns[op.axis], columns[3]
            columns[3] = [p0 + length * a0, p1 + length * a1, p2 + length * a2]
        if record and op.last:
            walk.frames.append(list(columns))
    return walk


def pack_transform(columns: Sequence[Column], shape: tuple[int, ...]) -> Array:
    """Assemble homogeneous transforms (*shape, 4, 4) from four columns of components."""
    if shape == ():
        (a, b, c, p) = columns
        rows = [[a[i], b[i], c[i], p[i]] for i in range(3)]
        return np.array([*rows, [0.0, 0.0, 0.0, 1.0]])
    T = np.empty((*shape, 4, 4))
    for j, column in enumerate(columns):
        for i in range(3):
            T[..., i, j] = column[i]
    T[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
    return T
