"""End-to-end protection of CAN frames: AUTOSAR E2E profile 1, variant A (faults F2, F3, F4).

Byte 0 carries a CRC-8 over the data id and the bytes behind it, the low nibble of byte 1 an alive
counter 0..14. The profile uses the SAE J1850 polynomial with start and final value 0
(AUTOSAR PRS_E2EProtocol, profile 1).
"""

from dataclasses import dataclass, field
from enum import IntEnum

POLYNOMIAL = 0x1D  # SAE J1850
COUNTERS = 15  # the alive counter runs 0..14; 15 is not a valid value


def _row(value: int) -> int:
    for _ in range(8):
        value = (value << 1) ^ POLYNOMIAL if value & 0x80 else value << 1
    return value & 0xFF


_TABLE = tuple(_row(value) for value in range(256))


def compute_crc(data: bytes | bytearray, start: int = 0) -> int:
    """Compute the CRC-8 (polynomial 0x1D, no reflection, no final inversion) of some bytes."""
    table = _TABLE
    for byte in data:
        start = table[start ^ byte]
    return start


def compute_seed(data_id: int) -> int:
    """Compute the CRC of a frame's 16-bit data id, low byte first: where its frame CRC starts."""
    return compute_crc(bytes((data_id & 0xFF, data_id >> 8)))


def protect(frame: bytearray, seed: int, counter: int) -> None:
    """Write counter and CRC into an encoded frame, in place.

    Args:
        frame: The frame, its bytes 0 and low nibble of byte 1 still free.
        seed: From compute_seed.
        counter: Alive counter 0..14.
    """
    frame[1] = (frame[1] & 0xF0) | counter
    frame[0] = compute_crc(frame[1:], seed)


class Check(IntEnum):
    """What a receiver makes of one frame."""

    NEW = 0
    REPEATED = 1
    BAD_CRC = 2
    BAD_COUNTER = 3


@dataclass(slots=True)
class Receiver:
    """Judges the frames of one id and keeps its error counter.

    Attributes:
        seed: From compute_seed.
        max_delta: Largest counter step still accepted (frames lost in between are counted).
        limit: Ceiling of the error counter.
        errors: +1 for a bad CRC or counter, -1 for a good frame, within 0..limit.
        repeats: Consecutive frames with an unchanged counter.
        lost: Frames lost so far, judged by the counter.
    """

    seed: int
    max_delta: int
    limit: int
    errors: int = 0
    repeats: int = 0
    lost: int = 0
    _last: int = field(default=-1, repr=False)

    def check(self, data: bytes) -> Check:
        """Judge one frame of the right length: new and trustworthy, or why not."""
        if data[0] != compute_crc(data[1:], self.seed):
            return self.reject(Check.BAD_CRC)
        counter = data[1] & 0x0F
        if counter >= COUNTERS:
            return self.reject(Check.BAD_COUNTER)
        delta = 1 if self._last < 0 else (counter - self._last) % COUNTERS
        if delta == 0:
            self.repeats += 1
            return Check.REPEATED
        # a wrong step is judged once: the next frame is compared with this one
        self._last = counter
        self.repeats = 0
        if delta > self.max_delta:
            return self.reject(Check.BAD_COUNTER)
        self.lost += delta - 1
        if self.errors > 0:
            self.errors -= 1
        return Check.NEW

    def reject(self, verdict: Check) -> Check:
        """Count a bad frame and return the verdict."""
        if self.errors < self.limit:
            self.errors += 1
        return verdict
