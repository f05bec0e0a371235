"""calibrate: measured tip positions -> a new machine file, with what was found and how sure it is."""

from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.app import load_simulation
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.calibration import Calibrated, Misses, calibrate, load_config
from ascrcp.kinematics.description import find_machine
from ascrcp.kinematics.identifiability import FULL_HOSE_KG
from ascrcp.kinematics.machine_file import encode_machine
from ascrcp.kinematics.observation import read_observations, write_observations
from ascrcp.kinematics.parameter import GROUPS
from ascrcp.simulation.survey import draw_poses, survey_rig

AXES = ("x", "y", "z", "distance")
STAGES = ("before", "after", "held_out")


def calibrate_machine(options: Options, output: Output) -> int:
    """Fit the machine to --data and write it to --out; the old file is never touched."""
    data, out = options.data, options.out
    _check_out(options.machine, data, out)
    arm = load_arm(options.machine)
    if options.simulate is not None:
        _simulate(options, arm, data)
        output.say(f"surveyed {options.simulate} poses of the simulated rig -> {data}")
    groups = tuple(options.fit or GROUPS)
    found = calibrate(arm, read_observations(data, arm), load_config(), groups, tuple(options.hold or ()))
    text = encode_machine(options.machine, data, found)
    write_atomic(out, lambda file: file.write(text))
    output.result(_tree(found, out), _text(found, out))
    return OK


def _check_out(machine: str, data: Path, out: Path) -> None:
    if out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{out}: a machine file ends in .yaml or .yml")
    if out.resolve() in (find_machine(machine).resolve(), data.resolve()):
        raise InputError(f"{out}: is the file calibrated from; give a new one")
    if not out.parent.is_dir():
        raise InputError(f"{out.parent}: no such folder")


def _simulate(options: Options, arm: Arm, data: Path) -> None:
    """Survey the rig (--rig, --seed) in random poses with random payloads into a new file."""
    if data.exists():
        raise InputError(f"{data}: exists already; --simulate writes a new survey")
    rng = np.random.default_rng([options.seed, 2])
    poses = draw_poses(arm, options.simulate, rng)
    payload_kg = np.round(rng.uniform(0.0, FULL_HOSE_KG, len(poses)))
    seen = survey_rig(load_simulation(options.rig).rig, arm, poses, payload_kg, options.seed, rng)
    write_observations(data, arm, seen)


def _misses(found: Calibrated, stage: str) -> dict[str, dict[str, float]]:
    misses: Misses = getattr(found, stage)
    return misses.summary_mm()


def _tree(found: Calibrated, out: Path) -> dict[str, Any]:
    return {
        "ok": True,
        "out": str(out),
        "rows": len(found.after.vector),
        "miss_mm": {stage: _misses(found, stage) for stage in STAGES},
        "changes": [
            {"name": c.name, "unit": c.unit, "before": c.before, "after": c.after, "sigma": c.sigma}
            for c in found.changes
        ],
        "sensor_zero": found.sensor_zero.tolist(),
        "set_aside": [{"line": line, "miss_mm": 1e3 * miss} for line, miss in found.set_aside],
        "held": found.held,
        "noise_ratio": found.noise_ratio,
    }


def _text(found: Calibrated, out: Path) -> str:
    misses = [
        [title, *(f"{_misses(found, stage)[a][k]:.1f}" for a in AXES for k in ("mean", "p95", "max"))]
        for stage, title in zip(STAGES, ("before", "after", "rows not fitted"), strict=True)
    ]
    header = ["miss [mm]", *(f"{a} {k}" for a in AXES for k in ("mean", "p95", "max"))]
    changes = [
        [c.name, f"{c.before:.4f}", f"{c.after:.4f}", f"{c.after - c.before:+.4f}", f"{c.sigma:.4f}", c.unit]
        for c in found.changes
    ]
    lines = [
        table(header, misses),
        "",
        table(["parameter", "before", "after", "change", "1 sigma", "unit"], changes),
        "",
        *(f"line {line} set aside: misses by {1e3 * miss:.0f} mm" for line, miss in found.set_aside),
        *(f"not fitted: {name}: {reason}" for name, reason in found.held.items()),
        f"misses left are {found.noise_ratio:.2f} x the noise assumed in config/calibration.yaml",
        f"-> {out}",
    ]
    return "\n".join(lines)
