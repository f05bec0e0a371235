"""Check a joint sequence against the arm before anything moves (thesis 5.3): JointSequence -> DryRun."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ascrcp.core.errors import RefusedError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.planning.parameter import CheckParameters, check_parameters


@dataclass(frozen=True)
class Finding:
    """One rule that rows of the sequence break.

    Attributes:
        rule: "limit", "speed", "step", or "joints" for a sequence of another arm.
        joint: Joint number, from 1; 0 for none.
        row: Row where it is worst.
        t: Its time [s].
        rows: How many rows break the rule for this joint.
        text: One line: what, where, what is allowed.
    """

    rule: str
    joint: int
    row: int
    t: float
    rows: int
    text: str


@dataclass(frozen=True)
class DryRun:
    """Outcome of the check: findings by rule and joint, none when the sequence may be run."""

    findings: tuple[Finding, ...]
    rows: int

    @property
    def ok(self) -> bool:
        """Whether the sequence may be run."""
        return not self.findings

    def require(self) -> None:
        """Refuse the sequence if anything was found.

        Raises:
            RefusedError: The first finding and how many there are.
        """
        if self.findings:
            more = f" (and {len(self.findings) - 1} more)" if len(self.findings) > 1 else ""
            raise RefusedError(f"the joint sequence may not be run: {self.findings[0].text}{more}")


def check_sequence(arm: Arm, sequence: JointSequence, parameters: CheckParameters) -> DryRun:
    """Check ranges, speeds and steps of every joint in every row.

    Args:
        arm: The arm that would run it.
        sequence: Joints against time.
        parameters: Tolerances and the largest steps.
    """
    p = check_parameters(parameters)
    if sequence.q.shape[1] != arm.n:
        text = f"the sequence has {sequence.q.shape[1]} joints, {arm.name} has {arm.n}"
        return DryRun((Finding("joints", 0, 0, 0.0, len(sequence.t), text),), len(sequence.t))
    findings = (
        *_check_limits(arm, sequence, p),
        *_check_rates(arm, sequence, p),
    )
    return DryRun(findings, len(sequence.t))


def _check_limits(arm: Arm, sequence: JointSequence, parameters: CheckParameters) -> list[Finding]:
    """Ranges, also of sums such as kc's lance inclination q2 + q4."""
    tolerance = np.where(
        arm.prismatic, parameters.limit_tolerance_mm / 1e3, np.radians(parameters.limit_tolerance_deg)
    )
    value = sequence.q @ arm.limit_matrix.T
    excess = np.maximum(arm.limit_lower - value, value - arm.limit_upper) - tolerance

    def describe(row: int, joint: int) -> str:
        lower, upper = float(arm.limit_lower[joint]), float(arm.limit_upper[joint])
        return (
            f"stands at {_show(arm, joint, float(value[row, joint]))}, "
            f"allowed {_show(arm, joint, lower)} to {_show(arm, joint, upper)}"
        )

    return _find_worst(arm, sequence, "limit", excess, describe)


def _check_rates(arm: Arm, sequence: JointSequence, parameters: CheckParameters) -> list[Finding]:
    """Speeds and steps from one row to the next."""
    step = np.abs(np.diff(sequence.q, axis=0, prepend=sequence.q[:1]))
    speed = step / np.diff(sequence.t, prepend=-1.0)[:, None]
    fastest = arm.max_speed * (1.0 + parameters.speed_tolerance)
    largest = np.where(arm.prismatic, parameters.step_mm / 1e3, np.radians(parameters.step_deg))

    def describe_speed(row: int, joint: int) -> str:
        return (
            f"moves at {_show(arm, joint, float(speed[row, joint]))}/s, "
            f"allowed {_show(arm, joint, float(arm.max_speed[joint]))}/s"
        )

    def describe_step(row: int, joint: int) -> str:
        return (
            f"steps by {_show(arm, joint, float(step[row, joint]))} from the row before, "
            f"allowed {_show(arm, joint, float(largest[joint]))}"
        )

    return [
        *_find_worst(arm, sequence, "speed", speed - fastest, describe_speed),
        *_find_worst(arm, sequence, "step", step - largest, describe_step),
    ]


def _find_worst(
    arm: Arm, sequence: JointSequence, rule: str, excess: Array, describe: Callable[[int, int], str]
) -> list[Finding]:
    """List the joints whose excess (rows, joints) is not at most zero, each by its worst row."""
    broken = ~(excess <= 0.0)
    found = []
    for joint in np.flatnonzero(broken.any(axis=0)).tolist():
        row = int(np.argmax(excess[:, joint]))
        t = float(sequence.t[row])
        text = f"joint {joint + 1} ({arm.joints[joint].name}) {describe(row, joint)}, row {row} at {t:.2f} s"
        found.append(Finding(rule, joint + 1, row, t, int(broken[:, joint].sum()), text))
    return found


def _show(arm: Arm, joint: int, value: float) -> str:
    return f"{value * 1e3:.1f} mm" if arm.prismatic[joint] else f"{np.degrees(value):.2f} deg"
