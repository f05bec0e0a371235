"""bench realtime tells what was measured, and judges it by what is asked."""

from typing import Any

import pytest

from ascrcp.cli.bench_realtime import tell_realtime

GOOD: dict[str, Any] = {
    "ok": True,
    "failure": "",
    "cycles": 3000,
    "late_ms": {"p50": 0.1, "p99": 0.4, "p99_9": 1.2, "max": 4.0},
    "missed": 0,
    "body_ms": {"p50": 0.4, "p99": 0.8, "p99_9": 1.0, "max": 2.0},
    "lock_ms": {"p50": 0.1, "p99": 0.4, "p99_9": 1.5, "max": 3.0},
    "twin_ms": {"p50": 0.1, "p99": 0.2, "p99_9": 0.4, "max": 0.9},
    "collector_ms": [{"count": 30, "max": 0.2}, {"count": 3, "max": 0.3}, {"count": 1, "max": 6.0}],
    "burden": {"load": 1.0, "own": 0.6, "others": 0.1, "faults": 0},
    "steps": ["zero", "recognise", "recognise", "load"],
    "computed": 2,
    "priority": True,
}


def test_a_good_run_meets_every_aim() -> None:
    assert all(figure.is_met is not False for figure in tell_realtime(GOOD))


@pytest.mark.parametrize(
    "change",
    [
        {"ok": False, "failure": "no lidar"},
        {"missed": 1},
        {"late_ms": {"p50": 0.1, "p99": 0.4, "p99_9": 2.1, "max": 4.0}},
        {"late_ms": {"p50": 0.1, "p99": 0.4, "p99_9": 1.0, "max": 10.1}},
        {"body_ms": {"p50": 0.4, "p99": 1.1, "p99_9": 1.2, "max": 2.0}},
    ],
)
def test_each_aim_can_be_missed(change: dict[str, Any]) -> None:
    assert [figure.is_met for figure in tell_realtime(GOOD | change)].count(False) == 1


def test_without_priority_more_lateness_is_allowed() -> None:
    late = {"p50": 0.1, "p99": 0.4, "p99_9": 4.9, "max": 9.0}
    figures = tell_realtime(GOOD | {"priority": False, "late_ms": late})
    assert all(figure.is_met is not False for figure in figures)
