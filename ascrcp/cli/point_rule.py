"""The paper's rule for a path: each point by itself from the one before (thesis 2.2), to compare with."""

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.candidate import find_candidates, make_grid
from ascrcp.kinematics.choice import travel_cost
from ascrcp.kinematics.task import find_roll, roll_pose


def follow_point_by_point(arm: Arm, T: Array, start_q: Array) -> Array:
    """Choose every point's joints by least weighted travel from the point before.

    Joints 5 and 6 and the roll are held where they are, as the thesis holds them, for as long as that
    leaves a solution within limits; where it does not, all of the solver's candidates are looked at.

    Args:
        arm: An arm with a path model.
        T: Poses at theta1 = 0, shape (n, 4, 4).
        start_q: Joint vector before the first [rad, m], shape (joints,).

    Returns:
        Joint vectors, NaN where no candidate keeps the limits, shape (n, joints).
    """
    model = arm.description.path
    if model is None:
        raise InputError(f"machine {arm.name} has no path model")
    grid = make_grid(arm, model)
    q = np.full((len(T), arm.n), np.nan)
    last, roll, increment = np.asarray(start_q, dtype=float), None, None
    for i in range(len(T)):
        options = np.empty((0, arm.n))
        if roll is not None:
            found = arm.inverse(roll_pose(T[i : i + 1], roll), {5: last[4], 6: last[5]})
            options = found.q[0][found.within_limits[0]]
        if not len(options):
            options = find_candidates(arm, T[i : i + 1], grid)[0]
        if not len(options):
            continue
        q[i] = options[travel_cost(arm, options, last, increment).argmin()]
        increment = q[i] - last if roll is not None else None
        roll = find_roll(T[i : i + 1], arm.forward(q[i : i + 1]))
        last = q[i]
    return q


def peak_acceleration(arm: Arm, q: Array, gap_s: Array) -> Array:
    """Compute the largest acceleration of each joint along a path, over what the joint is allowed.

    Args:
        arm: The arm.
        q: Joint vectors, NaN where unsolved, shape (n, joints).
        gap_s: Time from the point before [s], infinite where the course is broken, shape (n,).

    Returns:
        Shares of the greatest acceleration, shape (joints,).
    """
    speed = np.diff(q, axis=0) / gap_s[1:, None]
    mean_gap = (gap_s[1:-1] + gap_s[2:]) / 2
    acceleration = np.diff(speed, axis=0) / mean_gap[:, None]
    usable = np.isfinite(mean_gap) & np.isfinite(acceleration).all(axis=1)
    return np.asarray((np.abs(acceleration[usable]) / arm.max_acceleration).max(axis=0, initial=0.0))
