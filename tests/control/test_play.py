"""Play of a joint: the sensor's side is sent ahead by half of it, and passes through it at turns."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.control.play import Play
from ascrcp.core.clock import CYCLE_S
from ascrcp.simulation.transducer import Backlash

PLAY, SPEED, REST = math.radians(0.06), math.radians(0.3), math.radians(0.02)


@given(st.lists(st.floats(-0.1, 0.1), max_size=80))
def test_offset_stays_within_the_play_and_its_speed(speeds: list[float]) -> None:
    play = Play(PLAY, SPEED, REST)
    before = 0.0
    for speed in speeds:
        play.update(speed)
        assert abs(play.offset) <= 0.5 * PLAY + 1e-12
        assert abs(play.rate) <= SPEED + 1e-12
        assert play.offset - before == pytest.approx(play.rate * CYCLE_S, abs=1e-12)
        before = play.offset


def test_moved_side_stands_where_it_was_meant_to_after_every_turn() -> None:
    """On the rig's own play: sent by the reference alone the moved side is half the play behind."""
    play, ours, plain = Play(PLAY, SPEED, REST), Backlash(PLAY, 0.0), Backlash(PLAY, 0.0)
    worst = 0.0
    for k in range(3000):
        t = k * CYCLE_S
        target, speed = 0.2 * math.sin(0.3 * t), 0.06 * math.cos(0.3 * t)
        play.update(speed)
        miss = abs(ours.advance(target + play.offset) - target)
        worst = max(worst, miss if play.rate == 0.0 and abs(speed) > REST else 0.0)
        left = abs(plain.advance(target) - target)
    assert left == pytest.approx(0.5 * PLAY)
    assert worst < 1e-9


def test_without_play_nothing_changes() -> None:
    play = Play(0.0, SPEED, REST)
    play.update(1.0)
    assert play.offset == play.rate == 0.0
