"""Follow a joint sequence: JointSequence + MachineInputs -> Command, thesis fig. 5-2, once per cycle."""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from ascrcp.control.config import ControlConfig
from ascrcp.control.follower import Followed, Follower
from ascrcp.control.judge import Outcome, PointJudge, TipError
from ascrcp.control.pace import Pace
from ascrcp.control.reference import Reference, Sample
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.core.machine_io import Command, MachineInputs, neutral

State = Literal["hold", "follow", "finished", "failed"]

_NAN3 = np.full(3, math.nan)
_NAN3.flags.writeable = False
_NO_ERROR = TipError(0.0, 0.0)


class TrackedArm(Protocol):
    """What the tracker needs of the arm."""

    n: int

    def forward(self, q: tuple[float, ...]) -> Array:
        """Compute T_base_tool (4, 4) of one joint vector."""
        ...


@dataclass(frozen=True, slots=True)
class TrackerOutput:
    """What the tracker wants, and how it is doing.

    Attributes:
        command: Wanted command; neutral unless following.
        q_ref: Reference joints [rad, m], NaN without a sequence.
        position: Nozzle position wanted at this instant [m], shape (3,), NaN without a sequence.
        direction: Unit spray direction wanted, shape (3,).
        point: Planned point being approached, -1 if none.
        spraying: Whether the sequence sprays here.
        time_scale: Pace of the reference, 0..1.
        error_q: Reference, delayed as the sensors are, minus measured joints [rad, m].
        state: What it is doing.
        progress: Share of the sequence's time, 0..1.
        remaining_s: Time left at full pace [s].
        reached: Planned points reached within tolerance.
        skipped: Planned points given up while safe.
        reason: Why it failed, empty else.
    """

    command: Command
    q_ref: tuple[float, ...]
    position: Array
    direction: Array
    point: int = -1
    spraying: bool = False
    time_scale: float = 0.0
    error_q: tuple[float, ...] = ()
    state: State = "hold"
    progress: float = 0.0
    remaining_s: float = 0.0
    reached: int = 0
    skipped: int = 0
    reason: str = ""


