"""Bending of the boom: static sag and one lightly damped mode up-down and sideways.

The coefficients are the rig's own (config/simulation/arm.yaml): the platform's sag model has others.
The joint sensors sit near the pivots and do not see the bending.
"""

import math

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.simulation.parameter import FlexureConfig, ModeConfig

MAX_OVERHANG = 1.2  # nozzle reach over lance reach; more occurs only with the lance pointing up


class Mode:
    """An oscillator on an accelerated support, advanced exactly for a held acceleration.

    Attributes:
        deflection: Of the lance's end against the rigid arm [m].
    """

    def __init__(self, config: ModeConfig) -> None:
        self._config = config
        self.deflection = 0.0
        self._rate = 0.0

    def push(self, speed: float) -> None:
        """Give it a knock: a change of its speed [m/s]."""
        self._rate += speed

    def advance(self, acceleration: float, softness: float, step_s: float) -> None:
        """Advance one step.

        Args:
            acceleration: Of the rigid lance's end along this direction [m/s2].
            softness: Factor on the natural frequency from reach and payload.
            step_s: Step [s].
        """
        c = self._config
        w = 2.0 * math.pi * c.frequency_hz * softness
        z = c.damping
        rest = -c.participation * acceleration / (w * w)  # where it would settle
        x, v = self.deflection - rest, self._rate
        wd = w * math.sqrt(1.0 - z * z)
        decay = math.exp(-z * w * step_s)
        cos, sin = math.cos(wd * step_s), math.sin(wd * step_s)
        b = (v + z * w * x) / wd
        self.deflection = rest + decay * (x * cos + b * sin)
        self._rate = decay * (v * cos - (w * w * x + z * w * v) / wd * sin)


class Flexure:
    """Sag and vibration of the whole arm under a payload."""

    def __init__(self, config: FlexureConfig, reference_kg: float, payload_kg: float) -> None:
        """Prepare.

        Args:
            config: Parameters.
            reference_kg: Payload for which the payload's sag holds.
            payload_kg: Payload now.
        """
        self._config = config
        self._reference_kg = reference_kg
        self.vertical = Mode(config.vertical)
        self.lateral = Mode(config.lateral)
        self._last: tuple[float, float, float] | None = None
        self._velocity = (0.0, 0.0, 0.0)
        self._stroke = 0.0
        self._reach = config.reference_reach
        self._sag, self._mass_factor = 0.0, 1.0
        self.load(payload_kg)
        self.vertical.deflection = 0.0  # it has long come to rest

    def load(self, payload_kg: float) -> None:
        """Hang another payload on: the arm swings from where it is to its new sag."""
        c = self._config
        before = self.sag(self._reach)
        self._sag = (c.sag_mm + c.payload_sag_mm * payload_kg / self._reference_kg) * 1e-3
        self.vertical.deflection += self.sag(self._reach) - before
        self._mass_factor = 1.0 / math.sqrt(1.0 + payload_kg / c.effective_mass_kg)

    def advance(self, end: tuple[float, float, float], flow: float, step_s: float) -> None:
        """Advance the modes by one cycle.

        Args:
            end: Position of the rigid lance's end [m], base frame; joints 7 and 8 behind it move
                too little mass to shake the boom.
            flow: Concrete flow, fraction 0..1; the pump's strokes shake the boom.
            step_s: Cycle [s].
        """
        last = self._last or end
        velocity = tuple((new - old) / step_s for new, old in zip(end, last, strict=True))
        ax, ay, az = ((new - old) / step_s for new, old in zip(velocity, self._velocity, strict=True))
        self._last = end
        self._velocity = (velocity[0], velocity[1], velocity[2])
        reach = math.hypot(end[0], end[1])
        self._reach = reach
        c = self._config
        softness = self._mass_factor
        if reach > 0.1 * c.reference_reach:
            softness *= (c.reference_reach / reach) ** c.frequency_exponent
            sideways = (end[0] * ay - end[1] * ax) / reach
        else:
            softness *= 10.0**c.frequency_exponent
            sideways = 0.0
        self._stroke = (self._stroke + c.pump_stroke_hz * flow * step_s) % 1.0
        shake = c.pump_shake * flow * math.sin(2.0 * math.pi * self._stroke)
        self.vertical.advance(az + shake, softness, step_s)
        self.lateral.advance(sideways, softness, step_s)

    @property
    def stroke(self) -> float:
        """Where the concrete pump is in its stroke, 0..1."""
        return self._stroke

    def sag(self, reach: float) -> float:
        """Compute the static sag, positive down [m], at a horizontal reach [m]."""
        c = self._config
        return self._sag * (reach / c.reference_reach) ** c.exponent

    def bend(self, T: Array) -> Array:
        """Bend a rigid pose on the arm.

        Args:
            T: Pose on the rigid arm, base frame, shape (4, 4).

        Returns:
            The pose where it really is, shape (4, 4): lowered by sag and mode, tipped by their slope.
        """
        x, y = float(T[0, 3]), float(T[1, 3])
        reach = math.hypot(x, y)
        if reach < 1e-6:
            return T
        # a mode's shape grows like the square of the way along the boom; the nozzle is beyond its end
        ratio = reach / self._reach if self._reach > 0.0 else 1.0
        shape = min(ratio, MAX_OVERHANG) ** 2
        up = shape * self.vertical.deflection - self.sag(reach)
        left = shape * self.lateral.deflection
        ex, ey = x / reach, y / reach
        k = self._config.slope / reach
        # small rotation: nose down about the left axis (-ey, ex, 0), and yaw about z
        pitch, yaw = -k * up, k * left
        bent = T.copy()
        bent[:3, :3] = _rotation(-ey * pitch, ex * pitch, yaw) @ T[:3, :3]
        bent[0, 3] = x - ey * left
        bent[1, 3] = y + ex * left
        bent[2, 3] = T[2, 3] + up
        return bent


def _rotation(x: float, y: float, z: float) -> Array:
    """Rotation matrix of a rotation vector [rad] (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return np.eye(3)
    s, v = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    return np.array(
        [
            [1.0 - v * (y * y + z * z), v * x * y - s * z, v * x * z + s * y],
            [v * x * y + s * z, 1.0 - v * (x * x + z * z), v * y * z - s * x],
            [v * x * z - s * y, v * y * z + s * x, 1.0 - v * (x * x + y * y)],
        ]
    )
