"""Joint sensors of the rig: true joint position -> reading on the wire, with lag, noise and steps."""

import math
from collections.abc import Sequence

import numpy as np

from ascrcp.simulation.parameter import JointConfig

DEG = math.pi / 180.0
BATCH = 256  # random numbers drawn at once; a single draw costs as much as a hundred


class TransducerArray:
    """All joint sensors; draws its noise from the rig's generator."""

    def __init__(self, joints: Sequence[JointConfig], rng: np.random.Generator) -> None:
        """Prepare and draw each sensor's zero error.

        Args:
            joints: Joint configurations.
            rng: The rig's source of chance.
        """
        self._rng = rng
        self._sensors = [joint.sensor for joint in joints]
        # one joint unit (deg or mm) in SI
        self._units = [DEG if joint.unit == "deg" else 1e-3 for joint in joints]
        draws = rng.standard_normal(len(joints))
        self._zero = [s.zero + s.bias * float(d) for s, d in zip(self._sensors, draws, strict=True)]
        self._state: list[float] | None = None
        self._noise: list[list[float]] = []

    def read(self, q: tuple[float, ...], step_s: float) -> list[float]:
        """Return the readings of one cycle [wire units], quantised.

        Args:
            q: True joint positions, SI.
            step_s: Time since the last call [s].
        """
        positions = [value / unit for value, unit in zip(q, self._units, strict=True)]
        for i, sensor in enumerate(self._sensors):
            if sensor.contains_joint:
                positions[i] += q[sensor.contains_joint - 1] / self._units[i]
        if self._state is None:
            self._state = list(positions)
        if not self._noise:
            self._noise = self._rng.standard_normal((BATCH, len(positions))).tolist()
        noise = self._noise.pop()
        readings = []
        for i, sensor in enumerate(self._sensors):
            if sensor.lag_s > 0.0:
                # held between cycles: exact for a first-order lag with a held input
                self._state[i] += (positions[i] - self._state[i]) * (1.0 - math.exp(-step_s / sensor.lag_s))
            else:
                self._state[i] = positions[i]
            value = self._zero[i] + self._state[i] * sensor.per_unit + sensor.noise * noise[i]
            readings.append(round(value / sensor.resolution) * sensor.resolution)
        return readings


class Backlash:
    """Play between a drive and what it moves.

    Attributes:
        output: Position of the moved side.
    """

    def __init__(self, play: float, start: float) -> None:
        self._half = 0.5 * play
        self.output = start

    def advance(self, drive: float) -> float:
        """Follow the drive with play and return the moved side's position."""
        if drive - self.output > self._half:
            self.output = drive - self._half
        elif self.output - drive > self._half:
            self.output = drive + self._half
        return self.output
