"""Errors of a run against what geometry says they must be."""

import numpy as np
import pytest

from ascrcp.session.evaluation import RunTrace, cross_track_mm, evaluate


def straight_run(shift: np.ndarray, turn_deg: float) -> RunTrace:
    t = np.arange(0.0, 10.0, 0.02)
    reference = np.zeros((len(t), 6))
    reference[:, 0] = 0.3 * t
    reference[:, 5] = 1.0
    nozzle = reference.copy()
    nozzle[:, :3] += shift
    nozzle[:, 3], nozzle[:, 5] = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
    spraying = (t < 8.0).astype(float)
    point = np.full(len(t), -1.0)
    point[::50] = np.arange(len(point[::50]))
    return RunTrace(t, reference, nozzle, nozzle, spraying, point, np.zeros((len(t), 8)), True)


def test_along_track_error_is_no_cross_track_error() -> None:
    trace = straight_run(np.array([-0.05, 0.0, 0.0]), 2.0)
    result = evaluate(trace)
    assert result["nozzle_error_mm"]["max"] == pytest.approx(50.0)
    assert result["nozzle_error_deg"]["mean"] == pytest.approx(2.0)
    assert np.median(cross_track_mm(trace)) == pytest.approx(0.0, abs=1e-9)


def test_cross_track_error_is_the_distance_from_the_line() -> None:
    trace = straight_run(np.array([-0.04, 0.03, 0.0]), 0.0)
    assert np.median(cross_track_mm(trace)) == pytest.approx(30.0)
    assert evaluate(trace)["nozzle_error_mm"]["mean"] == pytest.approx(50.0)


def test_points_are_judged_by_the_rule_of_the_thesis() -> None:
    assert evaluate(straight_run(np.array([0.0, 0.099, 0.0]), 4.9))["at_points"]["within_rule"] == 10
    assert evaluate(straight_run(np.array([0.0, 0.101, 0.0]), 0.0))["at_points"]["within_rule"] == 0
    assert evaluate(straight_run(np.zeros(3), 5.1))["at_points"]["within_rule"] == 0


def test_an_empty_run_has_no_figures() -> None:
    z = np.zeros
    empty = RunTrace(z(0), z((0, 6)), z((0, 6)), z((0, 6)), z(0), z(0), z((0, 8)), False)
    assert evaluate(empty)["nozzle_error_mm"] == {"mean": None, "p95": None, "max": None}
