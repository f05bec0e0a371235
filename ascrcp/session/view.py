"""Build the screen's snapshot: CycleOutput and the job's state -> Snapshot."""

import math
from dataclasses import replace

import numpy as np

from ascrcp.core.geometry import angle_between
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
    following = track.state == "follow"
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
