"""What the machine code reads: a chain, the shapes of an arm and a distance field as plain arrays."""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.chain import Op
from ascrcp.kinematics.description import SagModel
from ascrcp.kinematics.sag import compute_sag

Table = TypeVar("Table", bound=tuple[Any, ...])

SLIDE, TURN, SWAP = 0, 1, 2
"""Kinds of elementary motions: along an axis, about it, about it by a quarter turn."""

SAG_STEP = 0.02
"""Between two reaches of the table [m] the sag is taken as straight: within 0.1 um but at joint 1."""


class ChainTable(NamedTuple):
    """Elementary motions from base to tool, k of them; see `chain.Op`.

    Attributes:
        motion: Kind, axis, joint (-1 for none) and whether it ends its joint's step, shape (k, 4).
        amount: Sign (of a quarter turn, its own) and fixed value [rad, m], shape (k, 2).
    """

    motion: NDArray[np.int64]
    amount: Array


class ShapeTable(NamedTuple):
    """Sampled capsules, c of them; see `capsule.Body`.

    Attributes:
        joint: Joint each moves with, from 1; 0 stands still, shape (c,).
        ends: Both ends in that joint's frame [m], shape (c, 2, 3).
        radius: Radii [m], shape (c,).
        first: First sample of each and the number of all, shape (c + 1,).
        share: Where along its capsule each sample lies, shape (m,).
        pairs: Capsules that are checked against each other, shape (k, 2).
        sag: Drop at reaches `SAG_STEP` apart from 0 on [m], the last two going on beyond, shape (r,).
    """

    joint: NDArray[np.int64]
    ends: Array
    radius: Array
    first: NDArray[np.int64]
    share: Array
    pairs: NDArray[np.int64]
    sag: Array


class FieldTable(NamedTuple):
    """A distance field; see `obstacle.Obstacles`.

    Attributes:
        to_nodes: From the base frame to places on the grid, in cells, shape (3, 4).
        values: Signed distance at the nodes [m], shape (ns, ny, nz).
        slack: Most by which the value at the nearest node is wrong [m].
    """

    to_nodes: Array
    values: NDArray[np.float32]
    slack: float


class LegRule(NamedTuple):
    """How straight legs are looked at and priced; see `route.py`.

    Attributes:
        shares: Where on a leg it is looked at first, 0 at its begin, 1 at its end.
        speed: Largest speed of each joint [rad/s, m/s].
        row: Nothing moves further between two close looks [m].
        wanted, least: Clearances [m].
        near_price: Seconds that a second at the least clearance counts more than one at the wanted.
        stop: Seconds that a stop costs.
    """

    shares: Array
    speed: Array
    row: float
    wanted: float
    least: float
    near_price: float
    stop: float


class CostTable(NamedTuple):
    """What a chain is to minimise; see `smooth.Cost`.

    Attributes:
        matrix: Rows that turn joints into the limited quantities, shape (joints, joints).
        metric, middle, half, limit_half, centre, limit: See there, each (joints,).
        hard: Weight beyond `limit_half`, shape (joints,).
    """

    matrix: Array
    metric: Array
    middle: Array
    half: Array
    limit_half: Array
    centre: Array
    limit: Array
    hard: Array


class Scene(NamedTuple):
    """An arm in its surroundings."""

    chain: ChainTable
    shape: ShapeTable
    field: FieldTable


def freeze(table: Table) -> Table:
    """Make the arrays of a table read-only and return it."""
    for part in table:
        if isinstance(part, np.ndarray):
            part.flags.writeable = False
    return table


def tabulate_chain(ops: Sequence[Op]) -> ChainTable:
    """Write a chain's motions as rows."""
    kinds = [SWAP if op.quarter else TURN if op.turn else SLIDE for op in ops]
    motion = [(kind, op.axis, op.joint, int(op.last)) for kind, op in zip(kinds, ops, strict=True)]
    amount = [(op.sign * (op.quarter or 1.0), op.fixed) for op in ops]
    return freeze(ChainTable(np.array(motion, dtype=np.int64), np.array(amount, dtype=float)))


def tabulate_sag(model: SagModel | None, reach: float, payload_kg: float) -> Array:
    """Write a sag as drops at reaches `SAG_STEP` apart, up to the farthest [m]; see `ShapeTable`."""
    if model is None:
        return np.zeros(2)
    reaches: Array = SAG_STEP * np.arange(int(reach / SAG_STEP) + 2, dtype=float)
    return compute_sag(model, reaches, payload_kg)[0]
