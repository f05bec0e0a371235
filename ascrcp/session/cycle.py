"""One control cycle: read the machine, follow the target, pass the gate, write the machine.

The body of the 20 ms control thread. It never waits and never writes to disk. Orders from other
threads are applied at the beginning of a cycle, in their order. What starts something waits until
the driver admits it: in lockstep only when everything has come to rest, so that the cycle at which
it starts depends on nothing but the job.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

from ascrcp.control.steer import SteerStatus
from ascrcp.control.steer_tracker import Steered, SteerTracker
from ascrcp.control.tracker import Tracker, TrackerOutput
from ascrcp.core.event import Reaction
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.core.machine_io import Command, MachineInputs
from ascrcp.devices.joystick import LOST, Joystick, SetStick, StickState
from ascrcp.safety.gate import Gate, GateState, Verdict
from ascrcp.session.lateness import LatenessMeter
from ascrcp.session.steering import KernelMaker, SteerOrder


class Link(Protocol):
    """The machine as the cycle sees it: devices.MachineLink on any bus.

    `received` and `sent` hold (identifier, data) of the last cycle's frames, for the log; `counters`
    the frames not used so far by reason.
    """

    received: list[tuple[int, bytes]]
    sent: list[tuple[int, bytes]]
    counters: dict[str, int]

    def receive(self, now_ns: int) -> MachineInputs:
        """Drain the bus and return the newest view."""
        ...

    def send(self, command: Command) -> bool:
        """Put one command on the wire; return whether it went out."""
        ...


@dataclass(frozen=True, slots=True)
class CycleOutput:
    """Everything one cycle saw and did.

    Attributes:
        t_ns: Instant of the cycle.
        inputs: What the machine said.
        track: What the tracker wanted.
        verdict: What the gate let through.
        tip: Measured nozzle pose (4, 4), None while a joint is unknown.
        orders: Orders taken at the beginning of this cycle, for the log.
        motion: How many follow orders have been taken so far: tells one motion from the next.
        truth: The rig's true nozzle pose (4, 4), None on a machine. Recorded, never used to control.
        stick: The joystick's state.
        steer: What the operator is told while the stick has the arm, None else.
    """

    t_ns: int
    inputs: MachineInputs
    track: TrackerOutput
    verdict: Verdict
    tip: Array | None
    orders: tuple[tuple[str, Any], ...]
    motion: int
    truth: Array | None
    stick: StickState = LOST
    steer: SteerStatus | None = None


@dataclass(frozen=True, slots=True)
class Stick:
    """The operator's part of a cycle.

    Attributes:
        joystick: Where deflections come from; None in a replay, where they come as orders.
        tracker: Follows them.
        kernels: Makes what they move.
    """

    joystick: Joystick | None
    tracker: SteerTracker
    kernels: KernelMaker

    @property
    def on_screen(self) -> bool:
        """Whether the screen is to draw it."""
        return isinstance(self.joystick, SetStick)

    def put(self, state: StickState) -> None:
        """Take the state of the stick on the screen; nothing where another is configured."""
        if isinstance(self.joystick, SetStick):
            self.joystick.put(state)

    @property
    def is_present(self) -> bool:
        """Whether a sound joystick is there."""
        return self.joystick is not None and self.joystick.is_present


class Cycle:
    """The parts of one cycle, put together.

    Attributes:
        meter: How late cycles began and how long they took; the real-time driver writes it.
    """

    def __init__(
        self,
        link: Link,
        tracker: Tracker,
        gate: Gate,
        tip: Callable[[tuple[float, ...]], Array],
        truth: Callable[[], Array] | None = None,
        stick: Stick | None = None,
    ) -> None:
        self.meter = LatenessMeter()
        self._stick = stick
        self._hand = LOST
        self._told: StickState | None = None
        self._was_enabled = False
        self._foreign = 0
        self._link = link
        self._tracker = tracker
        self._gate = gate
        self._tip = tip
        self._truth = truth
        self._orders: deque[tuple[str, Any]] = deque()
        self._waiting: deque[Callable[[], bool]] = deque()
        self._pan_target: float | None = None
        self._stop_pressed = False
        self._motion = self._ordered = 0

    def prepare(self, sequence: JointSequence) -> None:
        """Do now, in the caller's thread, what would keep the control thread when it follows a sequence."""
        self._tracker.prepare(sequence)

    def prepare_steering(self, order: SteerOrder) -> None:
        """Do now, in the caller's thread, what would keep the control thread when the stick takes over."""
        assert self._stick is not None
        self._stick.kernels.prepare(order)

    def steer(self, order: SteerOrder) -> int:
        """Order: give the arm to the stick; return the motion's number."""
        self._ordered += 1
        self.begin(lambda: self.order("steer", order))
        return self._ordered

    def follow(self, sequence: JointSequence, from_s: float = 0.0) -> int:
        """Order: follow a sequence from one of its instants; return the motion's number."""
        self._ordered += 1
        self.begin(lambda: self.order("follow", (sequence, from_s)))
        return self._ordered

    def hold(self) -> None:
        """Order: stay where the arm is."""
        self._orders.append(("hold", None))

    def press_stop(self) -> None:
        """Order: protective stop, latched until `press_reset`."""
        self._orders.append(("stop", None))

    def press_reset(self) -> None:
        """Order: one rising edge of reset; dropped if nothing is latched when it is admitted."""
        self.begin(lambda: self._gate.state is GateState.STOPPED and self.order("reset", None))

    def begin(self, action: Callable[[], bool]) -> None:
        """Order: call something when the driver next admits new work.

        Args:
            action: Returns whether it set anything going: lockstep turns only then.
        """
        self._waiting.append(action)

    def order(self, kind: str, value: Any) -> bool:
        """Order anything for the next cycle, as a run log tells it; always True."""
        self._orders.append((kind, value))
        return True

    def admit(self) -> bool:
        """Let waiting orders in; return whether there is anything to do now."""
        admitted = False
        while self._waiting:
            admitted = self._waiting.popleft()() or admitted
        return admitted or bool(self._orders)

    def point_pan(self, angle: float | None) -> None:
        """Order: pan head set-point [rad]."""
        self._orders.append(("pan", None if angle is None else float(angle)))

    def step(self, now_ns: int) -> CycleOutput:
        """Run one cycle; `now_ns` is the instant it really began: the gate judges lateness by it."""
        self._poll_stick(now_ns)
        orders = tuple(self._orders)
        reset, start = self._apply_orders(orders)
        inputs = self._link.receive(now_ns)
        steered = self._steer(inputs)
        track = self._tracker.update(inputs) if steered is None else steered.track
        if steered is not None:  # every press of the enable key starts a motion of its own
            start = track.command.enable and not self._was_enabled
        self._was_enabled = steered is not None and track.command.enable
        request = replace(track.command, pan_target=self._pan_target)
        verdict = self._gate.check(
            inputs,
            request,
            reset=reset,
            start=start,
            stop=self._stop_pressed,
            error_q=track.error_q if track.state == "follow" else None,
            also=self._find_causes(steered),
        )
        self._stop_pressed = False
        self._link.send(verdict.command)
        if verdict.reaction >= Reaction.STOP:
            self._halt(track)
        tip = self._tip(inputs.q) if all(map(math.isfinite, inputs.q)) else None
        truth = self._truth() if self._truth is not None else None
        status = None if steered is None else steered.status
        return CycleOutput(
            now_ns, inputs, track, verdict, tip, orders, self._motion, truth, self._hand, status
        )

    def _poll_stick(self, now_ns: int) -> None:
        """Read the stick; while it has the arm its state is an order like any other, and recorded."""
        if self._stick is None or self._stick.joystick is None:
            return
        hand = self._stick.joystick.read(now_ns)
        if self._stick.tracker.is_active and hand != self._told:
            self._orders.append(("stick", tuple(hand)))
            self._told = hand
        self._hand = hand

    def _steer(self, inputs: MachineInputs) -> Steered | None:
        if self._stick is None or not self._stick.tracker.is_active:
            return None
        return self._stick.tracker.update(inputs, self._hand)

    def _find_causes(self, steered: Steered | None) -> tuple[str, ...]:
        """Name what only this cycle sees: a lost stick (F22), somebody else who sends our commands (F32)."""
        causes = ("joystick_lost",) if steered is not None and steered.lost else ()
        foreign = self._link.counters["foreign"]
        if foreign > self._foreign:
            self._foreign = foreign
            causes = (*causes, "foreign_sender")
        return causes

    def _halt(self, track: TrackerOutput) -> None:
        """The gate stops: leave the arm where it is."""
        if self._stick is not None and self._stick.tracker.is_active:
            self._stick.tracker.disarm()
        elif track.state == "follow":
            self._tracker.hold()

    def _apply_orders(self, orders: tuple[tuple[str, Any], ...]) -> tuple[bool, bool]:
        reset = start = False
        for _ in orders:
            kind, value = self._orders.popleft()
            if kind == "follow":
                self._tracker.follow(*value)
                self._motion += 1
                start = True
            elif kind == "steer":
                self._take_over(value)
            elif kind == "stick":
                self._hand = StickState(*value)
            elif kind == "hold":
                self._hold()
            elif kind == "stop":
                self._stop_pressed = True
                self._hold()
            elif kind == "reset":
                reset = True
            else:
                self._pan_target = value
        return reset, start

    def _take_over(self, order: SteerOrder) -> None:
        assert self._stick is not None
        self._tracker.hold()
        self._hand, self._told = LOST, None  # the record begins with the next cycle
        self._stick.tracker.begin(self._stick.kernels.take(order))
        self._motion += 1

    def _hold(self) -> None:
        self._tracker.hold()
        if self._stick is not None:
            self._stick.tracker.end()

    @property
    def has_orders(self) -> bool:
        """Whether an order waits."""
        return bool(self._orders or self._waiting)
