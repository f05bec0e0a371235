"""The stages of the job as commands: options -> files in the round folder and one JSON object."""

from typing import Any

import numpy as np

from ascrcp.app import find_profile, load_simulation
from ascrcp.cli.drive import app_options
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.planning.parameter import load_parameters as load_planning
from ascrcp.planning.target import LEFT_TEXT
from ascrcp.session import stages
from ascrcp.session.report import build_report
from ascrcp.session.round import Round
from ascrcp.session.store import read_json


def recognise(options: Options, output: Output) -> int:
    """Cloud or scan -> features.json and the labelled cloud."""
    given = options.input or options.cloud
    target = options.out or options.round
    if target is None:
        raise InputError("recognise needs --out DIR or --round DIR")
    if given is None and options.round is None:
        raise InputError("recognise needs a CLOUD file, or --round DIR with a scan")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: not a folder")
    profile = find_profile(app_options(options, True), load_simulation(options.rig).tunnel)
    round_ = Round(target)
    with round_.lock_if_there():
        surface = stages.recognise(
            target,
            given,
            options.machine,
            profile,
            load_perception(),
            options.load_kg,
            options.shift,
            progress=output.bar("recognise"),
        )
        features = read_json(round_.features)
    lines = [f"axis sigma {surface.axis.direction_sigma_deg:.3f} deg from {', '.join(surface.axis.evidence)}"]
    lines += [f"arch at {a['station']:.3f} m, lean {a['lean_deg']:+.2f} deg" for a in features["arches"]]
    lines += [
        f"overbreak {o.station[0]:.2f}..{o.station[1]:.2f} m, {o.angle_deg[0]:.0f}..{o.angle_deg[1]:.0f} deg:"
        f" {o.volume_m3:.3f} m3, {o.max_depth_m:.2f} m deep"
        for o in surface.overbreak
    ]
    output.result({"ok": True, "out": str(target), **features}, "\n".join([*lines, f"-> {round_.features}"]))
    return OK


def plan(options: Options, output: Output) -> int:
    """Recognised round -> path.csv, and what it is predicted to come to."""
    config = load_planning(planner=options.planner)
    round_ = Round(options.round)
    with round_.lock_if_there():
        path = stages.plan(options.round, config, options.after, progress=output.bar("plan"))
    tree: dict[str, Any] = {"ok": True, "path": str(round_.path), "points": len(path)}
    lines = [f"{len(path)} points -> {round_.path}"]
    if round_.prediction.exists():
        tree["prediction"] = read_json(round_.prediction)["planned"]
        lines += describe_prediction(tree["prediction"])
    output.result(tree, "\n".join(lines))
    return OK


def describe_prediction(found: dict[str, Any]) -> list[str]:
    """Say what a plan will come to, and what it leaves out."""
    return [
        f"predicted: {100 * found['within_tolerance']:.1f} % of {found['area_m2']:.1f} m2 within tolerance, "
        f"deviation {found['finish_std_mm']:.1f} mm, at most {found['thinnest_mm']:.0f} mm too thin",
        f"concrete: {found['pumped_m3']:.2f} m3 pumped for {found['wanted_m3']:.2f} m3, rebound "
        f"{100 * found['rebound']:.0f} %, {found['duration_s'] / 60:.0f} min"
        + ("" if found.get("with_moves", True) else " at least; ramps and moves come on top: solve"),
        *(
            f"left out: {area:.1f} m2, {LEFT_TEXT.get(reason, reason)}"
            for reason, area in found["left_out_m2"].items()
        ),
    ]


def solve(options: Options, output: Output) -> int:
    """Path -> joints.csv."""
    round_ = Round(options.round)
    with round_.lock_if_there():
        found = stages.solve(
            options.round, options.machine, load_planning(), options.load_kg, progress=output.bar("solve")
        )
    unsolved = [
        {"point": i + 1, "reason": reason} for i, reason in enumerate(found.reasons) if reason is not None
    ]
    place = round_.joints
    tree: dict[str, Any] = {
        "ok": True,
        "joints": str(place),
        "solved": int(found.solved.sum()),
        "unsolved": unsolved,
        "duration_s": found.duration_s,
        "tilted": int((found.tilt[found.solved] > 0.0).sum()),
        "clearance_min_m": _least(found.clearance[found.solved]),
        "clearance_moves_min_m": found.move_clearance,
    }
    lines = [f"point {row['point']}: {row['reason']}" for row in unsolved]
    lines.append(
        f"{tree['solved']} of {len(found.solved)} points solved, {found.duration_s:.0f} s -> {place}"
    )
    if round_.prediction.exists():
        tree["prediction"] = read_json(round_.prediction)["driven"]
        lines += describe_prediction(tree["prediction"])
    output.result(tree, "\n".join(lines))
    return OK


def _least(clearances: Array) -> float | None:
    """Least of the known values [m]; None if none is."""
    known = clearances[np.isfinite(clearances)]
    return float(known.min()) if known.size else None


def report(options: Options, output: Output) -> int:
    """Build the report of a round."""
    if not options.round.is_dir():
        raise InputError(f"{options.round}: no such round folder")
    with Round(options.round).lock():
        place = build_report(options.round, progress=output.bar("report"))
    output.result({"ok": True, "report": str(place)}, str(place))
    return OK
