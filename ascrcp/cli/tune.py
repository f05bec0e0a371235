"""tune: safe small motions over the bus -> control parameters of this machine."""

from pathlib import Path
from typing import Any

import yaml
from msgspec import to_builtins

from ascrcp.app import load_control, load_simulation
from ascrcp.cli.cell import Cell
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.control.config import JointConfig
from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.session.tuning import Tuned, Tuner


def tune(options: Options, output: Output) -> int:
    """Tune the machine and write its control parameters to --out."""
    out: Path = options.out
    if out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{out}: control parameters end in .yaml or .yml")
    if not out.parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")
    arm = load_arm(options.machine)
    control = load_control(arm, options.control)
    with Cell(load_simulation(options.rig).rig, load_arm("kc"), arm, options.seed, options.load_kg) as cell:
        found = Tuner(cell, arm, control).tune(tuning_pose(arm), output.say)
    text = encode_control(found, f"{options.machine}, seed {options.seed}")
    write_atomic(out, lambda file: file.write(text.encode()))
    pictures = []
    if options.steps is not None:
        from ascrcp.cli.tune_picture import draw_steps  # only who wants pictures pays for the import

        pictures = draw_steps(found, options.steps)
    rows = [_row(before, after) for before, after in zip(control.joints, found.control.joints, strict=True)]
    header = ["joint", "full speed up, down", "dead band up, down", "delay", "creep", "piece drive"]
    lines = [
        table(header, rows),
        "",
        f"oil {found.oil_c:.0f} deg C, {found.duration_s:.0f} s of machine time -> {out}",
    ]
    tree = {
        "ok": True,
        "out": str(out),
        "oil_c": found.oil_c,
        "duration_s": found.duration_s,
        "pictures": [str(place) for place in pictures],
        "joints": [_summary(joint) for joint in found.control.joints],
    }
    output.result(tree, "\n".join(lines))
    return OK


def tuning_pose(arm: Arm) -> tuple[float, ...]:
    """Joints in the middle of free space before the machine: stretched forward, room both ways."""
    pose = arm.zero_pose.copy()
    for i, slides in enumerate(arm.prismatic):
        room = arm.upper[i] - arm.lower[i]
        pose[i] = arm.lower[i] + 0.3 * room if slides else pose[i]
    for i in (arm.n - 2, arm.n - 1):
        pose[i] = 0.5 * (arm.lower[i] + arm.upper[i])
    return tuple(pose.tolist())


def encode_control(found: Tuned, where: str) -> str:
    """Write control parameters as a YAML, with where they come from."""
    head = (
        f"# Control parameters found by ascrcp tune ({where}) at {found.oil_c:.1f} deg C of oil.\n"
        "# full_speed, dead_band, delay_s, oil_c and stick_slip are measured; the rest is as it was.\n"
    )
    tree: dict[str, Any] = to_builtins(found.control)
    return head + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, default_flow_style=None)


def _summary(joint: JointConfig) -> dict[str, Any]:
    sticks = joint.controller == "stick_slip"
    return {
        "name": joint.name,
        "unit": joint.unit,
        "full_speed": list(joint.full_speed),
        "dead_band": list(joint.dead_band),
        "delay_s": joint.delay_s,
        "creep": joint.stick_slip.creep if sticks else None,
        "piece_drive": joint.stick_slip.drive if sticks else None,
    }


def _row(before: JointConfig, after: JointConfig) -> list[str]:
    def pair(a: tuple[float, float], b: tuple[float, float], digits: int) -> str:
        return f"{a[0]:.{digits}f}, {a[1]:.{digits}f} -> {b[0]:.{digits}f}, {b[1]:.{digits}f}"

    sticks = after.controller == "stick_slip"
    return [
        f"{after.name} [{after.unit}]",
        pair(before.full_speed, after.full_speed, 1),
        pair(before.dead_band, after.dead_band, 3),
        f"{1e3 * after.delay_s:.0f} ms",
        f"{after.stick_slip.creep:.1f}" if sticks else "-",
        f"{after.stick_slip.drive:.2f}" if sticks else "-",
    ]
