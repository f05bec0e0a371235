"""The controllers of the papers beside ours: fuzzy tables, integral separation, order on the rig."""

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from run import CONTROL

from ascrcp.cli.bench_joint import PRINTED, measure_separation, run_moves
from ascrcp.control.choice import CONTROLLERS, make_controller
from ascrcp.control.config import FuzzyConfig, JointConfig
from ascrcp.control.fuzzy import RULES_KD, RULES_KI, RULES_KP, FuzzyControl, infer, membership
from ascrcp.control.joint import Want
from ascrcp.core.config import convert
from ascrcp.core.errors import ConfigError
from ascrcp.kinematics.arm import load_arm

ARM = load_arm("kc")


def wish(error: float) -> Want:
    return Want(error, 0.0, 0.0, 0.0, error)


@given(st.floats(-10.0, 10.0))
def test_every_value_belongs_to_its_neighbours_wholly(value):
    shares = membership(value)
    assert shares.sum() == pytest.approx(1.0) and (shares >= 0.0).all() and (shares > 0.0).sum() <= 2


@pytest.mark.parametrize(
    "rules, error, rate, sign",
    [
        (RULES_KP, -3.0, -3.0, 1), (RULES_KP, 3.0, 3.0, -1), (RULES_KP, 0.0, 0.0, 0),
        (RULES_KI, -3.0, -3.0, -1), (RULES_KI, 3.0, 3.0, 1), (RULES_KI, 0.0, 0.0, 0),
        (RULES_KD, -1.0, -3.0, -1), (RULES_KD, -3.0, 3.0, 1), (RULES_KD, 0.0, 1.0, 0),
    ],
)  # fmt: skip
def test_corners_of_tables_5_3_to_5_5(rules, error, rate, sign):
    found = infer(rules, error, rate)
    assert abs(found) <= 3.0 + 1e-9
    assert np.sign(found) == sign if sign else abs(found) < 1e-9


def test_tables_have_the_symmetry_of_the_plant_where_the_thesis_printed_it():
    """Kp: turning both error and rate around turns the correction around, save in the printed odd places."""
    odd = 0
    for e in range(-3, 4):
        for r in range(-3, 4):
            odd += abs(infer(RULES_KP, e, r) + infer(RULES_KP, -e, -r)) > 1.2
    assert odd <= 2


def test_fuzzy_interpolates_what_the_rules_infer():
    tree = {"kp": 0.1, "kp_span": 0.05, "rate_share": 0.0}
    config = msgspec.structs.replace(CONTROL.joints[0], ramp=1.0, fuzzy=convert(tree, FuzzyConfig, "test"))
    for error in (-2.0, -0.25, 0.5, 1.75, 3.0):
        drive = FuzzyControl(config).drive(wish(np.radians(error)))
        kp = 0.1 + 0.05 * infer(RULES_KP, error, 0.0) / 3.0
        assert drive == pytest.approx(max(-1, min(1, kp * error)), rel=1e-6)


def test_figure_10_of_the_second_paper():
    figures = {figure.what: figure for figure in measure_separation(CONTROL.joints[3])}
    assert figures["figure 10, classic PID, overshoot"].value == pytest.approx(21.3, abs=1.0)
    assert figures["figure 10, separated PID, overshoot"].value == pytest.approx(2.6, abs=1.0)


def test_every_controller_can_be_named_and_pulses_need_settings():
    for name in CONTROLLERS:
        config = msgspec.structs.replace(CONTROL.joints[6], controller=name)
        assert make_controller(config).drive(wish(0.0)) == 0.0
    tree = {**msgspec.to_builtins(CONTROL.joints[0]), "controller": "pulsed"}
    with pytest.raises(ConfigError, match="pulse settings"):
        convert(tree, JointConfig, "test")
    with pytest.raises(ConfigError, match="controller"):
        convert({**tree, "controller": "magic"}, JointConfig, "test")


def test_order_of_the_thesis_on_the_rig():
    """Classic > fuzzy > segmented, and ours within the sensors' steps at rest on all eight joints."""
    scale = np.array(PRINTED["own"])
    runs = {
        name: run_moves(ARM, CONTROL, name, 1, moves=3) for name in ("position", "fuzzy", "segmented", "own")
    }
    mean = {name: (run.shown.mean(axis=0) / scale).mean() for name, run in runs.items()}
    assert mean["position"] > mean["fuzzy"] > mean["segmented"]
    assert (runs["own"].shown.mean(axis=0) <= scale).all()
    assert (runs["own"].true.mean(axis=0) <= 1.2 * scale).all()
