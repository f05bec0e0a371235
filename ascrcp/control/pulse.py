"""Closed-loop pulsed jog for joints 7 and 8, which answer too briskly to be driven gently (table 5-9)."""

from dataclasses import dataclass

from ascrcp.control.characteristic import Characteristic
from ascrcp.core.clock import CYCLE_S


@dataclass(frozen=True, slots=True)
class PulseSettings:
    """Pulsed jog in SI; see control.config.PulseConfig."""

    below: float
    speed_below: float
    zone: float
    drive: float
    drive_max: float
    drive_step: float
    cycles: int
    cycles_max: int
    rest_cycles: int


class PulseJog:
    """Give a short pulse, wait until the joint stands, look, give the next.

    A pulse that moved nothing is followed by a stronger one, one that went past the target by a
    weaker one: the joint's own friction sets the strength, apart for each direction.
    """

    def __init__(self, settings: PulseSettings, characteristic: Characteristic, resolution: float) -> None:
        self.settings = settings
        self._characteristic = characteristic
        self._resolution = resolution
        self._strength = {1.0: settings.drive, -1.0: settings.drive}
        self._sign = 1.0
        self._pulse_left = self._rest_left = 0
        self._error_before: float | None = None

    def update(self, error: float) -> float:
        """Return the drive of this cycle.

        Args:
            error: Target minus measured [rad or m].
        """
        if self._pulse_left > 0:
            self._pulse_left -= 1
            return self._sign * self._strength[self._sign]
        if self._rest_left > 0:
            self._rest_left -= 1
            return 0.0
        self._learn(error)
        if abs(error) <= self.settings.zone:
            return 0.0
        self._sign = 1.0 if error > 0.0 else -1.0
        drive = self._sign * self._strength[self._sign]
        self._pulse_left = self._length(error, drive) - 1
        self._rest_left = self.settings.rest_cycles
        self._error_before = error
        return drive

    def _length(self, error: float, drive: float) -> int:
        """Return the pulse's cycles: the shortest for the smallest errors, more by nominal speed."""
        s = self.settings
        speed = abs(self._characteristic.speed(drive))
        beyond = abs(error) - 2.0 * s.zone
        if not (beyond > 0.0 and speed > 0.0):
            return s.cycles
        more = beyond / (speed * CYCLE_S)
        return s.cycles_max if not more < s.cycles_max - s.cycles else s.cycles + round(more)

    def _learn(self, error: float) -> None:
        """Adjust the strength of the last pulse's direction by what it did."""
        before, self._error_before = self._error_before, None
        if before is None:
            return
        s, sign = self.settings, self._sign
        if abs(error - before) < 1.5 * self._resolution:
            self._strength[sign] = min(s.drive_max, self._strength[sign] + s.drive_step)
        elif error * before < 0.0:
            self._strength[sign] = max(s.drive, self._strength[sign] - 0.5 * s.drive_step)

    def clear(self) -> None:
        """End a pulse under way; what was learned is kept."""
        self._pulse_left = self._rest_left = 0
        self._error_before = None
