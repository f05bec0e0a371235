"""The pace of the reference: it slows down and waits when the arm does not keep up."""

from ascrcp.control.config import TrackerConfig
from ascrcp.core.clock import CYCLE_S


class Pace:
    """Time scale 0..1 of the reference, changed no faster than `scale_rate`."""

    def __init__(self, config: TrackerConfig) -> None:
        self._from = config.slow_from
        self._to = config.slow_to
        self._step = config.scale_rate * CYCLE_S
        self.scale = 0.0

    def update(self, ratio: float, must_wait: bool) -> float:
        """Return the time scale of this cycle.

        Args:
            ratio: Largest error as a share of what is tolerated.
            must_wait: Whether the reference is to come to rest whatever the error.
        """
        wanted = 0.0
        if not must_wait and ratio < self._to:
            wanted = min(1.0, (self._to - ratio) / (self._to - self._from))
        change = wanted - self.scale
        if not abs(change) <= self._step:
            change = self._step if change > 0.0 else -self._step
        self.scale += change
        return self.scale

    def stop(self) -> None:
        """Stand at once."""
        self.scale = 0.0
