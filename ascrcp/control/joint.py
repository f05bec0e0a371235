"""What every joint controller is given and gives: one joint's wish and measurement -> drive."""

import math
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Want:
    """One joint in one cycle; all values SI (rad, m, s).

    Attributes:
        target: Reference now.
        speed: Speed of the reference now.
        ahead: Speed the reference will have when the drive of this cycle takes effect.
        measured: Newest measured joint, as late as its sensor is.
        error: Reference, delayed as the sensor is, minus measured.
        gain: Factor on the joint's full speed from the oil's temperature.
        wait: Let the joint stand: the near joint of a coupled pair goes first (thesis 5.2.1).
        obeyed: Whether the machine lets drives through at all.
        carrier: Where the joint that carries this one, and stands in its sensor's reading, is believed to
            be; 0 without one.
        carrier_measured: What was taken off that reading for it to get `measured`.
    """

    target: float
    speed: float
    ahead: float
    measured: float
    error: float
    gain: float = 1.0
    wait: bool = False
    obeyed: bool = True
    carrier: float = 0.0
    carrier_measured: float = 0.0


class JointControl(Protocol):
    """A controller of one joint; which one a joint has is a matter of configuration.

    Attributes:
        position: Where it believes the joint to be [rad or m], after `drive`.
    """

    position: float

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle, -1..1; NaN for a wish that is no number."""
        ...

    def clear(self) -> None:
        """Forget the past: the joint stands, and something new is followed."""
        ...


class Ramp:
    """Bound the drive and its change per cycle (thesis 5.2.2)."""

    def __init__(self, step: float) -> None:
        self._step = step
        self.drive = 0.0

    def toward(self, target: float) -> float:
        """Move toward a drive; one that is no number is passed on as NaN, for the gate to refuse."""
        if not abs(target) < math.inf:
            self.drive = 0.0
            return math.nan
        change = target - self.drive
        if abs(change) > self._step:
            change = math.copysign(self._step, change)
        self.drive = max(-1.0, min(1.0, self.drive + change))
        return self.drive

    def clear(self) -> None:
        """Start again from no drive."""
        self.drive = 0.0


class Observer:
    """Compare a joint with where its sensor should show it: old values with older references.

    The measured joint lags behind the true one (inclinometer filter, bus), so it is compared with
    the reference delayed as much; else a joint that follows exactly would seem to be late.
    """

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self._filtered: float | None = None
        self.delayed = 0.0

    def update(self, target: float, measured: float, moved: float = 0.0) -> float:
        """Advance the delayed reference; return its distance from the measured joint [rad or m].

        Args:
            target: Reference now [rad or m].
            measured: Newest measured joint [rad or m].
            moved: How far the reference has come since that was measured [rad or m].
        """
        last = target if self._filtered is None else self._filtered
        self._filtered = last + self._lag * (target - last)
        self.delayed = self._filtered - moved
        return self.delayed - measured

    def clear(self) -> None:
        """Begin at the next target, at rest."""
        self._filtered = None
