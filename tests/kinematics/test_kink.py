"""Single points that would throw the arm: put between their neighbours, filled in with those beside them."""

import numpy as np
from test_clearance import random_joints

from ascrcp.kinematics import load_arm
from ascrcp.kinematics.kink import patch, straighten
from ascrcp.kinematics.smooth import make_cost
from ascrcp.kinematics.task import compute_error

ARM = load_arm("kc")
METRIC = make_cost(ARM, ARM.description.path).metric
STEEP = np.append(np.inf, np.full(8, 0.5))


def chain() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nine poses along a straight way in joint space, their joints, and the same with one thrown off."""
    begin = random_joints(40, seed=1)[0]
    q = begin + 2e-3 * np.arange(9.0)[:, None] * np.ones(ARM.n)
    thrown = q.copy()
    thrown[4] += 0.1  # its step is dear, and back again
    return ARM.forward(q), q, thrown


def test_a_lone_point_goes_back_between_its_neighbours_and_onto_its_target():
    T, q, thrown = chain()
    found = straighten(ARM, METRIC, T, thrown, STEEP, lambda tried: tried)
    np.testing.assert_array_equal(np.delete(found, 4, axis=0), np.delete(q, 4, axis=0))
    assert compute_error(ARM, T, found).size[4] < 1e-6
    assert np.abs(found[4] - q[4]).max() < 1e-3


def test_a_point_that_would_not_serve_there_or_stands_at_a_cut_or_moves_on_stays():
    T, q, thrown = chain()
    nothing = straighten(ARM, METRIC, T, thrown, STEEP, lambda tried: np.full_like(tried, np.nan))
    np.testing.assert_array_equal(nothing, thrown)
    cut = np.where(np.arange(9) == 5, np.inf, STEEP)
    np.testing.assert_array_equal(straighten(ARM, METRIC, T, thrown, cut, lambda tried: tried), thrown)
    onward = np.where(np.arange(9)[:, None] >= 4, q + 0.1, q)  # another posture from there on
    np.testing.assert_array_equal(straighten(ARM, METRIC, T, onward, STEEP, lambda tried: tried), onward)
    lost = np.where(np.arange(9)[:, None] == 3, np.nan, thrown)
    np.testing.assert_array_equal(straighten(ARM, METRIC, T, lost, STEEP, lambda tried: tried), lost)


def test_a_lost_point_is_filled_in_with_those_beside_it_that_differ():
    _, q, _ = chain()
    spare = q.copy()
    spare[2:7] += 0.3
    lost = np.where(np.arange(9)[:, None] == 4, np.nan, q)
    gaps = np.append(np.inf, np.full(8, 0.2))
    found = patch(lost, spare, gaps)
    np.testing.assert_array_equal(found[2:7], spare[2:7])
    np.testing.assert_array_equal(np.delete(found, range(2, 7), 0), np.delete(q, range(2, 7), 0))
