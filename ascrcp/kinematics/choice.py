"""Choose one solution for one pose: weighted shortest travel (thesis 2.2, muck paper eq. 5)."""

import numpy as np
from numpy.typing import ArrayLike

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.solution import Solutions

REVERSAL_COST = 0.5
"""Share of a joint's travel charged again where it turns back (thesis 2.2: increments keep their
direction); placeholder."""


def travel_cost(arm: Arm, q: Array, previous: Array, increment: Array | None = None) -> Array:
    """Charge the travel from the previous joint vector.

    Each joint's travel is counted in seconds at its greatest speed, which makes rad and m
    comparable (the muck paper adds them, errata 1.1), times its weight.

    Args:
        arm: The arm.
        q: Joint vectors [rad, m], shape (..., n).
        previous: Joint vector before [rad, m], shape (n,).
        increment: The last change of the joints, shape (n,); its directions are preferred.

    Returns:
        Cost [s], shape (...).
    """
    change = q - previous
    cost = np.abs(change) * (arm.travel_weight / arm.max_speed)
    if increment is not None:
        cost = np.where(change * increment < 0.0, (1.0 + REVERSAL_COST) * cost, cost)
    return cost.sum(axis=-1)


def choose_solution(
    arm: Arm, solutions: Solutions, previous: ArrayLike, increment: ArrayLike | None = None
) -> Array:
    """Choose the solution of each pose that keeps the limits and travels least.

    Args:
        arm: The arm.
        solutions: Solutions of N poses, each judged from the same previous joint vector.
        previous: Joint vector before [rad, m], shape (n,).
        increment: The last change of the joints, shape (n,).

    Returns:
        Joint vectors [rad, m], shape (N, n).

    Raises:
        UnreachableError: A pose none of whose solutions keeps the limits.
    """
    lost = np.flatnonzero(~solutions.within_limits.any(axis=1))
    if lost.size:
        raise UnreachableError(f"pose {lost[0]} has no solution within the limits of {arm.name}")
    last = None if increment is None else np.asarray(increment, dtype=float)
    cost = travel_cost(arm, solutions.q, np.asarray(previous, dtype=float), last)
    best = np.where(solutions.within_limits, cost, np.inf).argmin(axis=1)
    return solutions.q[np.arange(len(best)), best]
