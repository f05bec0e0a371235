"""Closed-loop pulsed jog for joints 7 and 8, which answer too briskly to be driven gently (table 5-9)."""

from dataclasses import dataclass

from ascrcp.control.characteristic import Characteristic
from ascrcp.core.clock import CYCLE_S


@dataclass(frozen=True, slots=True)
class PulseSettings:
    """Pulsed jog in SI; see control.config.PulseConfig."""

    below: float
    speed_below: float
    drive: float
    drive_max: float
    drive_step: float
    cycles_max: int
    rest_cycles: int


class PulseJog:
    """Give a short pulse, wait until the joint stands, look, give the next.

    A pulse that moved nothing is followed by a stronger one, one that went past the target by a
    weaker one: the joint's own friction sets the strength.
    """

    def __init__(self, settings: PulseSettings, characteristic: Characteristic, resolution: float) -> None:
        self._settings = settings
        self._characteristic = characteristic
        self._resolution = resolution
        self._strength = settings.drive
        self._pulse_left = self._rest_left = 0
        self._sign = 1.0
        self._error_before: float | None = None

    def update(self, error: float) -> float:
        """Return the drive of this cycle.

        Args:
            error: Target minus measured [rad or m], zero when the joint has arrived.
        """
        if self._pulse_left > 0:
            self._pulse_left -= 1
            return self._sign * self._strength
        if self._rest_left > 0:
            self._rest_left -= 1
            return 0.0
        self._learn(error)
        if error == 0.0:
            self._error_before = None
            return 0.0
        self._sign = 1.0 if error > 0.0 else -1.0
        speed = abs(self._characteristic.speed(self._sign * self._strength))
        cycles = round(abs(error) / (speed * CYCLE_S)) if speed > 0.0 else 1
        self._pulse_left = min(max(cycles, 1), self._settings.cycles_max) - 1
        self._rest_left = self._settings.rest_cycles
        self._error_before = error
        return self._sign * self._strength

    def _learn(self, error: float) -> None:
        """Adjust the strength by what the last pulse did."""
        before = self._error_before
        if before is None:
            return
        least, most, step = self._settings.drive, self._settings.drive_max, self._settings.drive_step
        if abs(error - before) < self._resolution:
            self._strength = min(most, self._strength + step)
        elif error * before < 0.0:
            self._strength = max(least, self._strength - step)

    def clear(self) -> None:
        """End a pulse under way and begin with the first strength."""
        self._pulse_left = self._rest_left = 0
        self._strength = self._settings.drive
        self._error_before = None
