"""Follow the operator's stick: kernel + StickState + MachineInputs -> Command, once per cycle.

Stands beside the tracker of sequences and says the same TrackerOutput. Nothing moves without the
enable key, and it counts only once it has been pressed with the stick centred (faults F23, F24).
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ascrcp.control.config import ControlConfig
from ascrcp.control.follower import Follower
from ascrcp.control.pace import Pace
from ascrcp.control.reference import Sample
from ascrcp.control.steer import Kernel, SteerStatus
from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.tracker import TrackerOutput
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.machine_io import Command, MachineInputs, neutral


class Hand(Protocol):
    """The stick as the tracker sees it: devices.joystick.StickState."""

    @property
    def along(self) -> float: ...  # noqa: D102 - see StickState
    @property
    def across(self) -> float: ...  # noqa: D102
    @property
    def lift(self) -> float: ...  # noqa: D102
    @property
    def lever(self) -> float: ...  # noqa: D102
    @property
    def deadman(self) -> bool: ...  # noqa: D102
    @property
    def lost(self) -> bool: ...  # noqa: D102
    @property
    def is_neutral(self) -> bool: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class Steered:
    """One cycle of steering.

    Attributes:
        track: As the tracker of sequences says it; "follow" while enabled, else "hold".
        status: What the operator is told.
        lost: The stick was lost while it moved the arm: a protective stop (fault F22).
    """

    track: TrackerOutput
    status: SteerStatus
    lost: bool


class SteerTracker:
    """Drive the joints after a kernel's samples while the operator holds the key."""

    def __init__(self, control: ControlConfig, config: SteerConfig, joints: int) -> None:
        self._control, self._config = control, config
        self._follower = Follower(control)
        self._pace = Pace(control.tracker)
        self._lead = max(1, round(self._follower.lead_s / CYCLE_S))
        self._samples: deque[Sample] = deque(maxlen=self._lead + 1)
        self._neutral = neutral(joints)
        self._units = tuple(joint.unit for joint in control.joints)
        self._kernel: Kernel | None = None
        self._armed = False
        self._was_held = True
        self._visited: set[int] = set()

    @property
    def is_active(self) -> bool:
        """Whether the stick has the arm."""
        return self._kernel is not None

    @property
    def visited(self) -> frozenset[int]:
        """Planned points sprayed at since `begin`; kept after `end`."""
        return frozenset(self._visited)

    def begin(self, kernel: Kernel) -> None:
        """Give the arm to the stick; nothing moves before the key is pressed."""
        self._kernel = kernel
        self._armed, self._was_held = False, True
        self._visited.clear()
        self._stand(kernel)

    def end(self) -> None:
        """Take the arm from the stick."""
        self._kernel, self._armed = None, False

    def disarm(self) -> None:
        """Something stopped the motion: the key must be released and pressed anew."""
        self._armed, self._was_held = False, True
        if self._kernel is not None:
            self._stand(self._kernel)

    def update(self, inputs: MachineInputs, hand: Hand) -> Steered:
        """Run one cycle; only while the stick has the arm."""
        kernel = self._kernel
        assert kernel is not None
        was_armed = self._armed
        status = self._arm(inputs, hand)
        if not self._armed:
            if was_armed:
                self._stand(kernel)
            track = self._output(self._neutral, self._samples[0], self._difference(inputs), "hold")
            return Steered(track, status, was_armed and hand.lost)
        return Steered(self._follow(kernel, inputs, hand), kernel.status, False)

    def _arm(self, inputs: MachineInputs, hand: Hand) -> SteerStatus:
        """Follow the key: armed from a press with the stick centred until it is let go."""
        pressed = hand.deadman and not hand.lost
        if not pressed or not all(map(math.isfinite, inputs.q)):
            self._armed = False
        elif not self._armed and not self._was_held and hand.is_neutral:
            self._armed = self._rejoin(inputs)
        waits = hand.deadman and not self._armed
        self._was_held = hand.deadman and (self._was_held or not hand.is_neutral)
        if hand.lost:
            return SteerStatus.LOST
        return SteerStatus.CENTRE if waits else SteerStatus.DEADMAN

    def _rejoin(self, inputs: MachineInputs) -> bool:
        """Let the kernel take up the arm as it stands; return whether it stands near enough to begin."""
        assert self._kernel is not None
        self._kernel.rejoin(np.array(inputs.q))
        self._stand(self._kernel)
        return all(
            abs(e)
            <= (math.radians(self._config.rejoin_deg) if unit == "deg" else self._config.rejoin_mm * 1e-3)
            for e, unit in zip(self._difference(inputs), self._units, strict=True)
        )

    def _stand(self, kernel: Kernel) -> None:
        kernel.rest()
        self._follower.clear()
        self._pace.stop()
        self._samples.clear()
        self._samples.extend([replace(kernel.sample(), speed=(0.0,) * len(self._units))] * (self._lead + 1))

    def _difference(self, inputs: MachineInputs) -> tuple[float, ...]:
        return tuple(r - x for r, x in zip(self._samples[0].q, inputs.q, strict=True))

    def _follow(self, kernel: Kernel, inputs: MachineInputs, hand: Hand) -> TrackerOutput:
        """Advance the kernel; follow it by the follower's lead, so that its speeds are known ahead."""
        scale = self._pace.scale if inputs.controller_enabled else 0.0
        self._samples.append(kernel.step(hand.along, hand.across, scale, hand.lift))
        sample, newest = self._samples[0], self._samples[-1]
        followed = self._follower.update(sample, inputs, newest.speed)
        self._pace.update(followed.behind, not inputs.controller_enabled)
        pump = hand.lever if hand.lever > 0.0 else 0.0
        if pump > 0.0 and kernel.point >= 0:
            self._visited.add(kernel.point)
        command = Command(
            drive=followed.drive,
            enable=True,
            pump=pump,
            accelerator=self._control.tracker.accelerator * pump,
            air=pump > 0.0,
        )
        return self._output(command, sample, followed.error_q, "follow")

    def _output(
        self, command: Command, sample: Sample, error: tuple[float, ...], state: str
    ) -> TrackerOutput:
        assert self._kernel is not None
        return TrackerOutput(
            command=command,
            q_ref=sample.q,
            position=np.array(sample.position),
            direction=np.array(sample.direction),
            point=self._kernel.point,
            spraying=command.pump > 0.0,
            time_scale=self._pace.scale,
            error_q=error,
            state="follow" if state == "follow" else "hold",
            reached=len(self._visited),
        )
