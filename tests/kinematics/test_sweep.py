"""Clearance between rows: what a motion passes through is found however far apart its rows are."""

import numpy as np
import pytest
from test_clearance import on_box, random_joints, smooth_heading

from ascrcp.core.errors import InputError
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.sweep import sweep_clearance

ARM = load_arm("kc")


def test_a_post_between_two_rows_is_found():
    post = on_box([6.5, -0.4, -3.0], [7.2, 0.4, 1.5], 4000)
    room = Obstacles.from_surface(smooth_heading(body=post), ARM)
    rows = np.stack([ARM.zero_pose, ARM.zero_pose])
    rows[:, 0] = np.radians([-20.0, 20.0])
    assert clearance(ARM, rows, room).distance.min() > 0.3
    found = sweep_clearance(ARM, rows, room, 0.10)
    assert found.distance.min() < 0.0 and "body" in found.text and found.at == 0
    assert (
        sweep_clearance(ARM, rows, Obstacles.from_surface(smooth_heading(), ARM), 0.10).distance.min() > 0.5
    )


def test_below_the_floor_it_agrees_with_a_dense_look():
    room = Obstacles.from_surface(smooth_heading(), ARM)
    q = random_joints(400, seed=5)
    rows = np.stack([q, q + 0.15 * (q[::-1] - q)], axis=1)
    checked = 0
    for pair in rows:
        dense = pair[0] + np.linspace(0.0, 1.0, 300)[:, None] * (pair[1] - pair[0])
        least = clearance(ARM, dense, room).distance.min()
        found = sweep_clearance(ARM, pair, room, 0.10)
        assert found.distance[0] >= least - 1e-3
        if least < 0.10:
            checked += 1
            assert found.distance[0] <= least + 0.012
    assert checked > 50


def test_a_single_row_is_no_motion():
    room = Obstacles.from_surface(smooth_heading(), ARM)
    with pytest.raises(InputError, match="two rows"):
        sweep_clearance(ARM, ARM.zero_pose[None], room, 0.1)
