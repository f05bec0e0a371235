"""What an inverse returns, and the check that makes a candidate a solution: the forward model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.chain import Op, walk_chain

CONFIRM_TOLERANCE = 1e-6
"""Largest entry by which forward(q) may miss the pose [1, m]: rounding of a pose passed as text."""

ROUNDING = 1e-14
"""What a sum of a few products may be off by, relative to their size."""

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Solutions:
    """Every real solution of N poses; rows are unordered.

    Attributes:
        q: Joint vectors [rad, m], NaN where not valid, shape (N, k, n).
        valid: Whether the row is a real solution, confirmed by the forward model, shape (N, k).
        within_limits: Whether it keeps every joint's range too, shape (N, k).
    """

    q: Array
    valid: NDArray[np.bool_]
    within_limits: NDArray[np.bool_]


class ClosedForm(Protocol):
    """The inverse of one structure of arm, derived from its description."""

    held: ClassVar[tuple[int, ...]]
    """Joints, from 1, whose values must be given."""

    def solve(self, T: Array, held: Sequence[Array], near: Array | None) -> Array:
        """Return candidates (n, k, N), NaN where not real; poses (N, 4, 4), held values (N,)."""
        ...


def confirm(chain: Sequence[Op], q: Array, T: Array) -> NDArray[np.bool_]:
    """Tell which candidates (n, k, N) reach the poses (N, 4, 4), shape (k, N); NaN never does."""
    columns = walk_chain(chain, list(q)).columns
    good = np.ones(q.shape[1:], dtype=bool)
    for j in (3, 0, 1):  # the third axis follows from the other two
        for i in range(3):
            miss = columns[j][i] - T[:, i, j]
            good &= np.abs(miss, out=miss) <= CONFIRM_TOLERANCE
    return good


def wrap_into(angle: Array, lower: float, upper: float) -> Array:
    """Replace angles by an equivalent in lower..upper where there is one, else by the nearest to it.

    An angle within rounding of an end stays there instead of going once round.
    """
    middle = (lower + upper) / 2
    wrapped = middle + (angle - middle + np.pi) % TURN - np.pi
    if upper - lower < TURN:
        return wrapped
    # with a full turn or more, prefer the value as it is, then the end it rounds to
    return np.where((angle >= lower) & (angle <= upper), angle, wrapped)


def root(square: Array, scale: Array | float = 1.0) -> Array:
    """Take the real square root, NaN below zero; what rounding could have made of zero is zero.

    Where two solutions meet the square is zero: rounded to either side it would lose both of them
    or part them by its square root.

    Args:
        square: Squares, any shape.
        scale: Size of the terms they were formed from; sets what counts as rounding.
    """
    settled = np.where(np.abs(square) < ROUNDING * np.asarray(scale), 0.0, square)
    return np.sqrt(np.where(settled >= 0.0, settled, np.nan))
