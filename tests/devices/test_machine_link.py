"""The link: mailboxes, ages and error counters, judged frame by frame (faults F1 to F6, F15, F25, F32)."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.errors import ConfigError
from ascrcp.core.machine_io import NEVER_NS, Command, neutral
from ascrcp.devices.bus import Bus, ChannelConfig
from ascrcp.devices.codec import Codec
from ascrcp.devices.e2e import COUNTERS, protect
from ascrcp.devices.machine_link import DBC, MachineLink, load_can_config

CODEC = Codec(DBC)
CONFIG = load_can_config()
CHANNEL = ChannelConfig(interface="virtual", channel="link-test")
REST = {"JointPosition5": (0.0, 375.0), "MachineStatus": (0.0, 40.0, 50.0), "PanPosition": (0.0, 90.0)}
COMMANDS = ("ValveCommand1", "ValveCommand2", "SprayCommand", "PanCommand")


class Far:
    """The machine's side of the wire, frame by frame."""

    def __init__(self) -> None:
        self.bus = Bus(CHANNEL)
        self.near = Bus(CHANNEL)
        self.link = MachineLink(self.near, CODEC, CONFIG)
        self.counter = dict.fromkeys(CODEC.by_name, 0)
        self.now_ns = 0

    def frame(self, name: str, values=None) -> bytes:
        layout = CODEC.layout(name)
        values = values or REST.get(name) or (0.0,) * len(layout.fields)
        self.counter[name] = (self.counter[name] + 1) % COUNTERS
        frame = layout.encode(values)
        protect(frame, layout.seed, self.counter[name])
        return bytes(frame)

    def send(self, name: str, values=None, data: bytes | None = None) -> None:
        self.bus.send(CODEC.layout(name).can_id, self.frame(name, values) if data is None else data)

    def all(self, *, but: str = "") -> None:
        for name in CODEC.by_name:
            if name not in COMMANDS and name != but:
                self.send(name)

    def receive(self, cycles: int = 1):
        self.now_ns += cycles * CYCLE_NS
        return self.link.receive(self.now_ns)

    def close(self) -> None:
        self.bus.close()
        self.near.close()


@pytest.fixture
def far() -> Iterator[Far]:
    far = Far()
    yield far
    far.close()


def test_before_the_first_frame_everything_is_unknown_and_stopped(far):
    inputs = far.receive()
    assert all(math.isnan(q) for q in inputs.q)
    assert set(inputs.age_ns) == {NEVER_NS} and not any(inputs.in_range)
    assert inputs.estop and inputs.estop_age_ns == NEVER_NS
    assert inputs.controller_age_ns == inputs.pan_age_ns == NEVER_NS
    assert not inputs.controller_enabled and math.isnan(inputs.oil_temp_c) and math.isnan(inputs.pan)


def test_a_full_cycle_arrives_in_si(far):
    far.all()
    far.send("JointPosition2", (0.0, 30.0))
    far.send("JointPosition3", (0.0, 1500.0))
    far.send("JointPosition4", (0.0, 20.0))
    far.send("ControllerStatus", (1.0, 0.0, 1.0, 3.0, 0.0))
    inputs = far.receive()
    assert math.degrees(inputs.q[1]) == pytest.approx(30.0)
    assert inputs.q[2] == pytest.approx(1.5)
    assert math.degrees(inputs.q[3]) == pytest.approx(-10.0)
    assert all(inputs.in_range) and set(inputs.age_ns) == {0}
    assert not inputs.estop and inputs.controller_enabled and not inputs.controller_tripped
    assert inputs.pump_flow == 0.5 and inputs.oil_temp_c == 40.0
    assert inputs.pan == pytest.approx(math.pi / 2) and inputs.bad_frames == 0
    assert len(far.link.received) == 15


def test_f1_a_silent_sensor_grows_old_and_the_others_do_not(far):
    far.all()
    far.receive()
    for cycle in range(1, 5):
        far.all(but="JointPosition3")
        inputs = far.receive()
        assert inputs.age_ns[2] == cycle * CYCLE_NS
        assert [age for i, age in enumerate(inputs.age_ns) if i != 2] == [0] * 7


def test_f2_a_repeated_frame_is_not_new(far):
    far.all()
    far.receive()
    old = far.frame("JointPosition1", (0.0, 10.0))
    far.send("JointPosition1", data=old)
    assert far.receive().age_ns[0] == 0
    for cycle in range(1, 5):
        far.send("JointPosition1", data=old)
        inputs = far.receive()
        assert inputs.age_ns[0] == cycle * CYCLE_NS and inputs.bad_frames == 0
    assert far.link.counters["repeated"] == 4


def test_f3_a_corrupt_frame_changes_nothing_and_counts(far):
    far.all()
    q = far.receive().q
    for bad in range(1, 8):
        data = bytearray(far.frame("JointPosition1", (0.0, 10.0)))
        data[2] ^= 0x40
        far.send("JointPosition1", data=bytes(data))
        inputs = far.receive()
        assert inputs.q == q and inputs.bad_frames == min(bad, 5)
        assert inputs.age_ns[0] == bad * CYCLE_NS
    assert far.link.counters["crc"] == 7


def test_f5_wrong_length_counts_as_bad_and_unknown_identifiers_do_not(far):
    far.all()
    far.receive()
    far.send("JointPosition1", data=far.frame("JointPosition1")[:3])
    far.bus.send(0x7FF, bytes(8))
    inputs = far.receive()
    assert inputs.bad_frames == 1 and inputs.age_ns[0] == CYCLE_NS
    assert far.link.counters["length"] == 1 and far.link.counters["unknown"] == 1


