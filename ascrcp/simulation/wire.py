"""The rig's own end-to-end protection: written apart from the platform's, so that both are tested.

Bit by bit instead of by table, from the same standard (AUTOSAR E2E profile 1 variant A).
"""

from ascrcp.devices.codec import Layout


def crc8(data_id_and_payload: bytes) -> int:
    """Compute CRC-8 with polynomial x^8 + x^4 + x^3 + x^2 + 1, start 0, no final inversion."""
    register = 0
    for byte in data_id_and_payload:
        for bit in range(7, -1, -1):
            carry = (register >> 7) ^ ((byte >> bit) & 1)
            register = ((register << 1) & 0xFF) ^ (0x1D if carry else 0)
    return register


_STEP = tuple(crc8(bytes((value,))) for value in range(256))


def _checksum(start: int, payload: bytes) -> int:
    register = start
    for byte in payload:
        register = _STEP[register ^ byte]
    return register


class Sender:
    """Encodes one frame of a node with a running counter."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._counter = 14

    def encode(self, values: tuple[float, ...]) -> bytes:
        """Return the next frame with these physical values."""
        self._counter = 0 if self._counter >= 14 else self._counter + 1
        body = self.layout.encode(values)
        body[1] |= self._counter
        body[0] = _checksum(self.layout.seed, bytes(body[1:]))
        return bytes(body)


class CommandReceiver:
    """What a node believes of a command frame: length, CRC, counter, errors in balance.

    Attributes:
        counter: Counter of the newest accepted frame, 15 before the first.
        errors: Bad frames minus good ones, within 0..limit.
        values: Physical values of the newest accepted frame.
        stamp_ns: When it came, None before the first.
    """

    def __init__(self, layout: Layout, max_delta: int, limit: int) -> None:
        self._layout = layout
        self._max_delta = max_delta
        self._limit = limit
        self._seen = 15
        self.counter = 15
        self.errors = 0
        self.values: tuple[float, ...] = (0.0,) * len(layout.fields)
        self.stamp_ns: int | None = None

    def accept(self, data: bytes, now_ns: int) -> bool:
        """Take a frame if it is whole, new and its values make sense."""
        if len(data) != self._layout.length or data[0] != _checksum(self._layout.seed, data[1:]):
            return self._refuse()
        counter = data[1] & 0x0F
        if counter > 14:
            return self._refuse()
        if counter == self._seen:
            return False
        step = counter - self._seen if counter > self._seen else counter - self._seen + 15
        first = self._seen == 15
        self._seen = counter
        if not first and step > self._max_delta:
            return self._refuse()
        values = self._layout.decode(data)
        for value, field in zip(values, self._layout.fields, strict=True):
            if not field.minimum <= value <= field.maximum:
                return self._refuse()
        self.counter, self.values, self.stamp_ns = counter, values, now_ns
        self.errors = max(0, self.errors - 1)
        return True

    def is_fresh(self, now_ns: int, limit_ns: int) -> bool:
        """Whether the newest accepted frame is younger than the limit [ns]."""
        return self.stamp_ns is not None and now_ns - self.stamp_ns < limit_ns

    def _refuse(self) -> bool:
        self.errors = min(self._limit, self.errors + 1)
        return False
