"""The project's own controller: the identified inverse of the drive fed forward, feedback on an estimate.

The speed wanted when the drive takes effect goes through the inverse of the drive (dead band and full
speed by direction, oil, what was learned); feedback acts on the error that will be left then, as the
estimator foresees it. So the feedback has no delay to fight with and can be firm without swinging the boom.
"""

import math

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.config import JointConfig
from ascrcp.control.estimator import Estimator, EstimatorGains, SensorModel
from ascrcp.control.joint import Ramp, Want


class IdentifiedControl:
    """Feed-forward through the drive's inverse, feedback on the estimate."""

    def __init__(self, config: JointConfig) -> None:
        si, own = config.si, config.identified
        up, down = config.full_speed
        self._characteristic = Characteristic(up * si, down * si, *config.dead_band)
        sensor = SensorModel(config.resolution * si, config.lag_s)
        gains = EstimatorGains(
            own.edge,
            own.centre,
            own.learn,
            own.offset_max,
            own.offset_spread,
            own.factor_spread,
            own.factor_max,
        )
        self.estimator = Estimator(self._characteristic, config.delay_s, sensor, gains)
        self._ramp = Ramp(config.ramp)
        self._kp = own.kp
        self._delay = config.delay_s
        self._zone = own.zone * config.resolution * si
        self._rest_speed = own.rest_speed * config.resolution * si
        self.position = 0.0
        self._resting = True

    def clear(self) -> None:
        """Forget the past, keep what was learned of the drive."""
        self.estimator.clear()
        self._ramp.clear()
        self._resting = True

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle; see JointControl."""
        estimator = self.estimator
        reading = want.measured + want.carrier_measured
        self.position = estimator.update(reading, want.gain, want.obeyed, want.carrier)
        drive = self._ramp.toward(self._wanted(want, self.position))
        estimator.sent(drive if math.isfinite(drive) else 0.0)
        return drive

    def _wanted(self, want: Want, position: float) -> float:
        """Drive before the ramp."""
        if want.wait:
            return 0.0
        delay = self._delay
        target = want.target + 0.5 * (want.speed + want.ahead) * delay
        error = target - position - self.estimator.ahead(want.gain)
        if abs(want.ahead) <= self._rest_speed and abs(error) <= self._zone * (2.0 if self._resting else 1.0):
            self._resting = True
            return 0.0
        self._resting = False
        speed = (want.ahead + self._kp * error) / want.gain
        drive = self._characteristic.drive(speed / self.estimator.factor[1 if speed > 0.0 else 0])
        if drive > 0.0:
            return max(0.0, drive - self.estimator.offset[1])
        return min(0.0, drive + self.estimator.offset[0]) if drive < 0.0 else drive
