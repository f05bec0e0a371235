"""Routes of moves: out of a pocket that only the way driven leads out of."""

from itertools import pairwise

import numpy as np
import pytest
from test_clearance import on_box, smooth_heading

from ascrcp.core.errors import UnreachableError
from ascrcp.kinematics import load_arm, route
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.route import find_route, thin_trail

ARM = load_arm("kc")
LEAST = ARM.description.clearance.least

# a posture beside a long body and one on its other side, each reached from the zero pose
BESIDE = np.array([0.562818, -0.392710, 1.537164, 0.687557, -0.370581, 0.140491, 0.633102, 4.130008])
ACROSS = np.array([-0.370383, -0.124239, 1.203636, -0.222282, 0.276360, 0.973609, 5.917777, 1.859285])


def room_with_body() -> Obstacles:
    body = on_box([7.0, 1.8, -3.0], [11.0, 2.6, -0.2], 9000)
    return Obstacles.from_surface(smooth_heading(body=body), ARM)


def rows_of(stops: list[np.ndarray]) -> np.ndarray:
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return np.concatenate([a + share * (b - a) for a, b in pairwise(stops)])


def test_the_way_driven_leads_where_the_graph_does_not_and_every_leg_stays_clear(monkeypatch):
    room = room_with_body()
    ways = [
        rows_of([ARM.zero_pose, *find_route(ARM, ARM.zero_pose, end, room), end]) for end in (BESIDE, ACROSS)
    ]
    monkeypatch.setattr(route, "MOST_ROUNDS", 0)  # as in a pocket: the graph of middles gives up
    with pytest.raises(UnreachableError):
        find_route(ARM, BESIDE, ACROSS, room)
    between = find_route(ARM, BESIDE, ACROSS, room, trails=[way[::-1] for way in ways])
    rows = rows_of([BESIDE, *between, ACROSS])
    assert clearance(ARM, rows, room).distance.min() >= LEAST - 0.01


def test_a_trail_is_thinned_from_its_beginning_and_keeps_both_ends():
    trail = ARM.zero_pose + np.linspace(0.0, 1.0, 2001)[:, None] * (BESIDE - ARM.zero_pose) * 20.0
    thin = thin_trail(ARM, trail)
    steps = (np.abs(np.diff(thin, axis=0)) / ARM.max_speed).max(axis=1)
    np.testing.assert_array_equal(thin[[0, -1]], trail[[0, -1]])
    assert len(thin) < 100 and steps[0] < 1.0 and steps[-2] > 10.0 and steps.sum() > 100.0
