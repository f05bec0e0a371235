"""Run tracker and gate on the test plant, cycle by cycle, and measure the plant's true nozzle."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from plant import Plant

from ascrcp.control.config import ControlConfig
from ascrcp.control.tracker import Tracker, TrackerOutput
from ascrcp.core.config import load
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import angle_between
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import Arm
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.gate import Gate, GateState
from ascrcp.safety.limit import Limits

CONTROL = load(CONFIG / "control" / "kc.yaml", ControlConfig)
SAFETY = load(CONFIG / "safety.yaml", SafetyConfig)


@dataclass
class Result:
    """What a run showed; errors every cycle of spraying, and at each planned point as it is passed."""

    out: TrackerOutput
    mm: list[float] = field(default_factory=list)
    deg: list[float] = field(default_factory=list)
    point_mm: list[float] = field(default_factory=list)
    point_deg: list[float] = field(default_factory=list)
    drives: list[tuple[float, ...]] = field(default_factory=list)
    causes: list[tuple[str, ...]] = field(default_factory=list)
    cycles: int = 0


def run(
    arm: Arm,
    plant: Plant,
    sequence: JointSequence,
    meddle: Callable[[int, Plant, Tracker], None] | None = None,
    max_s: float = 400.0,
) -> Result:
    """Reset, start, follow to the end; `meddle` may disturb the plant or the tracker every cycle."""
    tracker = Tracker(arm, CONTROL)
    gate = Gate(Limits.of_arm(arm.joints, arm.max_speed), SAFETY)
    rest = tracker.update(plant.inputs())
    for reset in (False, True):
        plant.step(gate.check(plant.inputs(), rest.command, reset=reset).command)
    tracker.follow(sequence)
    result = Result(rest)
    point = 0
    for k in range(int(max_s * 50)):
        if meddle is not None:
            meddle(k, plant, tracker)
        inputs = plant.inputs()
        out = tracker.update(inputs)
        error = out.error_q if out.state == "follow" else None
        verdict = gate.check(inputs, out.command, start=k == 0, error_q=error)
        T = arm.forward(plant.q)
        mm = float(np.linalg.norm(T[:3, 3] - out.position)) * 1e3
        deg = float(np.degrees(angle_between(T[:3, 0], out.direction)))
        if out.spraying:
            result.mm.append(mm)
            result.deg.append(deg)
        if out.point != point and out.state == "follow":
            result.point_mm.append(mm)
            result.point_deg.append(deg)
            point = out.point
        result.drives.append(verdict.command.drive)
        if verdict.causes:
            result.causes.append(verdict.causes)
        plant.step(verdict.command)
        result.out, result.cycles = out, k + 1
        if out.state != "follow" or verdict.state is GateState.STOPPED:
            break
    return result
