"""The rig's body: dead bands, asymmetry, supply, stick-slip, stops, bending, sensors, repeatability."""

import hashlib
import math

import numpy as np
import pytest
from rig_bench import ARM, UNITS, Bench, middle, only

from ascrcp.core.errors import ConfigError
from ascrcp.simulation.rig import load_rig_config

JOINTS = range(8)
CYLINDERS = [1, 2, 3, 4, 5]
CONFIG = load_rig_config().arm


def speed(joint: int, drive: float, overlay=None, load_kg: float = 0.0) -> float:
    """Steady speed of one joint under a held drive, in its own unit per second."""
    with Bench(overlay or middle(), load_kg=load_kg) as bench:
        bench.ready().run(only(joint, drive), 20)
        before = bench.q()[joint]
        bench.run(only(joint, drive), 20)
        return float(bench.q()[joint] - before) / 0.4


@pytest.mark.parametrize("joint", JOINTS)
def test_inside_the_dead_band_nothing_moves_and_beyond_it_does(joint):
    band = CONFIG.joints.rows[joint].valve.dead_band
    assert all(0.03 <= width <= 0.08 for width in band)  # design.md section 7
    for sign, width in zip((-1.0, 1.0), band, strict=True):
        assert speed(joint, sign * (width - 0.002)) == 0.0
        start = CONFIG.joints.rows[joint].stiction.breakaway or width
        assert speed(joint, sign * (start + 0.02)) * sign > 0.0


@pytest.mark.parametrize("joint", CYLINDERS)
def test_a_cylinder_retracts_faster_than_it_extends(joint):
    rows = CONFIG.joints.rows[joint].speed
    assert 1.3 <= rows[0] / rows[1] <= 1.6
    assert abs(speed(joint, -0.6)) > 1.2 * speed(joint, 0.6)


@pytest.mark.parametrize("joint", [1, 3])
def test_payload_slows_lifting_and_helps_lowering(joint):
    assert speed(joint, 0.6, load_kg=181.0) < 0.985 * speed(joint, 0.6)
    assert abs(speed(joint, -0.6, load_kg=181.0)) > 1.01 * abs(speed(joint, -0.6))


def test_cold_oil_is_slower():
    cold = middle() | {"arm": middle()["arm"] | {"oil": {"start_c": 10.0}}}
    assert speed(0, 0.6, cold) < 0.85 * speed(0, 0.6)


def test_the_supply_is_shared():
    alone = speed(0, 1.0)
    with Bench(middle()) as bench:
        bench.ready().run((1.0,) * 8, 15)
        before = bench.q()[0]
        bench.run((1.0,) * 8, 15)
        together = (bench.q()[0] - before) / 0.3
    assert 0.3 * alone < together < 0.8 * alone


@pytest.mark.parametrize("joint", [6, 7])
def test_the_smallest_drive_that_moves_joint_7_or_8_moves_it_half_a_degree(joint):
    with Bench(middle()) as bench:
        bench.ready()
        start, reading, drive = bench.q()[joint], bench.step().q[joint], 0.0
        while reading == bench.step(only(joint, drive)).q[joint]:
            drive += 0.0005
            assert drive < 0.3
        bench.run((0.0,) * 8, 30)
        assert bench.q()[joint] - start >= 0.45
        # a short pulse of a larger drive does better: what the thesis uses (section 5.1.3)
        start = bench.q()[joint]
        bench.run(only(joint, 0.4), 1)
        bench.run((0.0,) * 8, 30)
        assert 0.1 < bench.q()[joint] - start < 0.45


def test_step_response_of_a_valve_is_second_order_in_its_band():
    for row in CONFIG.joints.rows:
        assert 4.0 <= row.valve.frequency_hz <= 9.0
    with Bench(middle()) as bench:
        bench.ready()
        trace = []
        for _ in range(40):
            bench.step(only(0, 0.5))
            trace.append(bench.q()[0])
    rate = np.diff(trace) / 0.02
    steady = rate[-1]
    rise = np.argmax(rate >= 0.9 * steady) * 0.02
    assert 0.04 <= rise <= 0.2
    assert rate.max() <= 1.1 * steady and rate[0] == 0.0


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("side", [0, 1])
def test_end_stops_hold_under_full_drive(joint, side):
    low, high = stops = CONFIG.joints.rows[joint].stops
    name = f"j{joint + 1}"
    near = stops[side] + (1.0 - 2 * side) * 0.5
    with Bench(middle(**{name: {"start": near}})) as bench:
        bench.ready()
        for _ in range(60):
            bench.step(only(joint, 2.0 * side - 1.0))
            assert low - 0.031 <= bench.q()[joint] <= high + 0.031  # half the slew's backlash
        assert bench.q()[joint] == pytest.approx(stops[side], abs=0.031)


def test_stops_lie_beyond_the_hard_limits_and_inside_what_sensors_can_show():
    ranges = [(-180, 90), (-25, 75), (0, 1900), None, (-37.5, 37.5), (0, 2200), (0, 360), (0, 240)]
    for row, limits in zip(CONFIG.joints.rows, ranges, strict=True):
        if limits is not None:
            beyond = 1.0 if row.unit == "deg" else 10.0  # fault F13
            assert row.stops[0] < limits[0] - beyond and row.stops[1] > limits[1] + beyond


