"""How late each control cycle began and how long it took: fixed rings, written by the control thread."""

import numpy as np

from ascrcp.core.clock import CYCLE_NS, NS
from ascrcp.core.geometry import Array
from ascrcp.session.snapshot import Lateness

PER_SECOND = NS // CYCLE_NS  # cycles
WINDOW = 1 << 16  # samples kept: 22 minutes


class LatenessMeter:
    """Collects two figures a cycle without allocating.

    Attributes:
        count: Cycles added so far.
        missed: Periods so far in which no cycle began.
        has_priority: Whether the control thread was given real-time priority.
    """

    def __init__(self) -> None:
        self._late = np.zeros(WINDOW)
        self._body = np.zeros(WINDOW)
        self.count = 0
        self.has_priority = False
        self.missed = 0
        self._first_due, self._period = 0, -1
        self._shown, self._shown_at = Lateness(), 0

    def add(self, due_ns: int, began_ns: int, done_ns: int) -> None:
        """Add one cycle: when it was to begin, when it began, when it was done [ns]."""
        at = self.count % WINDOW
        self._late[at] = (began_ns - due_ns) * 1e-6
        self._body[at] = (done_ns - began_ns) * 1e-6
        if not self.count:
            self._first_due = due_ns
        self.count += 1
        period = (began_ns - self._first_due) // CYCLE_NS
        self.missed += max(0, period - self._period - 1)
        self._period = period

    def lateness(self) -> Lateness:
        """Return the percentiles so far [ms], at most a second old: sorting them takes a millisecond."""
        if self._shown_at and self.count - self._shown_at < PER_SECOND:
            return self._shown
        self._shown_at = self.count
        seen = self._late[: min(self.count, WINDOW)]
        if len(seen):
            p50, p999 = np.percentile(seen, [50, 99.9])
            self._shown = Lateness(float(p50), float(p999), float(seen.max()), self.missed)
        return self._shown

    def since(self, first: int) -> tuple[Array, Array]:
        """Return lateness and duration of the cycles from one on [ms], each shape (k,), at most WINDOW."""
        numbers = np.arange(max(first, self.count - WINDOW), self.count) % WINDOW
        return self._late[numbers], self._body[numbers]
