"""What an inverse returns, and the check that makes a candidate a solution: the forward model."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.chain import Op, compute_reach, reverse_chain, walk_chain

BRANCHES = (2, 2, 2)
"""Every closed form here branches three times."""

CONFIRM_TOLERANCE = 7e-11
"""Largest miss of a solution, position and reach times turn each [m]: together below 1e-10 m."""

MEETING = 1e-13
"""Difference of two lengths [m] below which rounding may have parted them: poses lie tens of metres
off at most, and a double resolves 4e-15 m there."""

ON_AXIS = 2e-11
"""Distance of the wrist from the slew axis [m] within which the slew is free: its direction is lost in
rounding there, and any slew misses the pose by no more."""

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

    middle: ClassVar[int]
    """Joints walked from the base when a candidate is confirmed; the rest is walked from the tool."""

    def solve(self, P: Array, held: Sequence[Array], near: Array | None) -> list[Array]:
        """Return one array per joint that broadcasts to (2, 2, 2, N), NaN where not real.

        Poses come as components (3, 4, N), held values (N,), `near` joint vectors (N, n).
        """
        ...


class Confirmation:
    """Hold candidates to the forward model.

    The chain is walked from the base to a middle joint and from the wanted pose back to it: each half
    varies along fewer branches than a whole walk would. A miss d of the frames there, with a turn t, is
    a miss of at most |d| + reach |t| at the tool.
    """

    def __init__(self, ops: Sequence[Op], ranges: Sequence[tuple[float, float]], middle: int) -> None:
        cut = 1 + next(i for i, op in enumerate(ops) if op.joint == middle - 1)
        self._front, self._back = tuple(ops[:cut]), reverse_chain(ops[cut:])
        self._square_reach = max(1.0, compute_reach(self._back, ranges)) ** 2

    def check(self, q: Sequence[Array], P: Array) -> NDArray[np.bool_]:
        """Tell which candidates reach their poses.

        Args:
            q: One array per joint, each broadcasting to (2, 2, 2, N) [rad, m].
            P: Components of the poses, shape (3, 4, N).

        Returns:
            Shape (2, 2, 2, N); NaN never does.
        """
        front = walk_chain(self._front, q).columns
        wanted = [[P[i, j] for i in range(3)] for j in range(4)]
        back = walk_chain(self._back, q, start=wanted).columns
        miss = np.zeros((*BRANCHES, P.shape[2]))
        for column in (0, 2):  # two axes bound the turn, the third follows
            for i in range(3):
                _add_square(front[column][i] - back[column][i], miss)
        miss *= self._square_reach
        for i in range(3):
            _add_square(front[3][i] - back[3][i], miss)
        return miss <= CONFIRM_TOLERANCE**2


def _add_square(gap: Array, total: Array) -> None:
    gap *= gap
    total += gap


def wrap_into(angle: Array, lower: float, upper: float) -> Array:
    """Replace angles by an equivalent in lower..upper where there is one, else by the nearest to it.

    An angle within rounding of an end stays there instead of going once round.
    """
    middle = (lower + upper) / 2
    turns = np.rint((angle - middle) * (1.0 / TURN))
    wrapped = angle - TURN * turns
    if upper - lower < TURN:
        return wrapped
    # with a full turn or more, prefer the value as it is, then the end it rounds to
    return np.where((angle >= lower) & (angle <= upper), angle, wrapped)


def settle(a: Array, b: Array, slack: Array | float = MEETING) -> Array:
    """Replace lengths a by b where only rounding parts them, before the root of a^2 - b^2 is taken.

    Two solutions meet where a = b: rounded to either side the root would lose both of them, or part
    them by the square root of the rounding.
    """
    return np.where(np.abs(a - b) <= slack, b, a)


def leg(a: Array, b: Array) -> Array:
    """Compute the other leg sqrt(a^2 - b^2) of a triangle, NaN where there is none."""
    return np.sqrt((a - b) * (a + b))
