"""Judge planned points: reached, waited for, skipped while safe, or failed (thesis 5.2.1, fig. 5-2)."""

import math
from dataclasses import dataclass
from enum import IntEnum

from ascrcp.control.config import TrackerConfig
from ascrcp.core.clock import CYCLE_S


class Outcome(IntEnum):
    """What became of a planned point."""

    PENDING = 0
    REACHED = 1
    SKIPPED = 2


@dataclass(frozen=True, slots=True)
class TipError:
    """Distance [m] and angle [rad] between the measured nozzle and the reference."""

    distance: float
    angle: float

    def ratio(self, distance: float, angle: float) -> float:
        """Return the larger of the two as a share of its allowance."""
        a, b = self.distance / distance, self.angle / angle
        return a if a > b else b


class PointJudge:
    """Walk through the planned points in the order in which the reference passes them."""

    def __init__(self, points: list[tuple[float, int]], config: TrackerConfig) -> None:
        factor = config.tolerance_factor
        self.tolerance = (config.ideal_mm * 1e-3 * factor, math.radians(config.ideal_deg * factor))
        self._safe = (config.safe_mm * 1e-3, math.radians(config.safe_deg))
        self._settle_s = config.settle_s
        self._points = points
        self._next = 0
        self._waited = 0.0
        self.outcome: dict[int, Outcome] = {index: Outcome.PENDING for _, index in points}
        self.reached = self.skipped = 0
        self.failure = ""

    @property
    def point(self) -> int:
        """Index of the planned point being approached or waited for, -1 after the last."""
        return self._points[self._next][1] if self._next < len(self._points) else -1

    @property
    def is_waiting(self) -> bool:
        """Whether the reference has passed a point that has not settled yet."""
        return self._waited > 0.0

    def skip_to(self, t: float) -> None:
        """Leave out the points before an instant: the sequence is entered there."""
        while self._next < len(self._points) and self._points[self._next][0] < t:
            self._next += 1

    def update(self, t: float, error: TipError) -> None:
        """Judge every point the reference has passed by now.

        Args:
            t: Time of the reference in the sequence [s].
            error: Nozzle error now.
        """
        while self._next < len(self._points) and self._points[self._next][0] <= t:
            if error.ratio(*self.tolerance) <= 1.0:
                self._settled(Outcome.REACHED)
                self.reached += 1
            elif self._waited < self._settle_s:
                self._waited += CYCLE_S
                return
            elif error.ratio(*self._safe) <= 1.0:
                self._settled(Outcome.SKIPPED)
                self.skipped += 1
            else:
                self.failure = (
                    f"planned point {self.point} is missed by {error.distance * 1e3:.0f} mm,"
                    f" {math.degrees(error.angle):.1f} deg; allowed {self._safe[0] * 1e3:.0f} mm,"
                    f" {math.degrees(self._safe[1]):.1f} deg"
                )
                return

    def _settled(self, outcome: Outcome) -> None:
        self.outcome[self._points[self._next][1]] = outcome
        self._next += 1
        self._waited = 0.0
