"""Walk a chain of translations and rotations (eq. 2-1 to 2-5), one pose or a whole batch alike.

The pose is carried as twelve components (three columns and the origin). They are plain floats for
one pose and arrays for many, so that one walk serves the 20 ms cycle and the planner.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ascrcp.core.geometry import AXES, Array
from ascrcp.kinematics.description import ArmDescription, Prismatic

Number = Any
"""A float or an array: the walk only adds and multiplies."""
Column = list[Number]

QUARTERS = {90.0: 1.0, -90.0: -1.0}
"""Fixed twists [deg] that are exact quarter turns."""


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
        quarter: 1.0 or -1.0 where this is a fixed quarter turn, which only swaps axes; else 0.0.
    """

    turn: bool
    axis: int
    sign: float = 1.0
    fixed: float = 0.0
    joint: int = -1
    last: bool = False
    quarter: float = 0.0


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
                Op(True, 0, fixed=math.radians(row.alpha_deg), quarter=QUARTERS.get(row.alpha_deg, 0.0)),
            ]
        else:
            axis, offset = joint.axis or "x", joint.translate or (0.0, 0.0, 0.0)
            step = [Op(False, k, fixed=offset[k]) for k in range(3)]
            step.append(Op(turns, AXES[axis[-1]], -1.0 if axis[0] == "-" else 1.0, joint=i))
        step = [op for op in step if op.joint >= 0 or op.fixed != 0.0]
        step[-1] = replace(step[-1], last=True)
        ops.extend(step)
    ops.extend(Op(False, k, fixed=description.tool[k]) for k in range(3) if description.tool[k] != 0.0)
    return tuple(ops)


def reverse_chain(ops: Sequence[Op]) -> tuple[Op, ...]:
    """Turn a chain round: walked from the tool's pose it leads back to where the chain began."""
    return tuple(replace(op, sign=-op.sign, last=False) for op in reversed(ops))


def compute_reach(ops: Sequence[Op], ranges: Sequence[tuple[float, float]]) -> float:
    """Add up the lengths of a chain with every slide of `ranges` [m] drawn out: no point is farther."""
    total = 0.0
    for op in ops:
        if not op.turn:
            total += abs(op.fixed)
            total += max(map(abs, ranges[op.joint])) if op.joint >= 0 else 0.0
    return total


def walk_chain(
    ops: Sequence[Op],
    q: Sequence[Number],
    *,
    record: bool = False,
    start: Sequence[Column] | None = None,
) -> Walk:
    """Carry a frame along the chain.

    Args:
        ops: The chain.
        q: One value or array per joint [rad or m]; arrays need only broadcast together, and what
            does not vary along an axis is not computed along it.
        record: Whether to keep the joint axes and the frames on the way.
        start: Columns of the frame to start from; the base frame if left out.
    """
    walk = Walk([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    columns = walk.columns
    if start is not None:
        columns[:] = start
    for op in ops:
        if record and op.joint >= 0:
            walk.axes.append([op.sign * c for c in columns[op.axis]])
            walk.origins.append(columns[3])
        if op.quarter:
            _swap(columns, op)
        elif op.turn:
            _turn(columns, op, _value(op, q))
        else:
            length = op.sign * _value(op, q)
            (a0, a1, a2), (p0, p1, p2) = columns[op.axis], columns[3]
            columns[3] = [p0 + length * a0, p1 + length * a1, p2 + length * a2]
        if record and op.last:
            walk.frames.append(list(columns))
    return walk


def _value(op: Op, q: Sequence[Number]) -> Number:
    if op.joint < 0:
        return op.fixed
    return q[op.joint] + op.fixed if op.fixed else q[op.joint]


def _turn(columns: list[Column], op: Op, angle: Number) -> None:
    j, k = (op.axis + 1) % 3, (op.axis + 2) % 3
    s, c = sine_cosine(angle)
    s = op.sign * s
    (a0, a1, a2), (b0, b1, b2) = columns[j], columns[k]
    columns[j] = [c * a0 + s * b0, c * a1 + s * b1, c * a2 + s * b2]
    columns[k] = [c * b0 - s * a0, c * b1 - s * a1, c * b2 - s * a2]


def _swap(columns: list[Column], op: Op) -> None:
    j, k = (op.axis + 1) % 3, (op.axis + 2) % 3
    s = op.sign * op.quarter
    columns[j], columns[k] = [s * b for b in columns[k]], [-s * a for a in columns[j]]


def sine_cosine(angle: Number) -> tuple[Number, Number]:
    """Compute sine and cosine; of arrays from the tangent of half the angle, at a fifth of the cost.

    The error stays below 4e-16 (sine and cosine by themselves: 1e-16); half a turn is no exception,
    since no double is exactly pi / 2.
    """
    if isinstance(angle, float):
        return math.sin(angle), math.cos(angle)
    t = np.tan(0.5 * angle)
    u = 1.0 / (1.0 + t * t)
    return 2.0 * t * u, 2.0 * u - 1.0


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