class Tracker:
    """Advance the reference, drive the joints after it, judge the planned points.

    Attributes:
        sequence: What is followed, or was followed last; None before the first.
    """

    def __init__(self, arm: TrackedArm, config: ControlConfig) -> None:
        if len(config.joints) != arm.n:
            raise ConfigError(f"control names {len(config.joints)} joints, the arm has {arm.n}")
        self._arm = arm
        self._config = config.tracker
        self._follower = Follower(config)
        self._slow = tuple(joint.slow * joint.si for joint in config.joints)
        self._settle = tuple(joint.settle * joint.si for joint in config.joints)
        self._start = tuple(
            math.radians(config.tracker.start_deg) if joint.unit == "deg" else config.tracker.start_mm * 1e-3
            for joint in config.joints
        )
        self._names = tuple(joint.name for joint in config.joints)
        self._neutral = neutral(arm.n)
        self._pace = Pace(config.tracker)
        self._state: State = "hold"
        self._reason = ""
        self._reference: Reference | None = None
        self._prepared: Reference | None = None
        self.sequence: JointSequence | None = None
        self._judge = PointJudge([], config.tracker)
        self._t = 0.0
        self._paused = self._fresh = False
        self._arrived = 0
        self._still_s = 0.0

    @property
    def time_s(self) -> float:
        """Time reached in the sequence [s]: the place in the path, kept over a stop."""
        return self._t

    @property
    def outcome(self) -> dict[int, Outcome]:
        """What became of each planned point of the sequence."""
        return dict(self._judge.outcome)

    def prepare(self, sequence: JointSequence) -> None:
        """Do the slow part of `follow` ahead; in any thread, while something else may be followed."""
        self._prepared = Reference(sequence)

    def follow(self, sequence: JointSequence, from_s: float = 0.0) -> None:
        """Begin to follow a sequence; the arm must stand where the sequence is entered.

        Args:
            sequence: What to follow.
            from_s: Instant at which to enter it [s], e.g. `time_s` after a stop.

        Raises:
            InputError: A sequence of another arm, or an instant outside it.
        """
        if sequence.q.shape[1] != self._arm.n:
            raise InputError(f"sequence has {sequence.q.shape[1]} joints, the arm {self._arm.n}")
        if not 0.0 <= from_s <= sequence.duration:
            raise InputError(f"sequence entered at {from_s} s, allowed 0..{sequence.duration:.2f} s")
        reference, self._prepared = self._prepared, None
        if reference is None or reference.sequence is not sequence:
            reference = Reference(sequence)
        self._reference = reference
        self.sequence = sequence
        self._judge = PointJudge(self._reference.points, self._config)
        self._judge.skip_to(from_s)
        self._t = from_s
        self._state, self._reason, self._paused = "follow", "", False
        self._begin()

    def hold(self) -> None:
        """Stop following and leave the arm where it is; the place in the path is kept."""
        self._state = "hold"
        self._pace.stop()

    def pause(self) -> None:
        """Bring the reference to rest and keep it; `resume` goes on from there."""
        self._paused = True

    def resume(self) -> None:
        """Go on after a pause, a hold or a controlled stop, from the place that was kept."""
        self._paused = False
        if self._state == "hold" and self._reference is not None:
            self._state = "follow"
            self._begin()

    def update(self, inputs: MachineInputs) -> TrackerOutput:
        """Run one cycle.

        Args:
            inputs: The machine as measured.

        Returns:
            What is wanted now; the same inputs always give the same outputs.
        """
        if self._reference is None:
            return TrackerOutput(self._neutral, (math.nan,) * self._arm.n, _NAN3, _NAN3, reason=self._reason)
        q = inputs.q
        if self._state != "follow" or not all(map(math.isfinite, q)):
            return self._rest(self._reference.at(self._t), q)
        return self._follow(self._reference, inputs)

    def _begin(self) -> None:
        self._fresh = True
        self._arrived, self._still_s = 0, 0.0
        self._pace.stop()
        self._follower.clear()

    def _follow(self, reference: Reference, inputs: MachineInputs) -> TrackerOutput:
        q = inputs.q
        must_wait = self._paused or not inputs.controller_enabled or self._judge.is_waiting
        before = self._t
        scale = self._pace.scale
        self._t = min(before + scale * CYCLE_S, reference.duration)
        target = reference.at(self._t)
        ahead = reference.speed_at(self._t + self._follower.lead_s * scale)
        followed = self._follower.update(target, inputs, ahead, scale)
        error = followed.error_q
        if self._fresh and not self._may_begin(error):
            return self._rest(target, q)
        tip = self._tip_error(q, followed)
        self._judge.update(self._t, tip)
        ratio = tip.ratio(*self._judge.tolerance) if target.spraying else 0.0
        self._pace.update(max(ratio, followed.behind), must_wait or self._judge.is_waiting)
        self._check_progress(reference, error, before, inputs.controller_enabled)
        if self._state != "follow":
            return self._rest(target, q)
        flows = target.spraying and scale >= self._config.pump_scale_min
        pump = target.flow * scale if flows else 0.0
        command = Command(
            drive=followed.drive,
            enable=True,
            pump=pump,
            accelerator=self._config.accelerator * pump,
            air=flows,
        )
        return self._output(command, target, error)

    def _may_begin(self, error: tuple[float, ...]) -> bool:
        self._fresh = False
        for name, e, allowed in zip(self._names, error, self._start, strict=True):
            if not abs(e) <= allowed:
                self._fail(
                    f"joint {name} stands {abs(e):.3f} rad or m from the sequence; allowed {allowed:.3f}"
                )
                return False
        return True

    def _tip_error(self, q: tuple[float, ...], followed: Followed) -> TipError:
        """Compare the measured nozzle with the reference delayed as the sensors are, both rigid."""
        A, B = self._arm.forward(q), self._arm.forward(followed.delayed_q)
        a, b = A[:3, :].tolist(), B[:3, :].tolist()
        distance = math.dist((a[0][3], a[1][3], a[2][3]), (b[0][3], b[1][3], b[2][3]))
        chord = math.dist((a[0][0], a[1][0], a[2][0]), (b[0][0], b[1][0], b[2][0]))
        return TipError(distance, 2.0 * math.asin(min(1.0, 0.5 * chord)))

    def _check_progress(
        self, reference: Reference, error: tuple[float, ...], before: float, enabled: bool
    ) -> None:
        """Find out whether the end is reached, or the arm no longer gets on."""
        if self._judge.failure:
            self._fail(self._judge.failure)
            return
        at_end = self._t >= reference.duration and self._judge.point < 0
        moved = self._t > before or self._paused
        self._still_s = 0.0 if moved else self._still_s + CYCLE_S
        if at_end:
            near = all(abs(e) <= s for e, s in zip(error, self._settle, strict=True))
            self._arrived = self._arrived + 1 if near else 0
            if self._arrived >= self._config.arrived_cycles:
                self._state = "finished"
            elif self._still_s > self._config.settle_s:
                self._end_late(error)
        elif self._still_s > self._config.stall_s:
            worst = max(range(len(error)), key=lambda j: abs(error[j]) / self._slow[j])
            why = (
                f"joint {self._names[worst]} does not follow" if enabled else "the controller is not enabled"
            )
            self._fail(f"no progress for {self._config.stall_s:g} s: {why}")

    def _end_late(self, error: tuple[float, ...]) -> None:
        """Accept an end that did not settle when every joint is close, else name the joint."""
        worst = max(range(len(error)), key=lambda j: abs(error[j]) / self._slow[j])
        if abs(error[worst]) <= self._slow[worst]:
            self._state = "finished"
        else:
            self._fail(f"joint {self._names[worst]} ends {abs(error[worst]):.3f} (SI) off its target")

    def _fail(self, reason: str) -> None:
        self._state, self._reason = "failed", reason
        self._pace.stop()

    def _rest(self, target: Sample, q: tuple[float, ...]) -> TrackerOutput:
        """Report without driving."""
        return self._output(self._neutral, target, tuple(r - x for r, x in zip(target.q, q, strict=True)))

    def _output(self, command: Command, target: Sample, error: tuple[float, ...]) -> TrackerOutput:
        assert self._reference is not None
        duration = self._reference.duration
        return TrackerOutput(
            command=command,
            q_ref=target.q,
            position=np.array(target.position),
            direction=np.array(target.direction),
            point=self._judge.point,
            spraying=target.spraying and command.enable,
            time_scale=self._pace.scale,
            error_q=error,
            state=self._state,
            progress=self._t / duration if duration > 0.0 else 1.0,
            remaining_s=duration - self._t,
            reached=self._judge.reached,
            skipped=self._judge.skipped,
            reason=self._reason,
        )
