"""What the estimator learns of a drive: an offset from narrow openings, a factor from wide ones."""

import math

import pytest

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.estimator import Estimator, EstimatorGains, SensorModel

D = math.pi / 180.0
BELIEVED = Characteristic(5.0 * D, 5.0 * D, 0.06, 0.06)
STEP = 0.1 * D


def watch(estimator: Estimator, truth: Characteristic, drives: list[float], seconds: float) -> None:
    """Let a joint of another characteristic move back and forth, its sensor in steps, without delay."""
    q = 0.0
    for k in range(round(seconds / 0.02)):
        drive = drives[(k // 100) % len(drives)]
        estimator.update(round(q / STEP) * STEP, 1.0, True, 0.0)
        estimator.sent(drive)
        q += truth.speed(drive) * 0.02


@pytest.fixture
def estimator() -> Estimator:
    return Estimator(BELIEVED, 0.02, SensorModel(STEP, 0.0), EstimatorGains(0.3, 0.04, 0.8, 0.1))


def test_slower_joint_is_learned_as_a_factor(estimator: Estimator) -> None:
    watch(estimator, Characteristic(4.0 * D, 6.0 * D, 0.06, 0.06), [0.3, -0.3, 0.1, -0.1], 240.0)
    assert estimator.factor[1] == pytest.approx(0.8, abs=0.04)
    assert estimator.factor[0] == pytest.approx(1.2, abs=0.04)
    assert max(map(abs, estimator.offset)) < 0.01


def test_earlier_opening_is_learned_as_an_offset(estimator: Estimator) -> None:
    watch(estimator, Characteristic(5.0 * D, 5.0 * D, 0.05, 0.07), [0.1, -0.1, 0.3, -0.3], 240.0)
    assert estimator.offset[1] == pytest.approx(0.01, abs=0.004)
    assert estimator.offset[0] == pytest.approx(-0.01, abs=0.004)
    assert all(abs(factor - 1.0) < 0.03 for factor in estimator.factor)


def test_what_is_learned_has_bounds(estimator: Estimator) -> None:
    watch(estimator, Characteristic(0.5 * D, 20.0 * D, 0.0, 0.3), [0.5, -0.5], 120.0)
    assert all(0.6 <= factor <= 1.4 for factor in estimator.factor)
    assert all(abs(offset) <= 0.1 for offset in estimator.offset)


def test_what_was_learned_outlives_a_stop(estimator: Estimator) -> None:
    watch(estimator, Characteristic(4.0 * D, 5.0 * D, 0.06, 0.06), [0.3, -0.3], 60.0)
    kept = (list(estimator.factor), list(estimator.offset))
    estimator.clear()
    assert (estimator.factor, estimator.offset) == kept