def test_standing_still_the_sensors_tell_the_truth_within_a_step():
    with Bench(middle()) as bench:
        bench.ready()
        worst = np.zeros(8)
        for _ in range(100):
            error = np.abs(np.array(bench.step().q) - bench.rig.true_q()) / UNITS
            worst = np.maximum(worst, error)
    # joint 4 carries the error of two inclinometers
    assert (worst <= [0.15, 0.2, 1.8, 0.35, 0.15, 1.8, 0.15, 0.15]).all(), worst
    assert worst.max() > 0.0


def test_inclinometers_lag_by_100_ms():
    with Bench(middle()) as bench:
        bench.ready().run(only(1, 0.6), 60)
        late = []
        for _ in range(40):
            inputs = bench.step(only(1, 0.6))
            late.append((bench.rig.true_q()[1] - inputs.q[1]) / UNITS[1])
        rate = speed(1, 0.6)
    assert np.mean(late) / rate == pytest.approx(0.1, abs=0.02)


def test_sag_is_down_grows_with_reach_and_payload():
    def drop(reach_mm: float, load_kg: float) -> float:
        overlay = middle(
            j3={"start": reach_mm * 0.9}, j6={"start": reach_mm}, j2={"start": 10.0}, j4={"start": -10.0}
        )
        with Bench(overlay, load_kg=load_kg) as bench:
            bent, rigid = bench.rig.true_nozzle(), ARM.forward(bench.rig.true_q())
        assert np.allclose(bent[:3, :3] @ bent[:3, :3].T, np.eye(3), atol=1e-12)
        assert bent[0, 3] == pytest.approx(rigid[0, 3]) and bent[1, 3] == pytest.approx(rigid[1, 3])
        tip = math.degrees(math.acos((np.trace(bent[:3, :3] @ rigid[:3, :3].T) - 1) / 2))
        assert 0.2 < tip < 1.2
        return float(rigid[2, 3] - bent[2, 3])

    assert 0.045 < drop(0.0, 0.0) < drop(2100.0, 0.0) < 0.1  # class of thesis table 2-1
    assert drop(2100.0, 0.0) + 0.01 < drop(2100.0, 181.0) < 0.16


def test_the_boom_rings_at_about_one_hertz_and_dies_slowly():
    with Bench(middle(j2={"start": 10.0}, j4={"start": 0.0})) as bench:
        bench.ready().run(only(1, 0.6), 25)
        bench.run((0.0,) * 8, 15)
        static = []
        for _ in range(400):
            bench.step()
            static.append(bench.rig.true_nozzle()[2, 3])
    z = np.array(static) - np.mean(static[200:])
    crossings = np.flatnonzero(np.diff(np.sign(z[:250])))
    frequency = 1.0 / (2 * 0.02 * np.mean(np.diff(crossings)))
    assert 0.7 < frequency < 1.6
    assert np.abs(z[:50]).max() > 0.01  # it matters: centimetres
    decay = np.abs(z[200:250]).max() / np.abs(z[:50]).max()
    zeta = -math.log(decay) / (2 * math.pi * frequency * 4.0)
    assert 0.02 < zeta < 0.09


def test_joints_7_and_8_do_not_shake_the_boom():
    with Bench(middle()) as bench:
        bench.ready()
        before = bench.rig.T_base_mount()
        bench.run((0.0,) * 6 + (0.5, 0.5), 30)
        assert np.allclose(bench.rig.T_base_mount(), before, atol=1e-12)
        assert not np.allclose(bench.rig.true_nozzle()[:3, 3], before[:3, 3], atol=0.1)


def test_the_slew_has_play():
    with Bench(middle()) as bench:
        bench.ready().run(only(0, 0.5), 30)
        bench.run((0.0,) * 8, 30)
        driven = bench.rig._hydraulics.q[0] / UNITS[0]
        assert driven - bench.q()[0] == pytest.approx(0.03, abs=1e-9)


def log(seed: int, overlay=None) -> str:
    digest = hashlib.sha256()
    with Bench(overlay, seed=seed) as bench:
        bench.ready()
        for k in range(150):
            bench.step([0.3 * math.sin(0.05 * k + joint) for joint in JOINTS], pump=0.5)
            for can_id, data in bench.link.received + bench.link.sent:
                digest.update(can_id.to_bytes(2, "big") + data)
    return digest.hexdigest()


@pytest.mark.parametrize("overlay", [None, {"bus": {"loss_probability": 0.02, "corrupt_probability": 0.02}}])
def test_g18_one_seed_gives_the_same_frames_and_another_does_not(overlay):
    assert log(5, overlay) == log(5, overlay)
    assert log(5, overlay) != log(6, overlay)


@pytest.mark.parametrize("load_kg", [-1.0, 501.0, math.nan])
def test_an_absurd_payload_is_refused(load_kg):
    with pytest.raises(ConfigError, match="load_kg"):
        Bench(load_kg=load_kg)
