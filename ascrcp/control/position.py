"""Classic position PID of one joint: eq. 5-1 of the thesis straight to the drive (5.1.1, table 5-2)."""

import math

from ascrcp.control.config import JointConfig
from ascrcp.control.joint import Ramp, Want
from ascrcp.core.clock import CYCLE_S


class PositionControl:
    """Out = Kp (e + 1/Ti * integral e + Td * de/dt), neither feed-forward nor dead band known.

    The integral is not limited: the paper's overshoot comes from it (errata 2).
    """

    def __init__(self, config: JointConfig, period_s: float = CYCLE_S) -> None:
        self._gains = config.position
        self._period_s = period_s
        self._si = config.si
        self._ramp = Ramp(config.ramp)
        self.position = 0.0
        self._integral = 0.0
        self._last: float | None = None

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle; see JointControl."""
        self.position = want.measured
        if want.wait:
            self._integral = 0.0
            return self._ramp.toward(0.0)
        return self._ramp.toward(self.output(want.error / self._si))

    def output(self, error: float) -> float:
        """Advance eq. 5-1 by one cycle; drive for an error [deg or mm], not yet limited."""
        if not abs(error) < math.inf:
            return math.nan
        g = self._gains
        rate = 0.0 if self._last is None else (error - self._last) / self._period_s
        self._last = error
        if g.ti_s > 0.0 and self._integrates(error):
            self._integral += error * self._period_s / g.ti_s
        return g.kp * (error + self._gathered(error) + g.td_s * rate)

    def _integrates(self, error: float) -> bool:
        """Whether the integral runs; the classic one always does."""
        return abs(error) < math.inf

    def _gathered(self, error: float) -> float:
        """Share of the integral that acts."""
        return self._integral if self._integrates(error) else 0.0

    def clear(self) -> None:
        """Forget the past."""
        self._ramp.clear()
        self._integral = 0.0
        self._last = None
