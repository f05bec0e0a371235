"""Position PID, eq. 5-1 of the thesis: Out = Kp (e + 1/Ti * integral e + Td * de/dt)."""

import math
from dataclasses import dataclass

from ascrcp.core.clock import CYCLE_S

_FADE = math.exp(-CYCLE_S / 0.5)
"""Per cycle, what is left of an integral that the present gains do not use (placeholder: 0.5 s)."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Kp [1/s], Ti [s] (0: no integral, what was gathered fades), Td [s]."""

    kp: float
    ti: float = 0.0
    td: float = 0.0


class Pid:
    """One PID; its output is a speed [rad/s or m/s].

    The integral is kept as the speed it contributes, so that gains may change without a bump.
    """

    def __init__(self, integral_max: float) -> None:
        self._integral_max = integral_max
        self._integral = 0.0
        self._last: float | None = None

    def update(self, error: float, gains: Gains, saturated: bool = False) -> float:
        """Compute one cycle.

        Args:
            error: Target minus measured [rad or m], finite.
            gains: Gains of this cycle.
            saturated: Whether the drive is at its limit: the integral then only unwinds.

        Returns:
            Wanted speed [rad/s or m/s]; NaN for an error that is no number, which is not remembered.
        """
        if not abs(error) < math.inf:
            return math.nan
        rate = 0.0 if self._last is None else (error - self._last) / CYCLE_S
        self._last = error
        if not gains.ti > 0.0:
            self._integral *= _FADE
        elif not (saturated and error * self._integral >= 0.0):
            limit = self._integral_max
            step = gains.kp / gains.ti * error * CYCLE_S
            self._integral = max(-limit, min(limit, self._integral + step))
        return gains.kp * (error + gains.td * rate) + self._integral

    def clear(self) -> None:
        """Forget the past."""
        self._integral, self._last = 0.0, None

    def rest(self) -> None:
        """Drop the integral: the joint stands where it should."""
        self._integral = 0.0
