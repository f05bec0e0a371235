"""Joint moves: arrive exactly, within speed and acceleration, near joint before far joint."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from run import CONTROL

from ascrcp.control.move import plan_move
from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.kinematics.arm import load_arm

ARM = load_arm("kc")


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    while True:
        q = rng.uniform(ARM.lower, ARM.upper)
        if ARM.within_limits(q):
            return q


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(0, 10**6))
def test_moves_stay_within_limits_speed_and_acceleration(a, b):
    start, end = pose(a), pose(b)
    s = plan_move(ARM, start, end, CONTROL)
    assert (s.q[0] == start).all() and (s.q[-1] == end).all()
    assert ARM.within_limits(s.q).all()
    speed = np.diff(s.q, axis=0) / np.diff(s.t)[:, None]
    assert (np.abs(speed) <= ARM.max_speed * CONTROL.move.speed * 1.001 + 1e-9).all()
    bent = np.diff(speed, axis=0) / CONTROL.move.row_s
    assert (np.abs(bent) <= ARM.max_acceleration * CONTROL.move.acceleration * 1.3 + 1e-6).all()
    assert (s.point == -1).all() and not s.spraying.any()
    assert np.allclose(s.position, ARM.forward(s.q)[:, :3, 3])


def test_coupled_joints_move_one_after_the_other():
    start = np.array([0.0, 0.2, 0.5, 0.0, 0.0, 0.5, 1.0, 1.0])
    end = start + np.array([0.1, 0.3, 0.2, -0.2, 0.0, 0.0, 0.0, 0.0])
    s = plan_move(ARM, start, end, CONTROL)
    near, far = (np.abs(np.diff(s.q[:, j])) > 1e-9 for j in (1, 3))
    assert not (near & far).any()
    assert np.flatnonzero(near).max() < np.flatnonzero(far).min()


def test_coupled_joints_change_order_where_the_limit_asks_for_it():
    start = np.array([0.0, 0.0, 0.5, 1.2, 0.0, 0.5, 1.0, 1.0])
    end = start + np.array([0.0, 0.6, 0.0, -0.6, 0.0, 0.0, 0.0, 0.0])
    s = plan_move(ARM, start, end, CONTROL)
    assert ARM.within_limits(s.q).all()
    near, far = (np.abs(np.diff(s.q[:, j])) > 1e-9 for j in (1, 3))
    assert np.flatnonzero(far).max() < np.flatnonzero(near).min()


def test_no_way_to_go_is_one_row():
    s = plan_move(ARM, ARM.zero_pose, ARM.zero_pose, CONTROL)
    assert len(s.t) == 1 and s.duration == 0.0


def test_bad_ends_are_refused():
    q = ARM.zero_pose
    for bad in (q[:7], np.where(np.arange(8) == 3, np.nan, q)):
        with pytest.raises(InputError):
            plan_move(ARM, bad, q, CONTROL)
        with pytest.raises(InputError):
            plan_move(ARM, q, bad, CONTROL)
    with pytest.raises(UnreachableError):
        plan_move(ARM, q, q + 10.0, CONTROL)


def test_same_move_twice_is_bit_identical():
    a, b = (plan_move(ARM, pose(1), pose(2), CONTROL) for _ in range(2))
    assert (a.q == b.q).all() and (a.t == b.t).all()
