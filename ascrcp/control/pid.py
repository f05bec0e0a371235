"""Position PID, eq. 5-1 of the thesis: Out = Kp (e + 1/Ti * integral e + Td * de/dt)."""

from dataclasses import dataclass

from ascrcp.core.clock import CYCLE_S


@dataclass(frozen=True, slots=True)
class Gains:
    """Kp [1/s], Ti [s] (0: no integral), Td [s]."""

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
            Wanted speed [rad/s or m/s].
        """
        rate = 0.0 if self._last is None else (error - self._last) / CYCLE_S
        self._last = error
        if gains.ti > 0.0 and not (saturated and error * self._integral >= 0.0):
            step = gains.kp / gains.ti * error * CYCLE_S
            limit = self._integral_max
            if not abs(step) <= limit:  # finite gate before the clamp
                step = 0.0
            self._integral = max(-limit, min(limit, self._integral + step))
        return gains.kp * (error + gains.td * rate) + self._integral

    def clear(self) -> None:
        """Forget the past."""
        self._integral, self._last = 0.0, None

    def rest(self) -> None:
        """Drop the integral: the joint stands where it should."""
        self._integral = 0.0
