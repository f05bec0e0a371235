"""Segmented PID of one joint: gains by error and by range, ramp, feed-forward (thesis 5.1.3, 5.2.2)."""

import math
from bisect import bisect_left

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.config import JointConfig, PulseConfig, SegmentConfig
from ascrcp.control.pid import Gains, Pid
from ascrcp.control.pulse import PulseJog, PulseSettings
from ascrcp.core.clock import CYCLE_S

_ZONE = 0.6
"""Share of the sensor's step within which an error is none: rounding alone makes half a step."""


class JointController:
    """Turn one joint's reference and measurement into a drive, once per cycle.

    The measured joint lags behind the true one (inclinometer filter, bus), so it is compared with
    the reference delayed as much; else a joint that follows exactly would seem to be late.
    """

    def __init__(self, config: JointConfig) -> None:
        si = config.si
        up, down = config.full_speed
        self.characteristic = Characteristic(up * si, down * si, *config.dead_band)
        self._ends = [segment.to * si for segment in config.segments[:-1]]
        self._segments = [_Segment(segment, si) for segment in config.segments]
        self._pid = Pid(config.integral_max * self.characteristic.slowest_full)
        self._ramp = config.ramp
        self._zone = _ZONE * config.resolution * si
        self._lag = 1.0 - math.exp(-CYCLE_S / config.lag_s) if config.lag_s > 0.0 else 1.0
        self._pulse = _pulse_jog(config.pulse, self.characteristic, config.resolution * si, si)
        self._filtered: float | None = None
        self._delayed = 0.0
        self._drive = 0.0
        self._is_pulsed = False

    @property
    def delayed(self) -> float:
        """The reference as the newest measurement should show it [rad or m], after `observe`."""
        return self._delayed

    def observe(self, target: float, measured: float, moved: float = 0.0) -> float:
        """Advance the delayed reference; return its distance from the measured joint [rad or m].

        Args:
            target: Reference now [rad or m].
            measured: Newest measured joint [rad or m].
            moved: How far the reference has come since that was measured [rad or m].
        """
        last = target if self._filtered is None else self._filtered
        self._filtered = last + self._lag * (target - last)
        self._delayed = self._filtered - moved
        return self._delayed - measured

    def drive(self, error: float, measured: float, speed: float, wait: bool = False) -> float:
        """Compute the drive of this cycle.

        Args:
            error: What `observe` returned [rad or m].
            measured: Measured joint [rad or m], selects the segment.
            speed: Reference speed to feed forward [rad/s or m/s].
            wait: Let the joint stand: the near joint of a coupled pair goes first (thesis 5.2.1).

        Returns:
            Drive -1..1, changed by at most the ramp since the last cycle unless it is a pulse.
        """
        if wait:
            self._pid.rest()
            return self._ramped(0.0)
        if self._pulse is not None and self._may_pulse(self._pulse, error, speed):
            self._is_pulsed = True
            self._pid.rest()
            self._drive = self._pulse.update(error)
            return self._drive
        if self._is_pulsed and self._pulse is not None:
            self._is_pulsed = False
            self._pulse.clear()
        if speed == 0.0 and abs(error) <= self._zone:
            self._pid.rest()
            return self._ramped(0.0)
        segment = self._segments[bisect_left(self._ends, measured)]
        wanted = speed + self._pid.update(error, segment.gains(abs(error)), abs(self._drive) >= 1.0)
        return self._ramped(self.characteristic.drive(wanted) + segment.offset)

    def clear(self) -> None:
        """Forget the past: a new sequence, or the joint has stood."""
        self._pid.clear()
        if self._pulse is not None:
            self._pulse.clear()
        self._filtered, self._drive, self._is_pulsed = None, 0.0, False

    @staticmethod
    def _may_pulse(pulse: PulseJog, error: float, speed: float) -> bool:
        return abs(error) < pulse.settings.below and abs(speed) < pulse.settings.speed_below

    def _ramped(self, target: float) -> float:
        """Move toward the target drive; a target that is no number is passed on for the gate to refuse."""
        if not abs(target) < math.inf:
            self._drive = 0.0
            return math.nan
        change = target - self._drive
        if abs(change) > self._ramp:
            change = math.copysign(self._ramp, change)
        self._drive = max(-1.0, min(1.0, self._drive + change))
        return self._drive


class _Segment:
    """One part of the range in SI."""

    def __init__(self, config: SegmentConfig, si: float) -> None:
        self.offset = config.offset
        self._bounds = [band.below * si for band in config.bands[:-1]]
        self._gains = [Gains(band.kp, band.ti_s, band.td_s) for band in config.bands]

    def gains(self, error: float) -> Gains:
        """Return the gains for the size of an error; beyond the last bound the last band holds."""
        return self._gains[bisect_left(self._bounds, error)]


def _pulse_jog(
    config: PulseConfig | None, characteristic: Characteristic, resolution: float, si: float
) -> PulseJog | None:
    if config is None:
        return None
    settings = PulseSettings(
        below=config.below * si,
        speed_below=config.speed_below * si,
        zone=config.zone * si,
        drive=config.drive,
        drive_max=config.drive_max,
        drive_step=config.drive_step,
        cycles=config.cycles,
        cycles_max=config.cycles_max,
        rest_cycles=config.rest_cycles,
    )
    return PulseJog(settings, characteristic, resolution)
