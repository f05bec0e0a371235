"""Build the screen's snapshot: CycleOutput and the job's state -> Snapshot."""

import math
from dataclasses import replace

import numpy as np

from ascrcp.core.geometry import angle_between
from ascrcp.safety.gate import GateState
from ascrcp.session.cycle import CycleOutput
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Step


def add_machine(general: Snapshot, output: CycleOutput) -> Snapshot:
    """Add what one control cycle saw and did to a snapshot of the job.

    Args:
        general: The job; its `reached` and `skipped` count the runs before this one.
        output: The newest cycle.
    """
    track, inputs, verdict = output.track, output.inputs, output.verdict
    following = track.state == "follow" or output.steer is not None
    running = following and general.job.active is Step.RUN
    shown = replace(
        general,
        reaction=verdict.reaction,
        causes=verdict.causes,
        estop=inputs.estop,
        q=inputs.q,
        q_target=track.q_ref if following else (math.nan,) * len(inputs.q),
        drive=verdict.command.drive,
        age_ms=tuple(age * 1e-6 for age in inputs.age_ns),
        point=track.point if running else -1,
        reached=general.reached + (track.reached if running else 0),
        skipped=general.skipped + (track.skipped if running else 0),
        spraying=verdict.command.pump > 0.0,
        oil_temp_c=inputs.oil_temp_c,
        inputs=inputs,
        stick=output.stick,
        steer=output.steer,
        armed=verdict.state is GateState.ARMED,
        active_causes=verdict.active,
        pump=verdict.command.pump,
    )
    if output.tip is None:
        return shown
    tip, direction = output.tip[:3, 3], output.tip[:3, 0]
    x, y, z = tip.tolist()
    dx, dy, dz = direction.tolist()
    shown = replace(shown, tip=(x, y, z), tip_direction=(dx, dy, dz))
    if not following:
        return shown
    tx, ty, tz = track.position.tolist()
    return replace(
        shown,
        tip_target=(tx, ty, tz),
        tip_error_mm=1e3 * float(np.linalg.norm(tip - track.position)),
        tip_error_deg=math.degrees(float(angle_between(direction, track.direction))),
    )


LEAST_WALL_S = 1.0
"""Wall time after which a speed is shown [s]."""

LEAST_SHARE = 0.05
"""Share done from which the rest is estimated."""


def estimate_remaining(output: CycleOutput | None, progress: float, elapsed_s: float) -> float:
    """Estimate the time a step still needs [s], NaN if unknown.

    Args:
        output: The newest cycle: a sequence that is followed knows.
        progress: Share of the step done.
        elapsed_s: Wall time it has taken, NaN at rest.
    """
    if output is not None and output.track.state == "follow" and output.steer is None:
        return output.track.remaining_s
    if not elapsed_s >= 0.0 or progress < LEAST_SHARE:
        return math.nan
    return elapsed_s * (1.0 / progress - 1.0)


def estimate_factor(machine_s: float, wall_s: float) -> float:
    """Return machine time per wall time since the active step began, NaN at rest or too early."""
    return machine_s / wall_s if wall_s >= LEAST_WALL_S else math.nan
