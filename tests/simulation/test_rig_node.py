"""The rig's CAN nodes: watchdog, emergency stop, counters, pan head, planted faults."""

import math

import pytest
from rig_bench import CODEC, Bench, middle, only

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.errors import ConfigError
from ascrcp.core.machine_io import Command
from ascrcp.simulation.parameter import BusConfig
from ascrcp.simulation.rig import Fault, load_rig_config
from ascrcp.simulation.wire import CommandReceiver, Sender

SLEW = only(0, 0.5)
SENSORS = [f"JointPosition{i}" for i in range(1, 9)]


def test_power_up_is_neutral_until_enable_goes_off_and_on():
    with Bench() as bench:
        for _ in range(10):
            inputs = bench.step(SLEW)  # enable is set from the first frame on: not good enough
            assert bench.rig.drive == (0.0,) * 8
        assert not inputs.controller_enabled
        bench.ready()
        inputs = bench.run(SLEW, 3)
        assert inputs.controller_enabled and not inputs.controller_tripped
        assert bench.rig.drive == pytest.approx(SLEW)


def test_f27_silence_makes_the_controller_neutral_within_100_ms():
    for offset in range(15):  # at every phase of the alive counter
        with Bench() as bench:
            bench.ready().run(SLEW, 3 + offset)
            last_ns = bench.now_ns  # the last command left at this instant
            while any(bench.rig.drive) or bench.now_ns == last_ns:
                inputs = bench.step(silent=True)
                assert bench.now_ns - last_ns <= 100_000_000
            assert inputs.controller_tripped and not inputs.controller_enabled
            # the same commands again do not wake it: enable must go off first
            assert not any(bench.run(SLEW, 5) and bench.rig.drive)
            bench.ready().run(SLEW, 2)
            assert bench.rig.drive == pytest.approx(SLEW)


def test_f27_a_hung_platform_that_repeats_itself_is_silence():
    with Bench() as bench:
        bench.ready().run(SLEW, 5)
        frames = list(bench.link.sent)
        start_ns = bench.now_ns
        while any(bench.rig.drive):
            for can_id, data in frames:
                bench.near.send(can_id, data)
            bench.step(silent=True)
            assert bench.now_ns - start_ns <= 100_000_000


@pytest.mark.parametrize("which", [0, 1])
def test_one_lost_valve_frame_of_two_is_enough_to_trip(which):
    with Bench() as bench:
        bench.ready().run(SLEW, 5)
        for _ in range(6):
            bench.step(silent=True)
            bench.link.send(Command(SLEW, True))
            keep = [frame for i, frame in enumerate(bench.link.sent) if i != which]
            bench.far.drain()  # take all four off the wire, put three back
            for can_id, data in keep:
                bench.near.send(can_id, data)
        assert not any(bench.rig.drive)


def test_corrupt_commands_are_not_obeyed():
    with Bench() as bench:
        bench.ready()
        for _ in range(3):
            bench.step(silent=True)
            bench.link.send(Command(SLEW, True))
            for can_id, data in bench.far.drain():
                bench.near.send(can_id, bytes((data[0] ^ 1, *data[1:])))
        bench.step(silent=True)
        assert not any(bench.rig.drive)


@pytest.mark.parametrize("steps", [range(1, 4), range(4, 15)], ids=["accepted", "refused"])
def test_the_controller_judges_counters_by_itself(steps):
    layout = CODEC.layout("ValveCommand1")
    for step in steps:
        sender, receiver = Sender(layout), CommandReceiver(layout, 3, 5)
        receiver.accept(sender.encode((1.0, 1.0, 2.0, 3.0, 4.0)), 0)
        for _ in range(step):
            data = sender.encode((1.0, 5.0, 6.0, 7.0, 8.0))
        assert receiver.accept(data, 1) is (step <= 3)
        assert receiver.errors == (step > 3)


def test_f20_emergency_stop_acts_in_the_same_cycle_and_is_reported():
    with Bench(middle()) as bench:
        bench.ready().run(SLEW, 10)
        bench.rig.press_estop()
        inputs = bench.step(SLEW)
        assert not any(bench.rig.drive)
        assert inputs.estop and not inputs.controller_enabled
        bench.run(SLEW, 25)  # the spool has closed
        q = bench.q()
        bench.run(SLEW, 25)
        assert (bench.q() == q).all()


def test_f21_releasing_the_emergency_stop_moves_nothing():
    with Bench(middle()) as bench:
        bench.ready().run(SLEW, 10)
        bench.rig.press_estop()
        bench.run(SLEW, 30)
        bench.rig.release_estop()
        for _ in range(20):
            inputs = bench.step(SLEW)
            assert not any(bench.rig.drive)
        assert not inputs.estop and not inputs.controller_enabled
        bench.ready().run(SLEW, 3)
        assert any(bench.rig.drive)


