"""End-to-end protection: every small corruption is seen, counters are judged as the catalogue says."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.devices.codec import Codec
from ascrcp.devices.e2e import COUNTERS, Check, Receiver, compute_crc, compute_seed, protect
from ascrcp.devices.machine_link import DBC
from ascrcp.simulation import wire

CODEC = Codec(DBC)
LAYOUTS = sorted(CODEC.by_id.values(), key=lambda layout: layout.can_id)


def make_frame(seed: int, payload: bytes, counter: int) -> bytearray:
    frame = bytearray(payload)
    protect(frame, seed, counter)
    return frame


def test_crc_is_the_standard_one():
    # catalogue of CRC algorithms: poly 0x1D, start 0, no final value gives 0x37; SAE J1850 itself 0x4B
    assert compute_crc(b"123456789") == 0x37
    assert compute_crc(b"123456789", 0xFF) ^ 0xFF == 0x4B
    assert wire.crc8(b"123456789") == 0x37


@pytest.mark.parametrize(("counter", "crc"), [(0, 0xCC), (1, 0x91)])
def test_the_standard_s_own_example(counter, crc):
    # AUTOSAR PRS_E2EProtocol: data id 0x0123 in full, eight bytes, all data zero
    assert make_frame(compute_seed(0x123), bytes(8), counter)[:2] == bytes((crc, counter))


@given(st.binary(max_size=12), st.integers(0, 0xFFFF))
def test_both_ends_agree_though_written_apart(data, data_id):
    start = compute_seed(data_id)
    assert compute_crc(data, start) == wire.crc8(bytes((data_id & 0xFF, data_id >> 8)) + data)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
@given(payload=st.binary(min_size=8, max_size=8), counter=st.integers(0, COUNTERS - 1))
def test_every_single_bit_flip_is_detected(layout, payload, counter):
    frame = make_frame(layout.seed, payload[: layout.length], counter)
    assert Receiver(layout.seed, 3, 5).check(bytes(frame)) is Check.NEW
    for bit in range(8 * layout.length):
        broken = bytearray(frame)
        broken[bit // 8] ^= 1 << bit % 8
        assert Receiver(layout.seed, 3, 5).check(bytes(broken)) is Check.BAD_CRC


@given(payload=st.binary(min_size=8, max_size=8), start=st.integers(0, 56), burst=st.integers(1, 255))
def test_every_burst_of_eight_bits_is_detected(payload, start, burst):
    frame = make_frame(0x5A, payload, 3)
    # most significant bit first is the order in which a CRC sees a burst
    word = int.from_bytes(frame, "big") ^ (burst << start)
    assert Receiver(0x5A, 3, 5).check(word.to_bytes(8, "big")) is Check.BAD_CRC


def test_data_ids_tell_frames_apart():
    seeds = [layout.seed for layout in LAYOUTS]
    assert len(set(seeds)) == len(seeds)
    frame = bytes(make_frame(LAYOUTS[0].seed, bytes(8), 1))
    assert all(Receiver(seed, 3, 5).check(frame) is Check.BAD_CRC for seed in seeds[1:])


@pytest.mark.parametrize(
    ("step", "verdict", "lost"),
    [(0, Check.REPEATED, 0), (1, Check.NEW, 0), (2, Check.NEW, 1), (3, Check.NEW, 2)]
    + [(step, Check.BAD_COUNTER, 0) for step in range(4, COUNTERS)],
)
@pytest.mark.parametrize("first", range(COUNTERS))
def test_f4_counter_steps(first, step, verdict, lost):
    receiver = Receiver(0, 3, 5)
    receiver.check(bytes(make_frame(0, bytes(4), first)))
    assert receiver.check(bytes(make_frame(0, bytes(4), (first + step) % COUNTERS))) is verdict
    assert receiver.lost == lost
    assert receiver.errors == (verdict is Check.BAD_COUNTER)


def test_counter_fifteen_is_never_valid():
    receiver = Receiver(0, 3, 5)
    assert receiver.check(bytes(make_frame(0, bytes(4), 15))) is Check.BAD_COUNTER


@given(st.lists(st.booleans(), max_size=60))
def test_f3_error_counter_goes_up_and_down_within_its_limit(goods):
    receiver = Receiver(0, 3, 5)
    expected, counter = 0, 0
    for good in goods:
        counter = (counter + 1) % COUNTERS
        frame = make_frame(0, bytes(4), counter)
        if good:
            expected = max(0, expected - 1)
        else:
            counter = (counter - 1) % COUNTERS
            frame[0] ^= 0x10
            expected = min(5, expected + 1)
        receiver.check(bytes(frame))
        assert receiver.errors == expected
