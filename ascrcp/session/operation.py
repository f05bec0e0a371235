"""What goes on in the control thread for a worker: one motion or one scan at a time, waited for."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from ascrcp.core.errors import AscrcpError, CancelledError
from ascrcp.core.event import EVENTS, Reaction
from ascrcp.core.flow import JointSequence
from ascrcp.session.cycle import Cycle, CycleOutput
from ascrcp.session.scanner import Scanner
from ascrcp.session.steering import SteerOrder
from ascrcp.session.trace import TraceCollector

SCAN_SHARE = 0.25  # of the recognise step's progress bar
POLL_S = 0.002


class StoppedError(AscrcpError):
    """The safety gate stopped the motion; the message is the first cause, `chinese` the same in Chinese."""

    def __init__(self, cause: tuple[str, str]) -> None:
        super().__init__(cause[0])
        self.chinese = cause[1]


@dataclass(eq=False, slots=True)
class _Motion:
    """One motion a worker waits for.

    Attributes:
        collector: Takes in its cycles.
        number: Its number in the cycle once it is admitted, None before.
        error: Why it did not succeed.
        over: Set when it has ended.
        by_hand: Whether the stick moves the arm: it ends when the operator has finished.
    """

    collector: TraceCollector | None
    number: int | None = None
    error: AscrcpError | None = None
    over: threading.Event = field(default_factory=threading.Event)
    by_hand: bool = False


class Operation:
    """Motions and scans: begun by the worker thread, watched cycle by cycle, ended exactly once.

    `cancelled` is a level, not an edge: while it is set nothing begins, and what goes on is ended.
    """

    def __init__(self, cycle: Cycle, lockstep: bool, wake: Callable[[], None]) -> None:
        self._cycle = cycle
        self._lockstep = lockstep
        self._wake = wake
        self._motion: _Motion | None = None
        self._scanner: Scanner | None = None
        self._scan_over = threading.Event()
        self._scan_error: AscrcpError | None = None
        self._latest: CycleOutput | None = None
        self.cancelled = threading.Event()
        self.finished = threading.Event()
        self.progress = 0.0

    def run_motion(
        self, sequence: JointSequence, from_s: float = 0.0, collector: TraceCollector | None = None
    ) -> None:
        """Follow a sequence and wait for its end.

        Args:
            sequence: What to follow.
            from_s: Instant at which to enter it [s].
            collector: Takes in every cycle of the motion, None for nobody.

        Raises:
            StoppedError: The gate stopped it.
            CancelledError: The operator cancelled it, before or after it began.
            AscrcpError: The tracker gave up.
        """
        self._cycle.prepare(sequence)
        self._move(_Motion(collector), lambda: self._cycle.follow(sequence, from_s))

    def run_steering(self, order: SteerOrder, collector: TraceCollector | None = None) -> None:
        """Give the arm to the stick and wait until the operator has finished.

        Raises:
            StoppedError: The gate stopped it.
            CancelledError: The operator cancelled it.
        """
        self._cycle.prepare_steering(order)
        self.finished.clear()
        self._move(_Motion(collector, by_hand=True), lambda: self._cycle.steer(order))

    def _move(self, motion: _Motion, begin: Callable[[], int]) -> None:
        """Order a motion as soon as work is admitted, and wait for its end."""
        self._motion = motion
        if motion.collector is not None:
            motion.collector.begin()

        def admit() -> bool:
            if self.cancelled.is_set():
                self._end_motion(motion, CancelledError("cancelled"))
                return False
            motion.number = begin()
            return True

        self._cycle.begin(admit)
        self._wake()
        motion.over.wait()
        if motion.error is not None:
            raise motion.error

    def _end_motion(self, motion: _Motion, error: AscrcpError | None) -> None:
        self._motion = None
        motion.error = error
        motion.over.set()

    def fail(self, error: AscrcpError) -> None:
        """End whatever goes on: the control thread will turn no more."""
        motion = self._motion
        if motion is not None:
            self._end_motion(motion, error)
        self._scan_error = self._scan_error or error
        self._scanner = None
        self._scan_over.set()

    def run_scan(self, scanner: Scanner) -> None:
        """Drive a sweep to its end: in lockstep by the control thread, else by this worker.

        Raises:
            DeviceError: Pan head or lidar failed.
            CancelledError: The operator cancelled it.
        """
        self._scan_error = None
        self._scan_over.clear()

        def admit() -> bool:
            self._scanner = scanner
            return True

        self._cycle.begin(admit)
        self._wake()
        if self._lockstep:
            self._scan_over.wait()
        else:
            self._scan_beside()
        if self._scan_error is not None:
            raise self._scan_error

    def _scan_beside(self) -> None:
        seen = -1
        while not self._scan_over.is_set():
            output = self._latest
            if output is None or output.t_ns == seen:
                time.sleep(POLL_S)
                continue
            seen = output.t_ns
            self._advance_scan(output)

    def on_cycle(self, output: CycleOutput) -> bool:
        """Take in one cycle (control thread); return whether something still goes on."""
        self._latest = output
        self._watch_motion(output)
        if self._lockstep:
            self._advance_scan(output)
        motion = self._motion
        # a motion that waits to be admitted must not keep lockstep from coming to rest: nothing is then
        return (motion is not None and motion.number is not None) or self._scanner is not None

    def _watch_motion(self, output: CycleOutput) -> None:
        motion = self._motion
        if motion is None or motion.number is None or output.motion < motion.number:
            return
        state = output.track.state
        if motion.collector is not None and (state == "follow" or not motion.by_hand):
            motion.collector.add(output)  # an operator may rest for hours
        if output.verdict.reaction >= Reaction.STOP:
            if motion.by_hand:
                self._cycle.hold()
            self._end_motion(motion, StoppedError(EVENTS[output.verdict.causes[0]].cause))
        elif motion.by_hand:
            self._watch_hand(motion)
        elif state == "failed":
            self._end_motion(motion, AscrcpError(output.track.reason))
        elif state == "hold":
            self._end_motion(motion, CancelledError("cancelled"))
        elif state == "finished":
            self._end_motion(motion, None)
        else:
            self.progress = output.track.progress
            if self.cancelled.is_set():
                self._cycle.hold()

    def _watch_hand(self, motion: _Motion) -> None:
        """Take the arm back from the stick when the operator has finished or given up."""
        if self.cancelled.is_set() or self.finished.is_set():
            self._cycle.hold()
            self._end_motion(motion, CancelledError("cancelled") if self.cancelled.is_set() else None)

    def _advance_scan(self, output: CycleOutput) -> None:
        scanner = self._scanner
        if scanner is None:
            return
        try:
            if self.cancelled.is_set():
                raise CancelledError("cancelled")
            scanner.on_cycle(output.inputs)
        except AscrcpError as error:
            self._scan_error = error
        self.progress = SCAN_SHARE * scanner.progress
        if scanner.done or self._scan_error is not None:
            self._cycle.point_pan(None)
            self._scanner = None
            self._scan_over.set()