def test_enable_taken_away_closes_the_valves_at_once():
    with Bench() as bench:
        bench.ready().run(SLEW, 5)
        bench.step(SLEW, enable=False)
        inputs = bench.step(SLEW, enable=False)
        assert not any(bench.rig.drive) and not inputs.controller_enabled


def test_concrete_flows_when_told_and_stops_with_the_platform():
    with Bench() as bench:
        bench.ready()
        for _ in range(200):
            inputs = bench.step(pump=0.8, air=True)
        assert inputs.pump_flow == pytest.approx(0.8, abs=0.01)
        for _ in range(200):
            inputs = bench.step(silent=True)
        assert inputs.pump_flow == pytest.approx(0.0, abs=0.01)


def test_the_pan_head_goes_where_told_no_faster_than_it_can():
    with Bench() as bench:
        bench.ready()
        last, fastest = bench.rig.pan, 0.0
        for _ in range(150):
            inputs = bench.step(pan_target=math.radians(60.0))
            fastest, last = max(fastest, abs(bench.rig.pan - last) / 0.02), bench.rig.pan
        assert math.degrees(fastest) == pytest.approx(40.0, abs=1e-6)
        assert math.degrees(inputs.pan) == pytest.approx(60.0, abs=0.011)
        # the encoder does not know its zero error
        assert math.degrees(bench.rig.pan) == pytest.approx(60.05, abs=0.011)
        for _ in range(10):
            bench.step(pan_target=None)
        assert bench.rig.pan == pytest.approx(last, abs=1e-4)


@pytest.mark.parametrize("joint", range(8))
@pytest.mark.parametrize("kind", ["drop", "repeat", "corrupt", "freeze", "shift", "range"])
def test_planted_sensor_faults_show_as_what_they_are(joint, kind):
    with Bench() as bench:
        before = bench.ready().step()
        bench.rig.inject(Fault(kind, SENSORS[joint], value=50.0))
        for cycle in range(1, 5):
            inputs = bench.step()
            stale = kind in ("drop", "repeat", "corrupt")
            assert inputs.age_ns[joint] == (cycle * CYCLE_NS if stale else 0)
            assert inputs.in_range[joint] is (kind != "range")
            assert inputs.bad_frames == (cycle if kind == "corrupt" else 0)
        moved = abs(inputs.q[joint] - before.q[joint])
        assert (moved > 0.01) is (kind == "shift")
        assert all(age == 0 for i, age in enumerate(inputs.age_ns) if i != joint)
        bench.rig.clear_faults()
        bench.step()  # four frames were missed, so the first one's counter step is still refused (F4)
        assert bench.step().age_ns[joint] == 0


@pytest.mark.parametrize("frame", ["ControllerStatus", "MachineStatus", "PanPosition"])
def test_f25_other_frames_can_be_lost_too(frame):
    with Bench() as bench:
        bench.ready()
        bench.rig.inject(Fault("drop", frame))
        inputs = bench.run((0.0,) * 8, 3)
        age = {
            "ControllerStatus": inputs.controller_age_ns,
            "MachineStatus": inputs.estop_age_ns,
            "PanPosition": inputs.pan_age_ns,
        }
        assert age.pop(frame) == 3 * CYCLE_NS and set(age.values()) == {0}


def test_a_fault_on_no_frame_is_refused():
    with Bench() as bench, pytest.raises(ConfigError, match="no frame JointPosition9"):
        bench.rig.inject(Fault("drop", "JointPosition9"))


def test_a_lossy_bus_loses_and_corrupts_about_as_told():
    with Bench({"bus": {"loss_probability": 0.05, "corrupt_probability": 0.02}}, seed=3) as bench:
        bench.ready()
        for _ in range(500):
            bench.step()
        crc = bench.link.counters["crc"]
        assert 0.01 < crc / (500 * 11) < 0.03
        lost = sum(box.receiver.lost for box in bench.link._boxes.values())
        assert 0.03 < lost / (500 * 11) < 0.12


@pytest.mark.parametrize(
    "overlay",
    [
        {"bus": {"watchdog_s": 5.0}},
        {"bus": {"watchdog_ms": 80}},
        {"arm": {"joints": {"j1": {"valve": {"dead_band": [0.6, 0.1]}}}}},
        {"arm": {"joints": {"j1": {"start": 500.0}}}},
        {"arm": {"joints": {"j9": {}}}},
        {"arm": {"flexure": {"vertical": {"damping": math.nan}}}},
        {"tunnel": {}},
    ],
)
def test_f39_impossible_parameters_are_refused(overlay):
    with pytest.raises(ConfigError):
        load_rig_config(overlay)


def test_the_watchdog_leaves_room_for_the_step():
    config: BusConfig = load_rig_config().bus
    assert config.watchdog_s + CYCLE_NS / 1e9 <= 0.1
