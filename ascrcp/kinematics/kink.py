"""Keep single points from throwing the arm: filled in or left over, off their neighbours' way.

Where the nozzle's tilt axis is parallel to the pitch axes, rounding may send one point of a smooth stroke off
and back: both steps are steep, that over it is not.
"""

from collections.abc import Callable

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.spacing import sum_stretches
from ascrcp.kinematics.task import project_task

SAME = 0.01
"""Joints of two solutions of a point that differ by less [rad, m] go over into each other."""


def patch(q: Array, spare: Array, gaps: Array) -> Array:
    """Take the spare joints (n, joints) where q has none, and beside that for as far as the two differ.

    A lost point filled in alone would throw the arm from one posture to another and back. Gaps are the
    distances from the point before [m], infinite where a stroke begins, (n,).
    """
    lost = ~np.isfinite(q[:, 0])
    differs = ~(np.abs(q - spare).max(axis=1) <= SAME) & np.isfinite(spare[:, 0])
    taken = differs & (sum_stretches(differs, lost, gaps) > 0.0)
    return np.where(taken[:, None], spare, q)


def straighten(
    arm: Arm, metric: Array, T: Array, q: Array, steep: Array, keep: Callable[[Array], Array]
) -> Array:
    """Put lone points between their neighbours, where that serves.

    Args:
        arm: The arm.
        metric: Cost of a squared change of each joint, shape (joints,).
        T: Targets, shape (n, 4, 4).
        q: Joint vectors, NaN where unsolved, shape (n, joints).
        steep: Cost of the step to each point from which on it throws the arm, infinite at a cut, shape (n,).
        keep: Sets joint vectors (n, joints) to NaN that do not serve.

    Returns:
        Joint vectors, shape (n, joints).
    """
    if len(q) < 3:
        return q
    into, out, over = (_cost(metric, a, b) for a, b in ((q[:-2], q[1:-1]), (q[1:-1], q[2:]), (q[:-2], q[2:])))
    joined = np.isfinite(steep[1:-1] + steep[2:])
    lone = joined & (into > steep[1:-1]) & (out > steep[2:]) & (over < np.minimum(into, out))
    rows = np.flatnonzero(lone) + 1
    tried = np.full_like(q, np.nan)
    tried[rows] = project_task(arm, T[rows], (q[rows - 1] + q[rows + 1]) / 2.0, metric)
    tried = keep(tried)
    less = _cost(metric, q[rows - 1], tried[rows]) + _cost(metric, tried[rows], q[rows + 1])
    taken = rows[less < into[lone] + out[lone]]
    straight = q.copy()
    straight[taken] = tried[taken]
    return straight


def _cost(metric: Array, a: Array, b: Array) -> Array:
    """Squared travel time from joint vectors a to b, each (n, joints); (n,)."""
    return np.asarray((metric * (b - a) ** 2).sum(axis=1))
