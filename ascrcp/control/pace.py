"""The pace of the reference: it slows down and waits when the arm does not keep up."""

from ascrcp.control.config import TrackerConfig
from ascrcp.core.clock import CYCLE_S


class Pace:
    """Time scale 0..1 of the reference.

    It eases off slowly while errors are tolerable, and comes back slowly: a brisk scale would swing
    with the arm's own lag and shake the boom. It stops at `scale_rate` once they are not, or when it
    must wait.
    """

    def __init__(self, config: TrackerConfig) -> None:
        self._from = config.slow_from
        self._to = config.slow_to
        self._step = config.scale_rate * CYCLE_S
        self._rise = config.scale_rise * CYCLE_S
        self._ease = CYCLE_S / (config.scale_ease_s + CYCLE_S)
        self.scale = 0.0

    def update(self, ratio: float, must_wait: bool) -> float:
        """Return the time scale of this cycle.

        Args:
            ratio: Largest error as a share of what is tolerated.
            must_wait: Whether the reference is to come to rest whatever the error.
        """
        if must_wait or not ratio < self._to:
            self.scale = max(0.0, self.scale - self._step)
            return self.scale
        wanted = min(1.0, (self._to - ratio) / (self._to - self._from))
        change = (wanted - self.scale) * (self._ease if wanted < 1.0 else 1.0)
        self.scale += max(-self._step, min(self._rise, change))
        return self.scale

    def stop(self) -> None:
        """Stand at once."""
        self.scale = 0.0
