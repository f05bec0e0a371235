"""Check a joint sequence against the arm before anything moves (thesis 5.3): JointSequence -> DryRun."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import RefusedError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array, angle_between, unit
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import clearance, least_distance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.planning.parameter import CheckParameters, check_parameters


@dataclass(frozen=True)
class Finding:
    """One rule that rows of the sequence break.

    Attributes:
        rule: "limit", "speed", "step", "clearance", "pose", or "joints" for a sequence of another arm.
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
    """Outcome of the check.

    Attributes:
        findings: By rule and joint; none when the sequence may be run.
        rows: How many rows were checked.
        points: Planned points next to which rows of a stroke break a rule, each with the reason.
    """

    findings: tuple[Finding, ...]
    rows: int
    points: dict[int, str] = field(default_factory=dict)

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


def check_sequence(
    arm: Arm,
    sequence: JointSequence,
    parameters: CheckParameters,
    obstacles: Obstacles | None = None,
    payload_kg: float | None = None,
) -> DryRun:
    """Check every row: ranges, speeds and steps of the joints, the nozzle's pose, clearance.

    Args:
        arm: The arm that would run it.
        sequence: Joints against time.
        parameters: Tolerances and the largest steps.
        obstacles: The surroundings; None leaves the clearance out.
        payload_kg: Concrete in the hose it was solved for [kg]; None leaves the nozzle's pose out.
    """
    p = check_parameters(parameters)
    if sequence.q.shape[1] != arm.n:
        text = f"the sequence has {sequence.q.shape[1]} joints, {arm.name} has {arm.n}"
        return DryRun((Finding("joints", 0, 0, 0.0, len(sequence.t), text),), len(sequence.t))
    broken: dict[int, str] = {}
    findings = (
        *_check_limits(arm, sequence, p, broken),
        *_check_rates(arm, sequence, p, broken),
        *_check_pose(arm, sequence, p, payload_kg, broken),
        *_check_clearance(arm, sequence, obstacles, broken),
    )
    return DryRun(findings, len(sequence.t), _nearest_points(sequence, broken))


def _nearest_points(sequence: JointSequence, broken: dict[int, str]) -> dict[int, str]:
    """Name the planned point nearest in time to each broken row of a stroke; moves have none."""
    at = np.flatnonzero(sequence.point >= 0)
    found: dict[int, str] = {}
    for row, why in broken.items():
        if len(at) and (sequence.spraying[row] or sequence.point[row] >= 0):
            near = at[np.argmin(np.abs(sequence.t[at] - sequence.t[row]))]
            found.setdefault(int(sequence.point[near]), why)
    return found


def _check_pose(
    arm: Arm,
    sequence: JointSequence,
    parameters: CheckParameters,
    payload_kg: float | None,
    broken: dict[int, str],
) -> list[Finding]:
    """Whether the joints bring the nozzle before the wall where it is wanted, sag included."""
    if payload_kg is None:
        return []
    rows = np.flatnonzero(sequence.spraying)
    T = sagged_forward(arm, sequence.q[rows], payload_kg)
    away = 1e3 * np.linalg.norm(T[:, :3, 3] - sequence.position[rows], axis=1)
    turned = np.degrees(angle_between(T[:, :3, 0], unit(sequence.direction[rows])))
    found = []
    for value, allowed, what in ((away, parameters.pose_mm, "mm"), (turned, parameters.pose_deg, "deg")):
        bad = np.flatnonzero(~(value <= allowed))
        if len(bad):
            worst = int(bad[np.argmax(value[bad])])
            text = (
                f"with {payload_kg:g} kg in the hose the nozzle is {value[worst]:.1f} {what} off its planned "
                f"pose, allowed {allowed:g} {what}"
            )
            found.append(_finding(sequence, "pose", rows[bad], int(rows[worst]), text, broken))
    return found


def _check_clearance(
    arm: Arm, sequence: JointSequence, obstacles: Obstacles | None, broken: dict[int, str]
) -> list[Finding]:
    """Whether every row keeps clear, also between planned points."""
    model = arm.description.clearance
    if obstacles is None or model is None:
        return []
    free = least_distance(arm, sequence.q, obstacles)
    least = model.least - model.cell / 2.0  # the field is read to about half a cell
    bad = np.flatnonzero(~(free >= least))
    if not len(bad):
        return []
    worst = int(bad[np.argmin(free[bad])])
    met = clearance(arm, sequence.q[worst], obstacles)
    text = f"{met.describe(arm, 0)}, allowed {least:.2f} m"
    return [_finding(sequence, "clearance", bad, worst, text, broken)]


def _finding(
    sequence: JointSequence,
    rule: str,
    rows: NDArray[np.int64],
    worst: int,
    text: str,
    broken: dict[int, str],
) -> Finding:
    for row in rows.tolist():
        broken.setdefault(row, text)
    t = float(sequence.t[worst])
    return Finding(rule, 0, worst, t, len(rows), f"{text}, row {worst} at {t:.2f} s")


def _check_limits(
    arm: Arm, sequence: JointSequence, parameters: CheckParameters, broken: dict[int, str]
) -> list[Finding]:
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

    return _find_worst(arm, sequence, "limit", excess, describe, broken)


def _check_rates(
    arm: Arm, sequence: JointSequence, parameters: CheckParameters, broken: dict[int, str]
) -> list[Finding]:
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
        *_find_worst(arm, sequence, "speed", speed - fastest, describe_speed, broken),
        *_find_worst(arm, sequence, "step", step - largest, describe_step, broken),
    ]


def _find_worst(
    arm: Arm,
    sequence: JointSequence,
    rule: str,
    excess: Array,
    describe: Callable[[int, int], str],
    broken: dict[int, str],
) -> list[Finding]:
    """List the joints whose excess (rows, joints) is not at most zero, each by its worst row."""
    bad = ~(excess <= 0.0)
    found = []
    for joint in np.flatnonzero(bad.any(axis=0)).tolist():
        row = int(np.argmax(excess[:, joint]))
        t = float(sequence.t[row])
        text = f"joint {joint + 1} ({arm.joints[joint].name}) {describe(row, joint)}"
        for each in np.flatnonzero(bad[:, joint]).tolist():
            broken.setdefault(each, text)
        whole = f"{text}, row {row} at {t:.2f} s"
        found.append(Finding(rule, joint + 1, row, t, int(bad[:, joint].sum()), whole))
    return found


def _show(arm: Arm, joint: int, value: float) -> str:
    return f"{value * 1e3:.1f} mm" if arm.prismatic[joint] else f"{np.degrees(value):.2f} deg"
