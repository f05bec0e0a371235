"""The second scan pose: as far in as is clear, no further than the middle, none where there is no room."""

import numpy as np
import pytest
from test_clearance import on_box, smooth_heading

from ascrcp.kinematics import load_arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.look import LEAST_M, STEP_M, find_look_pose
from ascrcp.kinematics.obstacle import Obstacles

ARM = load_arm("kc")
WANTED = ARM.description.clearance.wanted


def looked(**more):
    surface = smooth_heading(**more)
    room = Obstacles.from_surface(surface, ARM)
    return find_look_pose(ARM, room, surface), room, surface


def test_the_lidar_goes_to_the_middle_of_the_heading_and_only_its_telescope_moves():
    pose, room, surface = looked()
    assert pose is not None
    moved = np.flatnonzero(pose != ARM.zero_pose)
    assert moved.tolist() == [5] and pose[5] >= LEAST_M - 1e-9
    ahead = ARM.lidar(pose)[0, 3] - ARM.lidar(ARM.zero_pose)[0, 3]
    assert ahead == pytest.approx(pose[5], abs=1e-9)
    middle = float(np.mean(surface.unsprayed))
    way = np.repeat(ARM.zero_pose[None], 30, axis=0)
    way[:, 5] = np.linspace(0.0, pose[5], 30)
    assert (least_distance(ARM, way, room) >= WANTED - 0.02).all()
    further = pose.copy()
    further[5] += STEP_M
    past = ARM.lidar(further)[0, 3] > middle - 0.1
    assert past or further[5] > ARM.upper[5] or least_distance(ARM, further[None], room)[0] < WANTED


def test_what_stands_before_the_lance_keeps_it_back_or_out():
    whole = looked()[0]
    tip = float(ARM.forward(ARM.zero_pose)[0, 3])

    def behind_body(ahead):
        body = on_box([tip + ahead, -0.6, -0.4], [tip + ahead + 0.4, 0.6, 1.0], 9000)
        return looked(body=body)[:2]

    pose, room = behind_body(1.5)
    assert pose is not None and LEAST_M - 1e-9 <= pose[5] < whole[5]
    assert least_distance(ARM, pose[None], room)[0] >= WANTED
    assert behind_body(0.7)[0] is None


def test_an_arm_whose_lidar_sits_on_no_telescope_has_none():
    surface = smooth_heading()
    room = Obstacles.from_surface(surface, ARM)
    assert find_look_pose(load_arm("muck"), room, surface) is None
