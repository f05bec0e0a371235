"""What hangs and knocks on the rig's boom, a pump that obeys the enable bit, and rigs drawn at random."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rig_bench import MIDDLE, REST, Bench

from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.simulation.draw import RANGE_FILE, RigRange, draw_rig, load_range
from ascrcp.simulation.rig import load_rig_config

STANDING = {"arm": {"joints": {f"j{i + 1}": {"start": value} for i, value in enumerate(MIDDLE)}}}
QUIET = {"arm": {"bump": {"speed": 0.0}, "hose": {"surge_kg": 0.0}}}


def height(bench: Bench) -> float:
    return float(bench.rig.true_nozzle()[2, 3])


def still(**more) -> dict:
    return {"arm": {**STANDING["arm"], **QUIET["arm"], **more}}


def test_pump_obeys_the_enable_bit():
    with Bench(QUIET) as bench:
        bench.ready()
        for _ in range(100):
            bench.step(REST, enable=False, pump=0.6)
        assert bench.rig.flow == 0.0
        for _ in range(100):
            bench.step(REST, enable=True, pump=0.6)
        assert bench.rig.flow == pytest.approx(0.6, abs=0.05)
        for _ in range(150):
            bench.step(REST, enable=False, pump=0.6)
        assert bench.rig.flow < 0.02


def test_payload_step_swings_from_the_old_sag_to_the_new():
    with Bench(still()) as bench:
        bench.ready()
        before = height(bench)
        bench.rig.set_load(100.0)
        heights = []
        for _ in range(1500):
            bench.step()
            heights.append(height(bench))
        sunk = before - heights[-1]
        assert abs(heights[0] - before) < 0.15 * sunk  # no jump
        assert sunk > 0.005
        assert before - min(heights) > 1.5 * sunk  # a lightly damped boom goes nearly twice as far at first
        with pytest.raises(ConfigError):
            bench.rig.set_load(float("nan"))


def test_concrete_fills_the_hose_while_it_flows_and_stays():
    with Bench(still(hose={"fill_kg": 100.0, "fill_s": 1.0, "surge_kg": 0.0})) as bench:
        bench.ready()
        dry = height(bench)
        for _ in range(200):
            bench.step()
        assert height(bench) == pytest.approx(dry, abs=1e-4)
        for _ in range(1000):
            bench.step(pump=0.6)
        full = height(bench)
        assert full < dry - 0.005
        for _ in range(500):
            bench.step(pump=0.0)
        assert height(bench) == pytest.approx(full, abs=2e-3)


def test_bumps_shake_the_boom_and_depend_on_the_seed_alone():
    def swing(seed: int, speed: float) -> np.ndarray:
        with Bench(still(bump={"interval_s": 2.0, "speed": speed}), seed=seed) as bench:
            bench.ready()
            return np.array([(bench.step(), height(bench))[1] for _ in range(500)])

    a, b, other, none = swing(1, 0.02), swing(1, 0.02), swing(2, 0.02), swing(1, 0.0)
    assert (a == b).all() and not (a == other).all()
    assert np.ptp(a) > 1e-3 > 1e-6 > np.ptp(none)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_drawn_rigs_are_valid_and_within_their_ranges(seed):
    base, ranges = load_rig_config().arm, load_range()
    overlay = draw_rig(base, ranges, np.random.default_rng(seed))
    assert overlay == draw_rig(base, ranges, np.random.default_rng(seed))
    arm = load_rig_config(overlay).arm
    low, high = ranges.valve.dead_band
    for number, joint in enumerate(arm.joints.rows, start=1):
        assert max(joint.valve.dead_band) <= high
        assert min(joint.valve.dead_band) >= (low if number <= 6 else 0.0)
        ratio = max(joint.speed) / min(joint.speed)
        assert ratio == pytest.approx(1.0) if number in (1, 7, 8) else 1.3 - 1e-9 <= ratio <= 1.6 + 1e-9
        assert max(joint.valve.dead_band) < joint.stiction.hold < joint.stiction.breakaway or number <= 6
    assert ranges.oil.start_c[0] <= arm.oil.start_c <= ranges.oil.start_c[1]


def test_range_upside_down_is_refused():
    tree = read_yaml(RANGE_FILE)
    tree["valve"]["dead_band"] = [0.08, 0.03]
    with pytest.raises(ConfigError):
        convert(tree, RigRange, "range.yaml")
