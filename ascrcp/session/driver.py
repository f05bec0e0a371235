"""Who turns the cycles: the control thread, in real time or in lockstep with the rig.

Real time: absolute deadlines every 20 ms on a thread of its own, lateness always measured.
Lockstep: rig and control advance together as fast as the processor allows, and time stands still
while nothing moves; the sequence of cycles, and so every command, depends on the seed alone.
"""

import sys
import threading
from collections.abc import Callable
from typing import Protocol

from ascrcp.core.clock import CYCLE_NS, NS, Clock, RealClock, VirtualClock
from ascrcp.core.priority import favour_application, favour_control, release_application
from ascrcp.session.collector import Collector
from ascrcp.session.cycle import Cycle, CycleOutput
from ascrcp.simulation.rig import FaultKind

SWITCH_S = 0.001  # after which the lock passes to a thread that waits for it; 5 ms if nobody says so
GRACE_CYCLES = 10  # lockstep: cycles that run after an order, so that a reset or stop is answered


class Plant(Protocol):
    """The rig on the other end of the wires."""

    def step(self, now_ns: int) -> None:
        """Advance the rig by one cycle."""
        ...

    def plant_fault(self, kind: FaultKind, frame: str, value: float) -> None:
        """Plant a fault in a frame of the rig, from the next cycle on."""
        ...

    def clear_faults(self) -> None:
        """Take all planted faults away and release the emergency stop."""
        ...

    def press_estop(self) -> None:
        """Press the rig's hard-wired emergency stop."""
        ...

    def release_estop(self) -> None:
        """Release it."""
        ...


Listener = Callable[[CycleOutput], bool]
"""Called after every cycle; returns whether something still goes on (lockstep keeps turning)."""

OnFailure = Callable[[Exception], None]
"""Called in the thread that an exception has ended; the machine's own watchdog makes it neutral then."""


class RealTimeDriver:
    """The 20 ms control thread on the processor's clock."""

    realtime = True

    def __init__(
        self, cycle: Cycle, listener: Listener, on_failure: OnFailure, plant: Plant | None = None
    ) -> None:
        self._cycle = cycle
        self._listener = listener
        self._plant = plant
        self.clock: Clock = RealClock()
        self._stop = threading.Event()
        self._threads = [_thread("ascrcp-control", self._control, on_failure)]
        if plant is not None:
            self._threads.append(_thread("ascrcp-rig", self._machine, on_failure))
        self.meter = cycle.meter
        self._collector = Collector()
        self._switch_s = sys.getswitchinterval()

    def start(self) -> None:
        """Start turning."""
        favour_application()
        self._collector.start()
        sys.setswitchinterval(SWITCH_S)
        for thread in reversed(self._threads):
            thread.start()

    def wake(self) -> None:
        """Orders are read every cycle anyway."""

    def wait_for_rest(self) -> None:
        """Real time never rests."""

    def _control(self) -> None:
        self.meter.has_priority = favour_control()
        clock, deadline = self.clock, self.clock.now_ns() + CYCLE_NS
        while not self._stop.is_set():
            clock.sleep_until(deadline)
            now = clock.now_ns()
            self._cycle.admit()
            self._listener(self._cycle.step(now))
            self.meter.add(deadline, now, clock.now_ns())
            deadline += CYCLE_NS
            self._collector.turn()
            behind = clock.now_ns() - deadline
            if behind > CYCLE_NS:  # missed whole cycles: count them, never run them in a burst
                deadline += behind // CYCLE_NS * CYCLE_NS
        self._listener(self._cycle.step(clock.now_ns()))  # a stop ordered on the way out reaches the wire

    def _machine(self) -> None:
        assert self._plant is not None
        favour_control()  # it stands for a machine that nothing holds up
        clock, deadline = self.clock, self.clock.now_ns() + CYCLE_NS // 2
        while not self._stop.is_set():
            clock.sleep_until(deadline)
            self._plant.step(deadline)
            deadline = max(deadline + CYCLE_NS, clock.now_ns())

    def close(self) -> None:
        """Stop the threads; the machine's own watchdog makes it neutral."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        sys.setswitchinterval(self._switch_s)
        self._collector.stop()
        release_application()


class LockstepDriver:
    """Rig and control in one thread on a virtual clock."""

    realtime = False

    def __init__(self, cycle: Cycle, listener: Listener, on_failure: OnFailure, plant: Plant) -> None:
        self._cycle = cycle
        self._listener = listener
        self._plant = plant
        self.clock = VirtualClock()
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._rest = threading.Event()
        self._thread = _thread("ascrcp-control", self._turn, on_failure)
        self.meter = cycle.meter

    def start(self) -> None:
        """Start turning; the first cycles let every sensor be heard."""
        self._thread.start()

    def wake(self) -> None:
        """Tell the thread that an order waits."""
        self._wake.set()

    def wait_for_rest(self) -> None:
        """Wait until time stands still: what is read then depends on nothing but the job."""
        self._rest.wait()

    def _turn(self) -> None:
        try:
            self._run(GRACE_CYCLES)
            while not self._stop.is_set():
                self._rest.set()
                self._wake.wait()
                self._rest.clear()
                self._wake.clear()
                while self._cycle.has_orders and not self._stop.is_set():
                    if self._cycle.admit():
                        self._run(GRACE_CYCLES)
            self._listener(self._advance())  # a stop ordered on the way out reaches the wire
        finally:
            self._rest.set()

    def _run(self, grace: int) -> None:
        """Turn until nothing has gone on for `grace` cycles."""
        quiet = 0
        while quiet < grace and not self._stop.is_set():
            quiet = 0 if self._listener(self._advance()) else quiet + 1

    def _advance(self) -> CycleOutput:
        self.clock.sleep_until(self.clock.now_ns() + CYCLE_NS)
        now = self.clock.now_ns()
        self._plant.step(now)
        return self._cycle.step(now)

    def close(self) -> None:
        """Stop the thread."""
        self._stop.set()
        self._wake.set()
        self._thread.join()

    @property
    def seconds(self) -> float:
        """Virtual time so far [s]."""
        return self.clock.now_ns() / NS


def _thread(name: str, turn: Callable[[], None], on_failure: OnFailure) -> threading.Thread:
    def run() -> None:
        try:
            turn()
        except Exception as error:  # noqa: BLE001 - handed on, with its traceback, to be shown
            on_failure(error)

    return threading.Thread(target=run, name=name, daemon=True)
