"""Bring the joints to one sample of a reference: Sample + MachineInputs -> eight drives, once per cycle.

Whoever makes the samples uses it the same way: the tracker from a joint sequence, the joystick's
steering from its own integration.
"""

import math
from dataclasses import dataclass

from ascrcp.control.config import ControlConfig
from ascrcp.control.reference import Sample
from ascrcp.control.segmented import JointController
from ascrcp.core.clock import NS
from ascrcp.core.machine_io import MachineInputs


@dataclass(frozen=True, slots=True)
class Followed:
    """What one cycle of following came to.

    Attributes:
        drive: Drive per joint, -1..1.
        error_q: Reference, delayed as the sensors are, minus measured joints [rad, m].
        delayed_q: The reference as the newest measurements should show it [rad, m].
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
        self._joints = tuple(JointController(joint) for joint in config.joints)
        self._slow = tuple(joint.slow * joint.si for joint in config.joints)
        self._near, self._far = (number - 1 for number in config.tracker.coupled)
        self._coupled = math.radians(config.tracker.coupled_deg)
        self.lead_s = config.tracker.lead_s

    def clear(self) -> None:
        """Forget the past: the joints stand, and something new is followed."""
        for joint in self._joints:
            joint.clear()

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
        error = self._observe(sample, inputs, scale)
        speeds = sample.speed if ahead is None else ahead
        far_waits = abs(error[self._near]) > self._coupled and abs(error[self._far]) > self._coupled
        rows = zip(self._joints, error, inputs.q, speeds, strict=True)
        drive = tuple(
            joint.drive(e, x, v * scale, wait=far_waits and i == self._far)
            for i, (joint, e, x, v) in enumerate(rows)
        )
        return Followed(drive, error, tuple(j.delayed for j in self._joints), self._behind(error))

    def _observe(self, sample: Sample, inputs: MachineInputs, scale: float) -> tuple[float, ...]:
        """Compare every joint with where its sensor should show it; old values with older references."""
        rows = zip(self._joints, sample.q, inputs.q, sample.speed, inputs.age_ns, strict=True)
        return tuple(
            joint.observe(r, x, v * scale * age / NS if age < NS else 0.0) for joint, r, x, v, age in rows
        )

    def _behind(self, error: tuple[float, ...]) -> float:
        worst = 0.0
        for e, slow in zip(error, self._slow, strict=True):
            share = abs(e) / slow
            if not share <= worst:
                worst = share
        return worst
