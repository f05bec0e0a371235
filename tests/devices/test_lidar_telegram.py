"""CoLa-B telegrams: what is encoded is decoded again; what is broken is refused in one line."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.errors import DeviceError
from ascrcp.devices import lidar_telegram as cola

telegrams = st.builds(
    cola.Telegram,
    codes=st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=300).map(lambda x: np.array(x, np.uint16)),
    scale=st.sampled_from([0.1, 1.0, 2.0]).map(lambda x: float(np.float32(x))),
    offset=st.sampled_from([0.0, -100.0]),
    start=st.integers(-1_800_000, 1_800_000),
    step=st.integers(833, 10_000),
    status=st.integers(0, 0xFFFF),
    telegram_counter=st.integers(0, 0xFFFF),
    scan_counter=st.integers(0, 0xFFFF),
    time_us=st.integers(0, 0xFFFFFFFF),
)


def unframe(frame: bytes) -> bytes:
    length = cola.decode_length(frame[:8])
    assert len(frame) == 8 + length + 1
    cola.check_payload(frame[8:-1], frame[-1])
    return frame[8:-1]


@given(telegrams)
def test_decode_inverts_encode(telegram: cola.Telegram) -> None:
    got = cola.decode_scan(unframe(cola.encode_frame(cola.encode_scan(telegram))))
    np.testing.assert_array_equal(got.codes, telegram.codes)
    fields = ("scale", "offset", "start", "step", "status", "telegram_counter", "scan_counter", "time_us")
    assert [getattr(got, f) for f in fields] == [getattr(telegram, f) for f in fields]


@given(telegrams, st.data())
def test_every_truncation_is_refused(telegram: cola.Telegram, data: st.DataObject) -> None:
    payload = cola.encode_scan(telegram)
    last_needed = len(payload) - 12  # the empty trailing fields are not read
    cut = data.draw(st.integers(0, last_needed - 1))
    with pytest.raises(DeviceError):
        cola.decode_scan(payload[:cut])


@given(telegrams, st.data())
def test_one_flipped_bit_is_refused(telegram: cola.Telegram, data: st.DataObject) -> None:
    frame = bytearray(cola.encode_frame(cola.encode_scan(telegram)))
    bit = data.draw(st.integers(64, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    with pytest.raises(DeviceError, match="checksum"):
        unframe(bytes(frame))


@given(st.binary(max_size=400))
def test_arbitrary_bytes_never_raise_anything_else(noise: bytes) -> None:
    for prefix in (b"", cola.ANSWERS[0], cola.ANSWERS[1], cola.IDENT_ANSWER, cola.FAILURE):
        for decode in (cola.decode_scan, cola.decode_ident):
            try:
                decode(prefix + noise)
            except DeviceError as error:
                assert "\n" not in str(error)


@pytest.mark.parametrize(
    "header", [b"\x02\x02\x02\x03\0\0\0\x10", cola.STX + b"\xff\xff\xff\xff", cola.STX + bytes(4)]
)
def test_bad_header_is_refused(header: bytes) -> None:
    with pytest.raises(DeviceError):
        cola.decode_length(header)


def test_codes_below_16_are_no_distances() -> None:
    codes = np.array([0, 1, 15, 16, 5900, 0xFFFF], np.uint16)
    ranges = cola.Telegram(codes=codes, scale=2.0).ranges
    assert np.isnan(ranges[:3]).all()
    np.testing.assert_allclose(ranges[3:], [0.032, 11.8, 131.07], rtol=1e-6)


def test_beam_angles() -> None:
    beam = cola.Telegram(codes=np.zeros(1081, np.uint16)).beam
    np.testing.assert_allclose(np.degrees(beam[[0, 180, 540, 1080]]), [-45.0, 0.0, 90.0, 225.0])


def test_encoders_and_further_channels_are_skipped() -> None:
    """LMS5xx sends encoder fields and an intensity channel when set to; DIST1 is still found."""
    telegram = cola.Telegram(codes=np.array([100, 200], np.uint16))
    payload = cola.encode_scan(telegram)
    head_end = payload.index(b"DIST1") - 2
    channel = payload[head_end + 2 : -12]
    rssi = struct.pack(">5sffiHH", b"RSSI1", 1.0, 0.0, 0, 2500, 3) + bytes(6)
    head = payload[: head_end - 2] + struct.pack(">H", 1) + bytes(6) + struct.pack(">H", 2)
    np.testing.assert_array_equal(cola.decode_scan(head + rssi + channel).codes, telegram.codes)


def test_sopas_failure_names_its_code() -> None:
    with pytest.raises(DeviceError, match="error 8"):
        cola.decode_scan(b"sFA\x00\x08")


def test_ident_round_trip() -> None:
    assert cola.decode_ident(cola.encode_ident("LMS511", "V2.30")) == "LMS511 V2.30"
    assert cola.decode_ident(b"sFA\x00\x02") == "unknown"
