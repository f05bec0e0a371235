"""The nominal drive characteristic of a joint: wanted speed -> valve drive."""

import math
from dataclasses import dataclass

_SOFT = 0.01
"""Share of full speed over which the dead band is jumped: a step there would chatter (placeholder)."""


@dataclass(frozen=True, slots=True)
class Characteristic:
    """Dead band and full-drive speed per direction; a cylinder is faster one way than the other.

    Attributes:
        full_up: Speed at full positive drive [rad/s or m/s].
        full_down: Speed at full negative drive, positive number.
        dead_up: Drive at which the valve begins to open upward.
        dead_down: The same downward.
    """

    full_up: float
    full_down: float
    dead_up: float
    dead_down: float

    def drive(self, speed: float) -> float:
        """Compute the drive that gives a speed on the nominal joint, bounded to -1..1.

        Args:
            speed: Wanted speed [rad/s or m/s].

        Returns:
            The drive; NaN for a speed that is no number, never full drive.
        """
        if not abs(speed) < math.inf:
            return math.nan
        if speed >= 0.0:
            return _open(speed / self.full_up, self.dead_up)
        return -_open(-speed / self.full_down, self.dead_down)

    def speed(self, drive: float) -> float:
        """Compute the speed the nominal joint reaches at a drive [rad/s or m/s]."""
        if drive >= 0.0:
            return max(0.0, drive - self.dead_up) / (1.0 - self.dead_up) * self.full_up
        return -max(0.0, -drive - self.dead_down) / (1.0 - self.dead_down) * self.full_down

    @property
    def slowest_full(self) -> float:
        """The smaller of the two full-drive speeds [rad/s or m/s]."""
        return self.full_up if self.full_up < self.full_down else self.full_down


def _open(share: float, dead_band: float) -> float:
    """Drive 0..1 for a share of full speed."""
    if not share < 1.0:
        return 1.0
    jump = dead_band * (share / _SOFT if share < _SOFT else 1.0)
    return jump + share * (1.0 - dead_band)
