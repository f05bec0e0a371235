"""Segmented PID of one joint: gains by error and by range, ramp, feed-forward (thesis 5.1.3, 5.2.2)."""

from bisect import bisect_left

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.config import JointConfig, PulseConfig, SegmentConfig
from ascrcp.control.joint import Ramp, Want
from ascrcp.control.pid import Gains, Pid
from ascrcp.control.pulse import PulseJog, PulseSettings

_ZONE = 0.6
"""Share of the sensor's step within which an error is none: rounding alone makes half a step."""


class SegmentedControl:
    """Segmented PID with pulsed jog where the joint has one."""

    def __init__(self, config: JointConfig) -> None:
        si = config.si
        up, down = config.full_speed
        self.characteristic = Characteristic(up * si, down * si, *config.dead_band)
        self._ends = [segment.to * si for segment in config.segments[:-1]]
        self._segments = [_Segment(segment, si) for segment in config.segments]
        self._pid = Pid(config.integral_max * self.characteristic.slowest_full)
        self._ramp = Ramp(config.ramp)
        self._zone = _ZONE * config.resolution * si
        self._pulse = _pulse_jog(config.pulse, self.characteristic, config.resolution * si, si)
        self._is_pulsed = False
        self.position = 0.0

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle; see JointControl. A pulse is not ramped."""
        self.position = want.measured
        if want.wait:
            self._pid.rest()
            return self._ramp.toward(0.0)
        error, speed = want.error, want.ahead
        if self._pulse is not None and self._may_pulse(self._pulse, error, speed):
            self._is_pulsed = True
            self._pid.rest()
            self._ramp.drive = self._pulse.update(error)
            return self._ramp.drive
        if self._is_pulsed and self._pulse is not None:
            self._is_pulsed = False
            self._pulse.clear()
        if speed == 0.0 and abs(error) <= self._zone:
            self._pid.rest()
            return self._ramp.toward(0.0)
        segment = self._segments[bisect_left(self._ends, want.measured)]
        saturated = abs(self._ramp.drive) >= 1.0
        wanted = speed + self._pid.update(error, segment.gains(abs(error)), saturated)
        return self._ramp.toward(self.characteristic.drive(wanted) + segment.offset)

    def clear(self) -> None:
        """Forget the past: a new sequence, or the joint has stood."""
        self._pid.clear()
        self._ramp.clear()
        if self._pulse is not None:
            self._pulse.clear()
        self._is_pulsed = False

    @staticmethod
    def _may_pulse(pulse: PulseJog, error: float, speed: float) -> bool:
        return abs(error) < pulse.settings.below and abs(speed) < pulse.settings.speed_below


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
