"""The inverses' promises, held over many poses (the full size is `ascrcp bench proof`)."""

import numpy as np
import pytest

from ascrcp.kinematics import Arm, load_arm
from ascrcp.kinematics.proof import (
    check_round_trip,
    draw_singular,
    draw_within_limits,
    expected_gap,
    least_singular_value,
    turn_between,
)
from ascrcp.kinematics.search import compare_with_search

PROMISED = 1e-10
"""Largest miss of a solution [m, rad]."""

MACHINES = pytest.mark.parametrize("name", ["kc", "muck"])


@MACHINES
def test_generating_joints_come_back_among_exact_solutions(name: str):
    arm = load_arm(name)
    trip = check_round_trip(arm, draw_within_limits(arm, 20_000, np.random.default_rng(11)))
    assert trip.gap.max() <= 1e-9
    assert max(trip.miss_m, trip.miss_rad) <= PROMISED
    assert trip.count.max() <= 8 and trip.inside.min() >= 1


@MACHINES
def test_joints_on_their_limits_come_back(name: str):
    arm = load_arm(name)
    q = draw_within_limits(arm, 20_000, np.random.default_rng(12), at_ends=0.5)
    trip = check_round_trip(arm, q, use_near=True)
    assert max(trip.miss_m, trip.miss_rad) <= PROMISED
    assert trip.count.max() <= 8 and trip.inside.min() >= 1
    assert (trip.gap <= expected_gap(arm, q)).all()


@MACHINES
def test_singular_poses_lose_no_solution_and_no_accuracy(name: str):
    arm = load_arm(name)
    q, off = draw_singular(arm, 4000, np.random.default_rng(13))
    assert len(q) > 2000 and least_singular_value(arm, q[off == 0.0]).max() < 1e-6
    trip = check_round_trip(arm, q, use_near=True)
    assert max(trip.miss_m, trip.miss_rad) <= PROMISED
    assert trip.count.max() <= 8
    assert (trip.gap <= expected_gap(arm, q)).all()


def wrist_on_slew_axis(arm: Arm, n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw joints of kc whose wrist centre lies on the slew axis; the boom must be drawn in for that."""
    q = draw_within_limits(arm, n, rng)
    q[:, 4] = np.arctan2(0.20, 4.85 + q[:, 5])  # no lateral offset
    lance_x = 0.40 + np.cos(q[:, 4]) * (4.85 + q[:, 5]) + np.sin(q[:, 4]) * 0.20
    beta = q[:, 1] + q[:, 3]
    lower = np.cos(beta) * lance_x + 0.35 + 0.30 * np.sin(q[:, 1])
    q[:, 2] = -lower / np.cos(q[:, 1]) - 4.50
    return q


def test_a_wrist_on_the_slew_axis_leaves_the_slew_to_the_reference():
    arm = load_arm("kc")
    q = wrist_on_slew_axis(arm, 500, np.random.default_rng(14))
    T = arm.forward(q)
    wrist = T[:, :3, 3] - T[:, :3, :3] @ [0.80, 0.10, 0.15]
    assert np.hypot(wrist[:, 0], wrist[:, 1]).max() < 1e-13
    trip = check_round_trip(arm, q, use_near=True)
    assert trip.gap.max() < 1e-6
    assert max(trip.miss_m, trip.miss_rad) <= PROMISED
    without = arm.inverse(T, {5: q[:, 4], 6: q[:, 5]})
    assert without.valid.any(axis=1).all()


@pytest.mark.parametrize("slide", [0.0, 1e-9, 1e-4])
def test_a_lance_straight_up_and_a_boom_at_its_fold(slide: float):
    """The lance vertical is no singularity; the boom folded onto its own joint is one."""
    arm = load_arm("kc")
    q = draw_within_limits(arm, 500, np.random.default_rng(15))
    q[:250, 3] = np.pi / 2 - q[:250, 1]
    q[250:, 2] = -4.50 + slide
    trip = check_round_trip(arm, q, use_near=True)
    assert max(trip.miss_m, trip.miss_rad) <= PROMISED
    assert (trip.gap <= expected_gap(arm, q)).all()
    assert trip.gap[:250].max() <= 1e-9


@MACHINES
def test_a_numeric_search_finds_nothing_the_closed_form_lacks(name: str):
    arm = load_arm(name)
    rng = np.random.default_rng(16)
    q = np.concatenate([draw_within_limits(arm, 40, rng), draw_within_limits(arm, 20, rng, at_ends=0.3)])
    q = q[least_singular_value(arm, q) > 1e-3]
    comparison = compare_with_search(arm, q, 120, rng)
    assert len(q) >= 40 and comparison.missing == 0
    assert comparison.found >= 0.98 * comparison.solutions
    assert comparison.gap < 1e-7


def test_turn_between_is_the_rotation_vector():
    arm = load_arm("kc")
    R = arm.forward(draw_within_limits(arm, 3, np.random.default_rng(17)))[:, :3, :3]
    for axis, w in enumerate(np.eye(3)):
        for size in (1e-12, 1e-3, 2.5):
            K = size * np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
            turned = (np.eye(3) + np.sin(size) / size * K + (1 - np.cos(size)) / size**2 * K @ K) @ R
            found = turn_between(turned, R)
            np.testing.assert_allclose(found, np.tile(size * np.eye(3)[axis], (3, 1)), atol=1e-14, rtol=1e-9)
