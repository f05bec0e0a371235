"""Bring the joints to one sample of a reference: Sample + MachineInputs -> eight drives, once per cycle.

Whoever makes the samples uses it the same way: the tracker from a joint sequence, the joystick's
steering from its own integration.
"""

import math
from dataclasses import dataclass

from ascrcp.control.choice import make_controller
from ascrcp.control.config import ControlConfig, JointConfig
from ascrcp.control.joint import Observer, Want
from ascrcp.control.play import Play
from ascrcp.control.reference import Sample
from ascrcp.core.clock import CYCLE_S, NS
from ascrcp.core.machine_io import MachineInputs


@dataclass(frozen=True, slots=True)
class Followed:
    """What one cycle of following came to.

    Attributes:
        drive: Drive per joint, -1..1.
        error_q: Reference, delayed as the sensors are, minus measured joints [rad, m].
        delayed_q: The reference as the newest measurements should show it [rad, m], play included.
        behind: Largest joint error as a share of the error at which the reference should wait; from 1 on
            a joint falls behind.
    """

    drive: tuple[float, ...]
    error_q: tuple[float, ...]
    delayed_q: tuple[float, ...]
    behind: float


class Follower:
    """All joint controllers of a machine and the rule that couples two of them."""

    def __init__(self, config: ControlConfig) -> None:
        self._joints = tuple(_Joint(joint) for joint in config.joints)
        self._slow = tuple(joint.slow * joint.si for joint in config.joints)
        self._near, self._far = (number - 1 for number in config.tracker.coupled)
        self._coupled = math.radians(config.tracker.coupled_deg)
        self.lead_s = max(joint.lead_s for joint in self._joints)
        for joint in self._joints:
            joint.share = joint.lead_s / self.lead_s

    def clear(self) -> None:
        """Forget the past: the joints stand, and something new is followed. A play stays on its side."""
        for joint in self._joints:
            joint.control.clear()
            joint.observer.clear()

    def update(
        self,
        sample: Sample,
        inputs: MachineInputs,
        ahead: tuple[float, ...] | None = None,
        scale: float = 1.0,
    ) -> Followed:
        """Run one cycle.

        Args:
            sample: Where the joints should be now, and their speeds at full pace.
            inputs: The machine as measured; every joint finite.
            ahead: Joint speeds that will hold `lead_s` from now [rad/s, m/s]; those of the sample if None.
            scale: Pace of the reference, 0..1: factor on all speeds.

        Returns:
            Drives and errors; the same calls always give the same results.
        """
        speeds = sample.speed if ahead is None else ahead
        for joint, speed in zip(self._joints, speeds, strict=True):
            joint.play.update(speed * scale)
        error = self._observe(sample, inputs, scale)
        far_waits = abs(error[self._near]) > self._coupled and abs(error[self._far]) > self._coupled
        q = inputs.q
        drives: list[float] = []
        believed: list[float] = []
        for i, joint in enumerate(self._joints):
            now, base, play = sample.speed[i] * scale, joint.base, joint.play
            want = Want(
                target=sample.q[i] + play.offset,
                speed=now,
                ahead=now + joint.share * (speeds[i] * scale - now) + play.rate,
                measured=q[i],
                error=error[i],
                gain=joint.gain(inputs.oil_temp_c),
                wait=far_waits and i == self._far,
                obeyed=inputs.controller_enabled,
                carrier=believed[base] if base >= 0 else 0.0,
                carrier_measured=q[base] if base >= 0 else 0.0,
            )
            drives.append(joint.control.drive(want))
            believed.append(joint.control.position)
        delayed = tuple(joint.observer.delayed for joint in self._joints)
        return Followed(tuple(drives), error, delayed, self._behind(error))

    def _observe(self, sample: Sample, inputs: MachineInputs, scale: float) -> tuple[float, ...]:
        """Compare every joint with where its sensor should show it; old values with older references."""
        rows = zip(self._joints, sample.q, inputs.q, sample.speed, inputs.age_ns, strict=True)
        return tuple(
            joint.observer.update(r + joint.play.offset, x, v * scale * age / NS if age < NS else 0.0)
            for joint, r, x, v, age in rows
        )

    def _behind(self, error: tuple[float, ...]) -> float:
        worst = 0.0
        for e, slow in zip(error, self._slow, strict=True):
            share = abs(e) / slow
            if not share <= worst:
                worst = share
        return worst


class _Joint:
    """One joint's controller and what the follower knows of the joint."""

    def __init__(self, config: JointConfig) -> None:
        self.control = make_controller(config)
        self.observer = Observer(1.0 - math.exp(-CYCLE_S / config.lag_s) if config.lag_s > 0.0 else 1.0)
        self.base = config.rides_on - 1
        self.lead_s = config.delay_s + 0.5 * CYCLE_S
        self.share = 1.0
        rest_speed = config.identified.rest_speed * config.resolution * config.si
        self.play = Play(config.play * config.si, config.take_up * config.si, rest_speed)
        self._oil_per_c, self._oil_c = config.oil_per_c, config.oil_c

    def gain(self, oil_c: float) -> float:
        """Factor on the joint's speed at an oil temperature; 1 while it is unknown."""
        factor = 1.0 + self._oil_per_c * (oil_c - self._oil_c)
        return min(2.0, max(0.5, factor)) if abs(factor) < math.inf else 1.0
