"""The follower alone: samples made by hand, as a joystick's steering makes them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plant import RESOLUTION, Plant
from run import CONTROL

from ascrcp.control.follower import Follower
from ascrcp.control.reference import Sample
from ascrcp.core.clock import CYCLE_S

START = (0.1, 0.3, 0.9, -0.1, 0.05, 1.0, 3.0, 2.0)
SPEED = (0.03, 0.02, 0.05, -0.02, 0.03, -0.05, 0.1, 0.08)


def sample(q, speed) -> Sample:
    return Sample(tuple(q), tuple(speed), (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), True)


def steer(follower: Follower, plant: Plant, seconds: float, scale: float = 1.0):
    """Move every joint at its speed for some time, then let it stand for three seconds."""
    q = np.array(START)
    for k in range(int((seconds + 3.0) / CYCLE_S)):
        speed = np.array(SPEED) if k < seconds / CYCLE_S else np.zeros(8)
        q = q + speed * scale * CYCLE_S
        inputs = replace(plant.inputs(), controller_enabled=True)
        followed = follower.update(sample(q, speed), inputs, scale=scale)
        plant.step(replace(plant.pending, drive=followed.drive, enable=True))
    return q, followed


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_samples_made_on_the_fly_are_followed_to_their_end(scale):
    plant = Plant(START)
    q, followed = steer(Follower(CONTROL), plant, 5.0, scale)
    assert np.abs(q - START).min() > 0.04 * scale
    assert (np.abs(q - plant.q) <= 3.0 * np.array(RESOLUTION)).all()
    assert followed.behind < 1.0


def test_a_joint_that_stands_falls_behind():
    plant, follower = Plant(START), Follower(CONTROL)
    inputs = replace(plant.inputs(), controller_enabled=True)
    slow = CONTROL.joints[4].slow * CONTROL.joints[4].si
    for share in (0.5, 1.5):
        q = (*START[:4], START[4] + share * slow, *START[5:])
        follower.clear()
        followed = follower.update(sample(q, (0.0,) * 8), inputs)
        assert followed.behind == pytest.approx(share, abs=0.05)
        assert followed.error_q[4] == pytest.approx(share * slow, abs=1e-3)


def test_sample_that_is_no_number_gives_no_drive_the_link_would_send():
    plant, follower = Plant(START), Follower(CONTROL)
    q = (*START[:3], math.nan, *START[4:])
    followed = follower.update(sample(q, (0.0,) * 8), plant.inputs())
    assert math.isnan(followed.drive[3]) and math.isnan(followed.error_q[3])
