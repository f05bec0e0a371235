"""Time is passed in: a real monotonic clock on the machine, a virtual one in lockstep.

Nothing below the front doors reads the wall clock; a clock step changes no command (fault F42).
"""

import time
from typing import Protocol

NS = 1_000_000_000
CYCLE_NS = 20_000_000  # control period, thesis 6.2.2: sensors sampled every 20 ms
CYCLE_S = CYCLE_NS / NS


class Clock(Protocol):
    """Monotonic nanoseconds from an arbitrary origin."""

    def now_ns(self) -> int:
        """Return the present instant [ns]."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at or after the deadline [ns]."""
        ...


class RealClock:
    """The processor's monotonic clock."""

    def now_ns(self) -> int:
        """Return the present instant [ns]."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at or after the deadline [ns], without holding the interpreter's lock."""
        # time.sleep uses clock_nanosleep(CLOCK_MONOTONIC) since Python 3.11 and holds no lock
        while (left := deadline_ns - time.monotonic_ns()) > 0:
            time.sleep(left / NS)


class VirtualClock:
    """A clock that stands still until somebody advances it: lockstep and tests."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the present virtual instant [ns]."""
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Advance the virtual time to the deadline [ns]."""
        self._now_ns = max(self._now_ns, deadline_ns)
