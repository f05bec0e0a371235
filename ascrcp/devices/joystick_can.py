"""A joystick on CAN: J1939 BJM1 frames (basic joystick message 1, PGN 64982) -> StickState.

Bytes 1-2: X axis; 3-4: Y axis. In each: neutral status (2 bits), negative side status (2), positive
side status (2), then the position in 10 bits: 0..1000 of full travel, 1022 error, 1023 absent. Bytes 6-8:
twelve buttons of two bits. Statuses: 0 no, 1 yes, 2 error, 3 absent (SAE J1939-71).
"""

import can

from ascrcp.core.clock import NS
from ascrcp.core.errors import DeviceError
from ascrcp.devices.joystick import LOST, CanStickConfig, StickState

PGN_BJM1 = 0xFDD6
FULL = 1000
NEUTRAL_BAND = 100  # of FULL: a stick that says neutral may not say it is farther out than this
_MS = 1_000_000
_DRAIN = 50  # frames taken in one cycle at most


def decode_axis(low: int, high: int) -> float:
    """Decode one axis, -1..1.

    Args:
        low: Byte with the three statuses and the lowest bits of the position.
        high: The position's upper eight bits.

    Raises:
        DeviceError: The stick reports an error, or its statuses contradict its position (fault F24).
    """
    neutral, negative, positive = low & 3, low >> 2 & 3, low >> 4 & 3
    position = high << 2 | low >> 6
    if 2 in (neutral, negative, positive) or 3 in (neutral, negative, positive):
        raise DeviceError("the joystick reports an axis status in error or absent")
    if not position <= FULL:
        what = "an error" if position == 1022 else "no value" if position == 1023 else f"{position} of 1000"
        raise DeviceError(f"the joystick reports {what} for an axis")
    if negative and positive:
        raise DeviceError("the joystick reports both sides of an axis at once")
    if neutral and position > NEUTRAL_BAND:
        raise DeviceError("the joystick reports neutral and a deflection at once")
    if not neutral and not negative and not positive and position > 0:
        raise DeviceError("the joystick reports a deflection without a side")
    return (-1.0 if negative else 1.0 if positive else 0.0) * position / FULL


def encode_axis(value: float) -> tuple[int, int]:
    """Encode one axis for a virtual stick; the inverse of `decode_axis`."""
    position = round(min(abs(value), 1.0) * FULL)
    neutral, negative, positive = position == 0, value < 0 < position, value > 0 and position > 0
    return neutral | negative << 2 | positive << 4 | (position & 3) << 6, position >> 2


def decode_button(data: bytes, number: int) -> bool:
    """Decode one of the twelve buttons.

    Raises:
        DeviceError: The button reports an error or is absent.
    """
    value = data[5 + (number - 1) // 4] >> (6 - 2 * ((number - 1) % 4)) & 3
    if value > 1:
        raise DeviceError(f"the joystick's button {number} is in error or absent")
    return value == 1


def encode_frame(along: float, across: float, buttons: frozenset[int] = frozenset()) -> bytes:
    """Encode the data of one BJM1 frame for a virtual stick."""
    data = bytearray(8)
    data[0], data[1] = encode_axis(along)
    data[2], data[3] = encode_axis(across)
    for number in buttons:
        data[5 + (number - 1) // 4] |= 1 << (6 - 2 * ((number - 1) % 4))
    return bytes(data)


def frame_id(source_address: int) -> int:
    """Return the 29-bit identifier of BJM1, priority 3."""
    return 3 << 26 | PGN_BJM1 << 8 | source_address


class CanJoystick:
    """The stick on its own bus."""

    def __init__(self, config: CanStickConfig, stale_ms: int) -> None:
        """Open the bus.

        Raises:
            DeviceError: It cannot be opened.
        """
        self.name = "CAN"
        self._config = config
        self._stale_ns = stale_ms * _MS
        self._id = frame_id(config.source_address)
        self._state = self._shown = LOST
        self._since_ns = self._last_ns = -1
        self._pump = 0.0
        try:
            self._bus: can.BusABC | None = can.Bus(
                interface=config.interface, channel=config.channel, ignore_config=True
            )
        except (can.CanError, OSError, ImportError) as error:
            raise DeviceError(
                f"joystick: CAN bus {config.interface}:{config.channel} cannot be opened ({error})"
            ) from None

    @property
    def is_present(self) -> bool:
        """Whether the last state was sound."""
        return not self._shown.lost

    def read(self, now_ns: int) -> StickState:
        """Drain the bus and return the newest state."""
        self._shown = self._read(now_ns)
        return self._shown

    def _read(self, now_ns: int) -> StickState:
        """Drain the bus and return the newest state."""
        elapsed = (now_ns - self._last_ns) / NS if self._last_ns >= 0 else 0.0
        self._last_ns = now_ns
        data = self._newest()
        if data is not None:
            self._since_ns = now_ns
            self._state = self._decode(data, min(elapsed, 0.1))
        if self._state.lost or self._since_ns < 0:
            return self._state
        age = now_ns - self._since_ns
        if not age <= self._stale_ns:
            self._pump = 0.0
            return StickState(reason=f"the CAN joystick is silent for {age / _MS:.0f} ms")
        return self._state

    def _newest(self) -> bytes | None:
        newest = None
        if self._bus is None:
            return None
        try:
            for _ in range(_DRAIN):
                message = self._bus.recv(0)
                if message is None:
                    break
                if message.is_extended_id and message.arbitration_id == self._id and len(message.data) == 8:
                    newest = bytes(message.data)
        except (can.CanError, OSError) as error:
            self._state = StickState(reason=f"the joystick's CAN bus failed: {error}")
        return newest

    def _decode(self, data: bytes, elapsed_s: float) -> StickState:
        config = self._config
        try:
            along, across = decode_axis(data[0], data[1]), decode_axis(data[2], data[3])
            deadman = decode_button(data, config.deadman)
            change = decode_button(data, config.pump_up) - decode_button(data, config.pump_down)
        except DeviceError as error:
            self._pump = 0.0
            return StickState(reason=str(error))
        self._pump = min(1.0, max(0.0, self._pump + change * config.pump_rate * elapsed_s))
        return StickState(
            along * config.along_sign,
            across * config.across_sign,
            0.0,
            self._pump,
            deadman,
            lost=False,
            reason="",
        )

    def close(self) -> None:
        """Release the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None