@pytest.mark.parametrize("values", [(0.0, 360.0), (0.0, -360.0), (2.0, 10.0), (15.0, 0.0)])
def test_f6_an_impossible_reading_is_reported_and_never_becomes_an_angle(far, values):
    far.all()
    far.receive()
    far.send("JointPosition1", values)
    inputs = far.receive()
    assert not inputs.in_range[0] and all(inputs.in_range[1:])
    assert inputs.q[0] == 0.0 and inputs.age_ns[0] == 0


@pytest.mark.parametrize(("code", "stopped"), [(0.0, False), (1.0, True), (2.0, True), (3.0, True)])
def test_f20_only_released_is_released(far, code, stopped):
    far.send("MachineStatus", (code, 40.0, 0.0))
    assert far.receive().estop is stopped


def test_f25_the_heartbeat_has_an_age(far):
    far.all()
    far.receive()
    assert far.receive(cycles=4).controller_age_ns == 4 * CYCLE_NS


def test_f32_somebody_else_sending_our_commands_is_counted(far):
    far.send("ValveCommand1")
    far.receive()
    assert far.link.counters["foreign"] == 1


def test_g6_every_identifier_at_every_length_is_harmless(far):
    far.all()
    before = far.receive()
    for can_id in range(0x800):
        for length in range(9):
            far.bus.send(can_id, bytes(length))
        if can_id % 50 == 49:
            far.receive()
    after = far.receive()
    assert after.q == before.q and after.in_range == before.in_range and not after.estop
    assert min(after.age_ns) > 0 and after.bad_frames == 5


@given(st.lists(st.tuples(st.sampled_from(sorted(CODEC.by_id)), st.binary(max_size=8)), max_size=80))
def test_g5_random_frames_never_raise(frames):
    far = Far()
    try:
        for can_id, data in frames:
            far.bus.send(can_id, data)
        inputs = far.receive()
        assert 0 <= inputs.bad_frames <= 5
    finally:
        far.close()


def sent_by(far: Far) -> dict[str, tuple[float, ...]]:
    return {CODEC.by_id[i].name: CODEC.by_id[i].decode(data) for i, data in far.bus.drain()}


drives = st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8)


@given(drives, st.booleans(), st.floats(0, 1), st.floats(0, 1), st.booleans(), st.none() | st.floats(-3, 3))
def test_a_command_arrives_as_it_was_meant(drive, enable, pump, accelerator, air, pan):
    far = Far()
    try:
        command = Command(tuple(drive), enable, pump, accelerator, air, pan)
        assert far.link.send(command)
        assert len(far.link.sent) == 4
        got = sent_by(far)
    finally:
        far.close()
    both = got["ValveCommand1"][1:] + got["ValveCommand2"][1:]
    assert both == pytest.approx([100.0 * u for u in drive], abs=0.0501)
    assert got["ValveCommand1"][0] == got["ValveCommand2"][0] == enable
    assert got["SprayCommand"] == pytest.approx((float(air), 100 * pump, 100 * accelerator), abs=0.0501)
    assert got["PanCommand"][0] == (pan is not None)
    if pan is not None:
        assert got["PanCommand"][1] == pytest.approx(math.degrees(pan), abs=0.00501)


GOOD = Command((0.5,) * 8, True, 0.5, 0.5, True, 0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.0001, -1.0001])
@pytest.mark.parametrize("field", ["drive", "pump", "accelerator", "pan_target"])
def test_f15_a_command_that_is_not_finite_or_too_large_goes_out_neutral(far, field, bad):
    value = (0.1,) * 7 + (bad,) if field == "drive" else bad * 4 if field == "pan_target" else bad
    assert not far.link.send(replace(GOOD, **{field: value}))
    assert far.link.counters["refused"] == 1
    got = sent_by(far)
    assert set(got) == set(COMMANDS)
    assert all(value == 0.0 for values in got.values() for value in values)


def test_a_command_for_another_arm_goes_out_neutral(far):
    assert not far.link.send(neutral(7))
    assert all(value == 0.0 for values in sent_by(far).values() for value in values)


def test_counters_run_and_the_echo_is_there(far):
    seen = []
    for _ in range(20):
        far.link.send(neutral(8))
        seen.append({data[1] & 0x0F for _, data in far.bus.drain()})
    assert seen == [{i % COUNTERS} for i in range(20)]
    assert far.link.command_echo == (19 % COUNTERS, -1)
    far.send("ControllerStatus", (1.0, 0.0, 1.0, 4.0, 0.0))
    far.receive()
    assert far.link.command_echo == (4, 4)


def test_f33_a_lost_bus_shows_in_the_inputs(far):
    far.all()
    far.receive()
    far.near._bus.shutdown()
    assert not far.receive().bus_ok
    assert not far.link.send(GOOD) and far.link.sent == []


def test_sensors_dbc_and_arm_must_fit_together():
    bus = Bus(CHANNEL)
    try:
        with pytest.raises(ConfigError, match="8 sensors for an arm of 6"):
            MachineLink(bus, CODEC, CONFIG, joints=6)
        overlay = {"sensors": [*({"kind": "encoder", "unit": "deg", "minimum": 0.0, "maximum": 9.0},) * 8]}
        with pytest.raises(ConfigError, match="JointPosition3 is in mm"):
            MachineLink(bus, CODEC, load_can_config(overlay=overlay))
    finally:
        bus.close()
