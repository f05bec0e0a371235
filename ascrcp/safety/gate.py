"""The gate every command passes last: MachineInputs and a wanted Command -> the allowed Command.

States: STOPPED (a cause is latched) -RESET-> READY -START-> ARMED -R2 or no longer enabled-> STOPPING
-> READY. Power-up is STOPPED. Only ARMED and STOPPING put anything but zero on the wire. Everything
else in the platform is untrusted here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from ascrcp.core.errors import ConfigError
from ascrcp.core.event import EVENTS, Reaction
from ascrcp.core.machine_io import Command, MachineInputs, neutral
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.limit import LimitCheck, Limits
from ascrcp.safety.shape import is_finite, ramped
from ascrcp.safety.signal import JumpCheck, find_signal_causes
from ascrcp.safety.watch import CycleCheck, EchoCheck, FollowingCheck


class GateState(Enum):
    """What the gate lets through."""

    STOPPED = "stopped"
    READY = "ready"
    ARMED = "armed"
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the gate decided in one cycle.

    Attributes:
        command: The only command that may be sent.
        reaction: Hardest reaction in force.
        causes: Codes of core.event.EVENTS latched or active, first cause first.
        active: Those of them that are there now; a reset needs this free of R3 and R4.
        latched: Whether only RESET leads out.
        state: Where the gate stands.
    """

    command: Command
    reaction: Reaction
    causes: tuple[str, ...]
    active: tuple[str, ...]
    latched: bool
    state: GateState


