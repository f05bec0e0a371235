"""SICK CoLa-B telegrams: frame bytes <-> payload, LMDscandata payload <-> Telegram.

Layout after SICK's telegram listing 8014631 (LMS1xx, LMS5xx, TiM): four STX, payload length as
32-bit big-endian, payload, XOR of the payload's bytes. All numbers inside are big-endian.
"""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import DeviceError
from ascrcp.core.geometry import Array

STX = b"\x02\x02\x02\x02"
HEADER_BYTES = 8
MAX_PAYLOAD = 65_536  # five echoes of 1141 beams with intensity are 23 kB; more is a broken length
MAX_BEAMS = 4_096  # LMS1xx 1081, LMS5xx 1141
FIRST_VALID_CODE = 16  # distances below are status codes: 0 no echo, 1 dazzled, 2..15 reserved

COMMAND = b"LMDscandata"
READ = b"sRN " + COMMAND
ANSWERS = (b"sRA " + COMMAND + b" ", b"sSN " + COMMAND + b" ")
IDENT_READ = b"sRN DeviceIdent"
IDENT_ANSWER = b"sRA DeviceIdent "
FAILURE = b"sFA"

# version, device number, serial; status 2 x 8 bit; telegram and scan counter; microseconds since
# start-up and at transmission; digital inputs and outputs (2 x 8 bit each); layer angle; scan
# frequency [1/100 Hz]; measurement frequency [100 Hz]; number of encoders
_HEAD = struct.Struct(">HHI2BHHII2B2BHIIH")
_ENCODER_BYTES = 6
_COUNT = struct.Struct(">H")
# content, scale factor, offset, start angle [1/10000 deg], step [1/10000 deg], number of values
_CHANNEL = struct.Struct(">5sffiHH")
_ANGLE_UNIT = np.radians(1e-4)


@dataclass(frozen=True)
class Telegram:
    """One LMDscandata answer.

    Attributes:
        codes: DIST1 values as sent, big-endian 16 bit, shape (beams,).
        scale: Millimetres per count (1 on LMS1xx, 1 or 2 on LMS5xx).
        offset: Added after scaling [mm].
        start: Angle of the first beam [1/10000 deg].
        step: Angle between beams [1/10000 deg].
        status: Device status, two bytes as one number; 0 is healthy.
        telegram_counter: Measurement telegrams handed to the interface, 16 bit.
        scan_counter: Scans made by the device, 16 bit.
        time_us: Device time at the zero index [us since its start].
    """

    codes: NDArray[np.uint16]
    scale: float = 1.0
    offset: float = 0.0
    start: int = -450_000
    step: int = 2_500
    status: int = 0
    telegram_counter: int = 0
    scan_counter: int = 0
    time_us: int = 0

    @property
    def ranges(self) -> NDArray[np.float32]:
        """Distances [m], NaN where the code is no distance, shape (beams,)."""
        metres = (
            self.codes.astype(np.float32) * np.float32(self.scale) + np.float32(self.offset)
        ) * np.float32(1e-3)
        metres[self.codes < FIRST_VALID_CODE] = np.nan
        return metres

    @property
    def beam(self) -> Array:
        """Beam angles [rad], shape (beams,)."""
        return (self.start + self.step * np.arange(len(self.codes))) * _ANGLE_UNIT


def checksum(payload: bytes) -> int:
    """Compute the XOR of all bytes."""
    return int(np.bitwise_xor.reduce(np.frombuffer(payload, np.uint8))) if payload else 0


def encode_frame(payload: bytes) -> bytes:
    """Wrap a payload for the wire."""
    return STX + struct.pack(">I", len(payload)) + payload + bytes([checksum(payload)])


def decode_length(header: bytes) -> int:
    """Read the payload length out of a frame's first eight bytes.

    Raises:
        DeviceError: No STX, or a length no telegram has.
    """
    if header[:4] != STX:
        raise DeviceError(f"lidar telegram starts with {header[:4].hex(' ')}, expected {STX.hex(' ')}")
    length = int.from_bytes(header[4:8], "big")
    if not 3 <= length <= MAX_PAYLOAD:
        raise DeviceError(f"lidar telegram announces {length} bytes, allowed 3..{MAX_PAYLOAD}")
    return length


def check_payload(payload: bytes, received: int) -> None:
    """Compare a payload with the checksum byte that came behind it.

    Raises:
        DeviceError: They differ.
    """
    wanted = checksum(payload)
    if wanted != received:
        raise DeviceError(
            f"lidar telegram of {len(payload)} bytes has checksum 0x{received:02x}, computed 0x{wanted:02x}"
        )


