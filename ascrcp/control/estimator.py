"""Where a joint really is: drives given, the drive's characteristic and a coarse, late sensor -> position.

A sensor of 0.1 deg tells a joint that moves 0.3 deg/s three times a second where it is: when the
reading changes. Between two changes the drive tells better how it moves than the sensor does. So
the modelled speed is integrated and passed through a model of the sensor; a reading corrects it
only by as much as it contradicts the model: by what lies beyond half a step. What contradicts it again and
again is the drive's, and is learned apart for each direction: as an offset of the dead band, and as a factor
on the speed, which load and reach change. Which of the two a surprise belongs to, the opening tells: a wide
one hardly feels the dead band, a narrow one hardly the factor.
"""

import math
from collections import deque
from dataclasses import dataclass

from ascrcp.control.characteristic import Characteristic
from ascrcp.core.clock import CYCLE_S


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Step [rad or m] and time constant [s] of a joint's sensor."""

    resolution: float
    lag_s: float


@dataclass(frozen=True, slots=True)
class EstimatorGains:
    """How readings correct the estimate; see control.config.EstimatorConfig."""

    edge: float
    centre: float
    learn: float
    offset_max: float
    offset_spread: float = 0.01
    factor_spread: float = 0.15
    factor_max: float = 0.4


class Estimator:
    """One joint's position, and what its drive has yet to do.

    Attributes:
        position: Estimated joint [rad or m].
        shown: What its sensor should read, as a joint [rad or m], before steps.
        speed: Modelled speed over the last cycle [rad/s or m/s].
        offset: Learned surplus of drive, [down, up]: positive where the valve opens earlier than believed.
        factor: Learned factor on the speed, [down, up].
    """

    def __init__(
        self, characteristic: Characteristic, delay_s: float, sensor: SensorModel, gains: EstimatorGains
    ) -> None:
        self._characteristic = characteristic
        self._half = 0.5 * sensor.resolution
        self._gains = gains
        self._lag = 1.0 - math.exp(-CYCLE_S / sensor.lag_s) if sensor.lag_s > 0.0 else 1.0
        cycles = delay_s / CYCLE_S
        self._whole = int(cycles)
        self._part = cycles - self._whole
        self.offset = [0.0, 0.0]
        self.factor = [1.0, 1.0]
        self._sent: deque[float] = deque()
        self.position = self.shown = self.speed = 0.0
        self._known = False
        self.clear()

    def clear(self) -> None:
        """Begin again at the next reading, at rest; what was learned is kept."""
        self._sent = deque([0.0] * (self._whole + 2), maxlen=self._whole + 2)
        self._known = False
        self.speed = 0.0

    def update(self, reading: float, gain: float, obeyed: bool, carrier: float) -> float:
        """Live through one cycle under the drives sent so far and take in a reading.

        Args:
            reading: What the sensor shows, as the coordinate it measures [rad or m].
            gain: Factor on the joint's speed.
            obeyed: Whether the drives had any effect.
            carrier: What else the sensor contains: position of the joint that carries this one.

        Returns:
            Estimated position of the joint [rad or m].
        """
        if not self._known:
            self._known = True
            self.position, self.shown = reading - carrier, reading
            return self.position
        drive = self._effective(0) if obeyed else 0.0
        self.speed = self._speed(drive, gain)
        self.position += self.speed * CYCLE_S
        self.shown += self._lag * (self.position + carrier - self.shown)
        self._correct(reading - self.shown, gain)
        return self.position

    def _effective(self, later: int) -> float:
        """Drive that acts over the last cycle, or some cycles later, as far as it is sent."""
        newest = len(self._sent) - 1
        at = newest - self._whole + later
        a = self._sent[at] if at <= newest else self._sent[newest]
        b = self._sent[at - 1] if at - 1 <= newest else self._sent[newest]
        return (1.0 - self._part) * a + self._part * b

    def _speed(self, drive: float, gain: float) -> float:
        if drive == 0.0:
            return 0.0
        up = 1 if drive > 0.0 else 0
        offset = self.offset[up] if up else -self.offset[up]
        return gain * self.factor[up] * self._characteristic.speed(drive + offset)

    def _correct(self, surprise: float, gain: float) -> None:
        """Believe a reading as far as it contradicts the model."""
        g, half = self._gains, self._half
        beyond = surprise - math.copysign(half, surprise) if abs(surprise) > half else 0.0
        weighed = g.edge * beyond + g.centre * (surprise - beyond)
        self.position += weighed
        self.shown += weighed
        if self.speed != 0.0:
            self._learn(weighed, gain)

    def _learn(self, weighed: float, gain: float) -> None:
        """Share out a surprise over dead band and speed, by what each may have been wrong."""
        g, up = self._gains, 1 if self.speed > 0.0 else 0
        full = (self._characteristic.full_up if up else self._characteristic.full_down) * gain
        surplus = g.learn * (weighed if up else -weighed) / full  # of drive
        opening = abs(self.speed) / full
        narrow, wide = g.offset_spread**2, opening * g.factor_spread**2
        share = surplus / (narrow + opening * wide)
        self.offset[up] = max(-g.offset_max, min(g.offset_max, self.offset[up] + narrow * share))
        factor = self.factor[up] + wide * share
        self.factor[up] = max(1.0 - g.factor_max, min(1.0 + g.factor_max, factor))

    def sent(self, drive: float) -> None:
        """Note the drive given in this cycle."""
        self._sent.append(drive)

    def ahead(self, gain: float) -> float:
        """How far the drives already sent will still move the joint [rad or m]."""
        return sum(self._speed(self._effective(k), gain) for k in range(1, self._whole + 1)) * CYCLE_S
