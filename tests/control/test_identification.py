"""Identification on joints whose drive is known, and tuning of rigs over the bus."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from run import CONTROL

from ascrcp.cli.cell import Cell
from ascrcp.cli.tune import encode_control, tuning_pose
from ascrcp.control.characteristic import Characteristic
from ascrcp.control.config import ControlConfig
from ascrcp.control.identification import Trial, fit_characteristic, fit_creep, fit_delay, fit_line
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.config import load
from ascrcp.core.errors import InputError
from ascrcp.kinematics.arm import load_arm
from ascrcp.session.tuning import LEVELS, Tuner
from ascrcp.simulation.draw import draw_rig, load_range
from ascrcp.simulation.rig import load_rig_config

ARM = load_arm("kc")
D = np.pi / 180
RESOLUTION = 0.1 * D


def trial(level: float, truth: Characteristic, delay: float, lag_s: float, cycles: int = 175) -> Trial:
    """Drive a joint of known characteristic, in steps of 1 ms, and read it as a sensor does."""
    dt, position, shown, readings = 1e-3, 0.013 * D, 0.013 * D, []
    for k in range(cycles):
        readings.append(round(shown / RESOLUTION) * RESOLUTION)
        for i in range(20):
            t = k * CYCLE_S + i * dt
            position += dt * truth.speed(level if t >= delay else 0.0)
        shown = position if lag_s == 0.0 else shown + (1 - np.exp(-CYCLE_S / lag_s)) * (position - shown)
    return Trial((level,) * cycles, tuple(readings))


@settings(max_examples=10)
@given(
    st.floats(4.0, 10.0), st.floats(1.0, 1.6), st.floats(0.03, 0.08), st.floats(0.03, 0.08),
    st.floats(0.04, 0.12), st.sampled_from([0.0, 0.1]),
)  # fmt: skip
def test_known_drive_is_found_from_coarse_readings(full, ratio, dead_up, dead_down, delay, lag_s):
    truth = Characteristic(full * D, full * ratio * D, dead_up, dead_down)
    trials = [trial(s * u, truth, delay, lag_s) for u in LEVELS for s in (1, -1)]
    found = fit_characteristic(trials)
    assert found.full_up == pytest.approx(truth.full_up, rel=0.06)
    assert found.full_down == pytest.approx(truth.full_down, rel=0.06)
    assert found.dead_up == pytest.approx(dead_up, abs=0.006)
    assert found.dead_down == pytest.approx(dead_down, abs=0.006)
    assert fit_delay(trials, found, lag_s) == pytest.approx(delay, abs=0.02)


def test_joint_that_does_not_obey_is_refused():
    with pytest.raises(InputError, match="does not move"):
        fit_line([0.1, 0.2, 0.3], [0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="does not move"):
        fit_line([0.1, 0.2, 0.3], [-1.0, -2.0, -3.0])
    with pytest.raises(InputError, match="does not rise"):
        fit_line([0.1, 0.2, 0.3], [3.0, 2.0, 1.0])
    with pytest.raises(InputError, match="too short"):
        fit_characteristic([Trial((0.1,) * 20, (0.0,) * 20)] * 2)
    with pytest.raises(InputError, match="longer pieces"):
        fit_creep([(5, 0.1), (10, 0.1), (15, 0.05)])


def test_creep_and_tail_of_pieces():
    found = fit_creep([(n, 6.0 * D * (n * CYCLE_S + 0.01)) for n in (6, 12, 18)])
    assert found.speed == pytest.approx(6.0 * D) and found.tail_s == pytest.approx(0.01)


def test_tuning_a_drawn_rig_finds_its_drives(tmp_path):
    overlay = draw_rig(load_rig_config().arm, load_range(), np.random.default_rng(7))
    config = load_rig_config(overlay)
    with Cell(config, ARM, ARM, seed=3) as cell:
        found = Tuner(cell, ARM, CONTROL).tune(tuning_pose(ARM), lambda _: None)
        q = cell.rig.true_q()
    assert np.abs(q - np.array(tuning_pose(ARM))).max() < 0.3  # small motions about the pose
    warm = 1.0 + config.arm.oil.gain_per_c * (found.oil_c - config.arm.oil.reference_c)
    for joint, truth in zip(found.control.joints[:6], config.arm.joints.rows[:6], strict=True):
        loaded = 0.25 if truth.load.kind != "none" else 0.06
        for got, wanted in zip(joint.full_speed, reversed(truth.speed), strict=True):
            assert got == pytest.approx(wanted * warm, rel=loaded)
        for got, wanted in zip(joint.dead_band, reversed(truth.valve.dead_band), strict=True):
            assert got == pytest.approx(wanted, abs=0.008)
        valve = truth.valve
        delay = valve.dead_time_s + 2.0 * valve.damping / (2.0 * np.pi * valve.frequency_hz)
        late = truth.sensor.lag_s - joint.lag_s  # a sensor slower than believed looks like a slow valve
        assert joint.delay_s == pytest.approx(delay + late, abs=0.025)
    for joint, truth in zip(found.control.joints[6:], config.arm.joints.rows[6:], strict=True):
        assert truth.stiction.breakaway < joint.stick_slip.drive < 2.0 * truth.stiction.breakaway
        assert joint.stick_slip.creep == pytest.approx(truth.stiction.creep_speed, rel=0.15)
    file = tmp_path / "tuned.yaml"
    file.write_text(encode_control(found, "test"))
    assert load(file, ControlConfig) == found.control
