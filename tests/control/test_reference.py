"""The reference: through every row, smooth, never beyond its rows, the same in any order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ascrcp.control.reference import Reference
from ascrcp.core.flow import JointSequence

rows = arrays(np.float64, (7, 2), elements=st.floats(-3, 3, width=32))
gaps = arrays(np.float64, 6, elements=st.floats(0.03125, 2.0, width=32))


def sequence(q, gap):
    m = len(q)
    t = np.concatenate([[0.0], np.cumsum(gap)])
    position = np.stack([q[:, 0], q[:, 1], t], -1)
    direction = np.tile([1.0, 0.0, 0.0], (m, 1))
    point = np.where(np.arange(m) % 2 == 0, np.arange(m), -1)
    return JointSequence(t, q, position, direction, point, np.arange(m) % 3 == 0)


@given(rows, gaps)
def test_passes_through_its_rows_and_stays_between_them(q, gap):
    s = sequence(q, gap)
    reference = Reference(s)
    for i, t in enumerate(s.t):
        assert reference.at(float(t)).q == pytest.approx(tuple(q[i]), abs=1e-9)
    for t in np.linspace(0, s.duration, 60):
        k = min(np.searchsorted(s.t, t, side="right") - 1, len(q) - 2)
        low, high = np.minimum(q[k], q[k + 1]), np.maximum(q[k], q[k + 1])
        got = np.array(reference.at(float(t)).q)
        assert (got >= low - 1e-9).all() and (got <= high + 1e-9).all()


@given(rows, gaps)
def test_speed_is_the_derivative_and_continuous(q, gap):
    s = sequence(q, gap)
    reference = Reference(s)
    h = 1e-6
    for t in np.linspace(0.01, s.duration - 0.01, 25):
        before, after = np.array(reference.at(t - h).q), np.array(reference.at(t + h).q)
        assert reference.at(t).speed == pytest.approx(tuple((after - before) / (2 * h)), abs=2e-2, rel=1e-3)
        assert reference.speed_at(t) == reference.at(t).speed


@given(rows, gaps, st.lists(st.floats(-1, 15), max_size=20))
def test_any_order_of_instants_gives_the_same(q, gap, times):
    s = sequence(q, gap)
    walked = Reference(s)
    for t in times:
        assert walked.at(t) == Reference(s).at(t)


def test_rests_outside_and_names_points_and_spraying():
    q = np.cumsum(np.ones((7, 2)), axis=0)
    s = sequence(q, np.ones(6))
    reference = Reference(s)
    assert reference.at(-1.0).speed == (0.0, 0.0) and reference.at(-1.0).q == (1.0, 1.0)
    assert reference.at(9.0).speed == (0.0, 0.0) and reference.at(9.0).q == (7.0, 7.0)
    assert reference.points == [(0.0, 0), (2.0, 2), (4.0, 4), (6.0, 6)]
    assert [reference.at(t + 0.5).spraying for t in range(6)] == [True, False, False, True, False, False]
    assert not reference.at(6.0).spraying
    assert reference.at(2.5).speed == pytest.approx((1.0, 1.0))


def test_one_row_is_a_place():
    s = JointSequence(
        np.zeros(1), np.ones((1, 2)), np.zeros((1, 3)), np.eye(1, 3), np.array([-1]), np.array([False])
    )
    assert Reference(s).at(0.0).q == (1.0, 1.0)