def encode_scan(telegram: Telegram, serial: int = 0, scan_hz: float = 25.0) -> bytes:
    """Build the payload of the answer to `sRN LMDscandata` (one 16-bit channel, no 8-bit ones).

    Args:
        telegram: What to say.
        serial: Serial number of the device.
        scan_hz: Rotations per second [Hz].
    """
    beams = len(telegram.codes)
    head = _HEAD.pack(
        1, 1, serial, telegram.status >> 8 & 0xFF, telegram.status & 0xFF,
        telegram.telegram_counter & 0xFFFF, telegram.scan_counter & 0xFFFF,
        telegram.time_us & 0xFFFFFFFF, telegram.time_us & 0xFFFFFFFF,
        0, 0, 0, 0, 0, round(scan_hz * 100), round(scan_hz * 36e3 / telegram.step), 0,
    )  # fmt: skip
    channel = _CHANNEL.pack(b"DIST1", telegram.scale, telegram.offset, telegram.start, telegram.step, beams)
    # after the 16-bit channels: no 8-bit channel, no position, name, comment, time, event
    tail = struct.pack(">6H", 0, 0, 0, 0, 0, 0)
    return b"".join((ANSWERS[0], head, _COUNT.pack(1), channel, telegram.codes.astype(">u2").tobytes(), tail))


def decode_scan(payload: bytes) -> Telegram:
    """Read an LMDscandata payload: the first DIST1 channel and the counters.

    Raises:
        DeviceError: Another telegram, one that is shorter than it says, or values no scanner has.
    """
    if payload.startswith(FAILURE):
        code = int.from_bytes(payload[3:5], "big")
        raise DeviceError(f"lidar refuses LMDscandata with SOPAS error {code}")
    answer = next((a for a in ANSWERS if payload.startswith(a)), None)
    if answer is None:
        raise DeviceError(f"lidar answers {payload[:24]!r}, expected LMDscandata")
    try:
        head = _HEAD.unpack_from(payload, len(answer))
        at = len(answer) + _HEAD.size + head[-1] * _ENCODER_BYTES
        channels = _COUNT.unpack_from(payload, at)[0]
        at += _COUNT.size
        for _ in range(channels):
            name, scale, offset, start, step, beams = _CHANNEL.unpack_from(payload, at)
            at += _CHANNEL.size
            if name == b"DIST1":
                return _telegram(payload, at, head, (scale, offset, start, step, beams))
            at += 2 * beams
    except struct.error:
        raise DeviceError(f"lidar telegram of {len(payload)} bytes ends before its fields do") from None
    raise DeviceError(f"lidar telegram has {channels} 16-bit channels, none of them DIST1")


def _telegram(
    payload: bytes, at: int, head: tuple[int, ...], channel: tuple[float, float, int, int, int]
) -> Telegram:
    scale, offset, start, step, beams = channel
    if not 1 <= beams <= MAX_BEAMS:
        raise DeviceError(f"lidar telegram has {beams} beams, allowed 1..{MAX_BEAMS}")
    if at + 2 * beams > len(payload):
        raise DeviceError(f"lidar telegram of {len(payload)} bytes ends before its {beams} distances do")
    if not 0.0 < scale <= 100.0 or not abs(offset) <= 1e5:
        raise DeviceError(
            f"lidar distance scale {scale:g} and offset {offset:g} mm, allowed 0..100 and +-1e5"
        )
    if not 1 <= step <= 100_000 or not abs(start) <= 3_600_000 or not step * (beams - 1) <= 3_600_000:
        raise DeviceError(
            f"lidar beams start at {start / 1e4:g} deg and step {step / 1e4:g} deg: more than one turn"
        )
    codes = np.frombuffer(payload, ">u2", beams, at).astype(np.uint16)
    return Telegram(
        codes=codes, scale=scale, offset=offset, start=start, step=step,
        status=head[3] << 8 | head[4], telegram_counter=head[5], scan_counter=head[6], time_us=head[7],
    )  # fmt: skip


def encode_ident(name: str, version: str) -> bytes:
    """Build the answer to `sRN DeviceIdent`: two strings, each behind its 16-bit length."""
    parts = (text.encode("ascii") for text in (name, version))
    return IDENT_ANSWER + b"".join(_COUNT.pack(len(p)) + p for p in parts)


def decode_ident(payload: bytes) -> str:
    """Read the device's name and version; "unknown" where the device refuses to tell.

    Raises:
        DeviceError: Another telegram, or strings longer than it.
    """
    if payload.startswith(FAILURE):
        return "unknown"
    if not payload.startswith(IDENT_ANSWER):
        raise DeviceError(f"lidar answers {payload[:24]!r}, expected DeviceIdent")
    at, texts = len(IDENT_ANSWER), []
    for _ in range(2):
        length = int.from_bytes(payload[at : at + 2], "big")
        text = payload[at + 2 : at + 2 + length]
        if len(payload) < at + 2 or len(text) != length:
            raise DeviceError(f"lidar DeviceIdent of {len(payload)} bytes ends before its text does")
        texts.append(text.decode("ascii", "replace").strip())
        at += 2 + length
    return " ".join(texts)
