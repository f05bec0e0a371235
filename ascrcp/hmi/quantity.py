"""One table of shown quantities: inside value -> unit and decimals on the screen."""

import math
from dataclasses import dataclass

NOTHING = "–"
"""Shown where a value is unknown."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """How one kind of number is shown.

    Attributes:
        unit: Text after the number.
        scale: Shown value per inside value.
        decimals: Digits after the point: one more than the sensor resolves at most.
        signed: Whether a plus sign is shown.
    """

    unit: str
    scale: float
    decimals: int
    signed: bool = False

    def number(self, value: float) -> str:
        """Return the number without its unit; NaN and infinity show as unknown."""
        if not math.isfinite(value):
            return NOTHING
        shown = round(value * self.scale, self.decimals) + 0.0  # no "-0.0"
        return f"{shown:{'+' if self.signed else ''}.{self.decimals}f}"

    def show(self, value: float) -> str:
        """Return the number with its unit."""
        number = self.number(value)
        return number if number == NOTHING else number + self.unit


_DEG = 180.0 / math.pi

ANGLE = Quantity("°", _DEG, 1)
ANGLE_RANGE = Quantity("°", _DEG, 0)
LENGTH = Quantity(" mm", 1000.0, 0)
ANGLE_ERROR = Quantity("°", _DEG, 1, signed=True)
LENGTH_ERROR = Quantity(" mm", 1000.0, 0, signed=True)
POSITION = Quantity(" m", 1.0, 3)
DIRECTION = Quantity("", 1.0, 2)
DRIVE = Quantity(" %", 100.0, 0, signed=True)
TIP_ERROR_MM = Quantity(" mm", 1.0, 0)
TIP_ERROR_DEG = Quantity("°", 1.0, 1)
TEMPERATURE = Quantity(" °C", 1.0, 0)
LATENESS_MS = Quantity(" ms", 1.0, 1)
SPEED = Quantity(" ×", 1.0, 1)
PROGRESS = Quantity(" %", 100.0, 0)
CLEARANCE = Quantity(" m", 1.0, 2)
STATION = Quantity(" m", 1.0, 2)
DEPTH = Quantity(" mm", 1000.0, 0)
RATE = Quantity("", 1.0, 0)
AGE_MS = Quantity(" ms", 1.0, 0)


def show_point(point: tuple[float, ...], quantity: Quantity) -> str:
    """Return the components of a vector in one unit, e.g. "8.120  -2.400  3.000 m"."""
    numbers = [quantity.number(value) for value in point]
    return NOTHING if all(number == NOTHING for number in numbers) else "  ".join(numbers) + quantity.unit


def show_duration(seconds: float) -> str:
    """Return a duration [s] as m:ss, or h:mm:ss from an hour on."""
    if not math.isfinite(seconds) or seconds < 0:
        return NOTHING
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