class Gate:
    """The last word on every command; one `check` per control cycle, always."""

    def __init__(self, limits: Limits, config: SafetyConfig) -> None:
        self._joints = len(limits.revolute)
        if len(config.ramp) != self._joints:
            raise ConfigError(f"safety config names {len(config.ramp)} joints, the arm has {self._joints}")
        self._config = config
        self._limit = LimitCheck(limits, config)
        self._jump = JumpCheck(limits, config)
        self._following = FollowingCheck(limits, config)
        self._cycle = CycleCheck(config)
        self._echo = EchoCheck(config)
        self._neutral = neutral(self._joints)
        self._sent = self._neutral
        self._state = GateState.STOPPED
        self._causes = ["power_up"]
        self._recovering: frozenset[int] = frozenset()
        self._reset_was = self._start_was = True

    @property
    def state(self) -> GateState:
        """Where the gate stands."""
        return self._state

    def check(
        self,
        inputs: MachineInputs,
        request: Command,
        *,
        reset: bool = False,
        start: bool = False,
        stop: bool = False,
        error_q: Sequence[float] | None = None,
        also: Sequence[str] = (),
    ) -> Verdict:
        """Decide what goes on the wire in this cycle. Never raises on bad values.

        Args:
            inputs: This cycle's view of the machine.
            request: What the platform wants.
            reset: Reset button; only its rising edge counts, and only while no cause is active,
                save a joint beyond its limit: that may then be brought back, inward and slowly (F13).
            start: Start of a motion; only its rising edge counts, and only in READY or while the motion
                before it comes to rest in good order.
            stop: Stop on the screen, or the session's wish for a protective stop.
            error_q: Target minus measured joints [rad or m], None while nothing is followed.
            also: Codes of events somebody else has found, e.g. a lost joystick.

        Returns:
            The verdict; its command has finite drives within limit and ramp, or is neutral.
        """
        reset_edge, self._reset_was = reset and not self._reset_was, reset
        start_edge, self._start_was = start and not self._start_was, start
        active, beyond = self._find(inputs, request, error_q, stop)
        active += [code for code in also if code not in active]
        hard = [code for code in active if EVENTS[code].reaction >= Reaction.PROTECT]
        soft = [code for code in active if EVENTS[code].reaction == Reaction.STOP]

        if hard:
            self._stop(hard)
        elif self._state is GateState.STOPPED and reset_edge:
            self._state, self._causes = GateState.READY, []
        elif self._may_start and start_edge and not soft:
            self._state, self._causes = GateState.ARMED, []
        elif self._state is GateState.ARMED and (soft or not request.enable):
            self._state, self._causes = GateState.STOPPING, soft
        if beyond and reset_edge and hard == ["joint_limit"]:
            self._state, self._causes, self._recovering = GateState.READY, [], beyond
            active = []

        command, held_back = self._shape(inputs, request)
        if held_back:
            active = [*active, "soft_limit"]
        if self._state is GateState.STOPPING and not any(command.drive):
            self._state = GateState.READY
        self._sent = command
        return self._verdict(command, active)

    @property
    def _may_start(self) -> bool:
        stops_for_a_cause = self._state is GateState.STOPPING and bool(self._causes)
        return self._state in (GateState.READY, GateState.STOPPING) and not stops_for_a_cause

    def _find(
        self, inputs: MachineInputs, request: Command, error_q: Sequence[float] | None, stop: bool
    ) -> tuple[list[str], frozenset[int]]:
        """Name every cause active now, and the ranges beyond their hard limit."""
        active = ["operator_stop"] if stop else []
        active += find_signal_causes(inputs, self._config, self._joints)
        active += self._cycle.update(inputs.t_ns)
        if not is_finite(request, self._joints) or not _all_finite(error_q):
            active.append("not_finite")
        if self._jump.update(inputs):
            active.append("joint_jump")
        if self._echo.update(inputs, self._sent.enable):
            active.append("controller_mismatch")
        beyond: frozenset[int] = frozenset()
        if not {"joint_stale", "not_finite"} & set(active):
            beyond = self._limit.find_beyond(self._jump.held(inputs.q))
            if beyond - self._recovering:
                active.append("joint_limit")
        self._recovering &= beyond
        if self._state is GateState.ARMED:
            following = self._following.update(error_q, self._sent.drive)
            if following is not None:
                active.append(following)
        else:
            self._following.clear()
        return list(dict.fromkeys(active)), beyond

    def _stop(self, hard: list[str]) -> None:
        """Latch hard causes behind those already there."""
        first = self._causes if self._state is GateState.STOPPED else []
        self._causes = list(dict.fromkeys([*first, *hard]))
        self._state = GateState.STOPPED
        self._recovering = frozenset()

    def _shape(self, inputs: MachineInputs, request: Command) -> tuple[Command, bool]:
        """Bound the request; neutral while STOPPED; only the pan head, which scans at rest, in READY."""
        if self._state is GateState.STOPPED:
            return self._neutral, False
        wants = self._state is GateState.ARMED and request.enable
        target, held_back = self._neutral.drive, False
        if wants:
            target, held_back = self._limit.hold_back(self._jump.held(inputs.q), self._bounded(request.drive))
        drive = ramped(self._sent.drive, target, self._config.ramp)
        command = Command(
            drive=drive,
            enable=wants or any(drive),
            pump=min(max(request.pump, 0.0), 1.0) if wants else 0.0,
            accelerator=min(max(request.accelerator, 0.0), 1.0) if wants else 0.0,
            air=request.air and wants,
            pan_target=request.pan_target,
        )
        return command, held_back

    def _bounded(self, drive: Sequence[float]) -> tuple[float, ...]:
        """Clamp finite drives to their limits, to the recovery drive while a joint is brought back."""
        most = self._config.recovery_drive if self._recovering else 1.0
        return tuple(
            max(-limit, min(limit, d))
            for d, limit in zip(drive, (min(most, x) for x in self._config.drive_limit), strict=True)
        )

    def _verdict(self, command: Command, active: list[str]) -> Verdict:
        causes = tuple(dict.fromkeys([*self._causes, *active]))
        return Verdict(
            command=command,
            reaction=max((EVENTS[code].reaction for code in causes), default=Reaction.LOG),
            causes=causes,
            active=tuple(active),
            latched=self._state is GateState.STOPPED,
            state=self._state,
        )


def _all_finite(values: Sequence[float] | None) -> bool:
    return values is None or all(abs(v) < float("inf") for v in values)
