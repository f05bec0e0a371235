"""The bus: what is no classic data frame is dropped and counted, failures become a flag."""

from collections.abc import Iterator

import can
import pytest

from ascrcp.core.config import convert
from ascrcp.core.errors import ConfigError, DeviceError
from ascrcp.devices.bus import Bus, ChannelConfig

CONFIG = ChannelConfig(interface="virtual", channel="bus-test", drain_cap=50)


@pytest.fixture
def pair() -> Iterator[tuple[Bus, can.BusABC]]:
    bus = Bus(CONFIG)
    with can.Bus(interface="virtual", channel="bus-test") as far:
        yield bus, far
    bus.close()


def test_frames_come_in_order_and_own_frames_do_not_echo(pair):
    bus, far = pair
    for i in range(5):
        far.send(can.Message(arbitration_id=0x100 + i, data=bytes((i,)), is_extended_id=False))
    assert bus.send(0x200, b"\x01\x02")
    assert bus.drain() == [(0x100 + i, bytes((i,))) for i in range(5)]
    assert bus.drain() == []
    message = far.recv(0)
    assert message is not None and message.arbitration_id == 0x200 and not message.is_extended_id


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"is_extended_id": True}, "extended"),
        ({"is_extended_id": False, "is_remote_frame": True}, "remote"),
        ({"is_extended_id": False, "is_fd": True}, "fd"),
        ({"is_extended_id": False, "is_error_frame": True}, "error"),
    ],
)
def test_f5_other_kinds_of_frames_are_dropped_and_counted(pair, options, reason):
    bus, far = pair
    far.send(can.Message(arbitration_id=0x100, **options))
    assert bus.drain() == []
    assert bus.dropped[reason] == 1 and sum(bus.dropped.values()) == 1
    assert bus.ok


def test_f30_bus_off_is_a_flag_and_stays(pair):
    bus, far = pair
    far.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
    bus.drain()
    assert not bus.ok and "bus-off" in bus.error
    assert not bus.send(0x100, b"")
    assert far.recv(0) is None
    bus.reopen()
    assert bus.ok and bus.send(0x100, b"")


def test_f31_a_flood_is_drained_up_to_the_cap(pair):
    bus, far = pair
    for _ in range(120):
        far.send(can.Message(arbitration_id=0x100, is_extended_id=False))
    assert [len(bus.drain()) for _ in range(3)] == [50, 50, 20]
    assert bus.cap_hits == 0
    for _ in range(100):
        far.send(can.Message(arbitration_id=0x100, is_extended_id=False))
    bus.drain()
    assert bus.cap_hits == 1


@pytest.mark.parametrize("action", [lambda bus: bus.drain(), lambda bus: bus.send(0x100, b"")])
def test_f33_an_unplugged_adapter_is_a_flag_not_an_exception(pair, action):
    bus, _ = pair
    bus._bus.shutdown()  # what python-can sees when the adapter is gone
    action(bus)
    assert not bus.ok and bus.error
    bus.reopen()
    assert bus.ok and not bus.error


def test_a_bus_that_is_not_there_is_refused_with_its_name():
    with pytest.raises(DeviceError, match="socketcan:nosuchcan"):
        Bus(ChannelConfig(interface="socketcan", channel="nosuchcan"))


@pytest.mark.parametrize(
    "tree",
    [
        {"interface": "udp_multicast", "channel": "239.0.0.1"},
        {"interface": "virtual", "channel": ""},
        {"interface": "virtual", "channel": "x", "drain_cap": 0},
    ],
)
def test_network_buses_and_empty_names_are_refused(tree):
    with pytest.raises(ConfigError):
        convert(tree, ChannelConfig, "can.yaml")
