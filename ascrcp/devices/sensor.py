"""Joint sensors: the value on the wire <-> the joint in SI (thesis tables 1-1 and 5-7).

Inclinometers read the absolute inclination, so joint 4's has joint 2 in it; joint 5 is measured as
the stroke of its cylinder.
"""

import math
from typing import Literal

from ascrcp.core.config import Struct
from ascrcp.core.errors import ConfigError

STATUS_OK = 0
DEG = math.pi / 180.0
MM = 1e-3


class SensorConfig(Struct):
    """One joint sensor as it is wired.

    Attributes:
        kind: What it is, for the screen and for messages.
        unit: Unit on the wire.
        minimum: Lower end of the joint's range, in that unit.
        maximum: Upper end.
        zero: Reading at q = 0, in that unit.
        deg_per_mm: For a cylinder that turns a joint: angle per stroke; 0 for every other kind.
        sign: 1, or -1 where the sensor counts against the joint.
        relative_to: Number of the joint whose angle is contained in the reading, 0 for none.
    """

    kind: Literal["encoder", "inclinometer", "draw_wire", "cylinder"]
    unit: Literal["deg", "mm"]
    minimum: float
    maximum: float
    zero: float = 0.0
    deg_per_mm: float = 0.0
    sign: Literal[1, -1] = 1
    relative_to: int = 0

    def __post_init__(self) -> None:
        if not self.minimum < self.maximum:
            raise ValueError(f"minimum {self.minimum} must be below maximum {self.maximum}")
        if (self.kind == "cylinder") != (self.deg_per_mm != 0.0):
            raise ValueError("deg_per_mm belongs to kind cylinder and to no other")
        if self.kind in ("draw_wire", "cylinder") and self.unit != "mm":
            raise ValueError(f"a {self.kind} reads mm, not {self.unit}")

    @property
    def si_per_unit(self) -> float:
        """Joint motion in rad or m for one deg or mm of reading."""
        if self.kind == "cylinder":
            return self.sign * self.deg_per_mm * DEG
        return self.sign * (DEG if self.unit == "deg" else MM)


class SensorArray:
    """The sensors of all joints, precomputed for the 20 ms cycle."""

    def __init__(self, configs: list[SensorConfig], margin: float) -> None:
        """Prepare the conversion.

        Args:
            configs: One per joint, joint 1 first.
            margin: Fraction of the span a reading may lie outside its range and still be
                electrically possible (fault F6).

        Raises:
            ConfigError: A sensor that contains a joint it cannot.
        """
        for number, c in enumerate(configs, start=1):
            if not 0 <= c.relative_to < number:
                raise ConfigError(
                    f"sensor {number}: relative_to {c.relative_to} must name an earlier joint or be 0"
                )
        self.joints = len(configs)
        self._zero = [c.zero for c in configs]
        self._scale = [c.si_per_unit for c in configs]
        self._base = [c.relative_to - 1 for c in configs]
        span = [(c.maximum - c.minimum) * margin for c in configs]
        self._low = [c.minimum - s for c, s in zip(configs, span, strict=True)]
        self._high = [c.maximum + s for c, s in zip(configs, span, strict=True)]

    def is_in_range(self, joint: int, reading: float, status: float) -> bool:
        """Whether a reading is electrically possible and its sensor calls itself healthy.

        Args:
            joint: Joint index from 0.
            reading: Value on the wire [deg or mm].
            status: Status nibble of the frame.
        """
        return status == STATUS_OK and self._low[joint] <= reading <= self._high[joint]

    def to_joints(self, readings: list[float]) -> tuple[float, ...]:
        """Convert readings [deg or mm] to the joint vector, SI; NaN stays NaN."""
        q: list[float] = []
        for i, reading in enumerate(readings):
            value = (reading - self._zero[i]) * self._scale[i]
            if self._base[i] >= 0:
                value -= q[self._base[i]]
            q.append(value)
        return tuple(q)

    def to_readings(self, q: tuple[float, ...]) -> list[float]:
        """Convert a joint vector, SI, to what the sensors would read [deg or mm]."""
        readings = []
        for i, value in enumerate(q):
            absolute = value + q[self._base[i]] if self._base[i] >= 0 else value
            readings.append(self._zero[i] + absolute / self._scale[i])
        return readings
