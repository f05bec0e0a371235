"""ascrcp muck: depth of muck on the invert -> scoops, their joints and how long it takes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.cli.folder import check_folder, write_folder
from ascrcp.cli.muck_picture import draw_muck
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.workspace import find_extremes
from ascrcp.planning.muck import MuckParameters, count_scoops, cut_slices, find_volume, load_muck_parameters
from ascrcp.planning.muck_path import Scoop, find_cover, plan_muck

MACHINE = "muck"
CLIMBS = 12
COVER_STEP_DEG = 5.0


@dataclass(frozen=True)
class MuckJob:
    """The job and what the arm can do at all.

    Attributes:
        volume_m3: To remove.
        scoops: Every cycle, in order.
        depth_m: Greatest depth of the lip below the base's origin, exact.
        cover_deg: How far up the invert the lip reaches on either side.
    """

    volume_m3: float
    scoops: tuple[Scoop, ...]
    depth_m: float
    cover_deg: float

    @property
    def total_s(self) -> float:
        """Duration of all cycles [s]."""
        return sum(scoop.cycle_s for scoop in self.scoops)


def solve_muck(arm: Arm, parameters: MuckParameters, seed: int, output: Output) -> MuckJob:
    """Plan the job and measure the workspace."""
    angles = cut_slices(parameters, count_scoops(parameters))
    scoops = plan_muck(arm, parameters, angles.tolist(), output.bar("scoops"))
    depth = find_extremes(arm, CLIMBS, np.random.default_rng(seed))["z_max"].value
    cover = np.degrees(find_cover(arm, parameters, np.radians(COVER_STEP_DEG)))
    return MuckJob(find_volume(parameters), scoops, depth, float(cover))


def muck(options: Options, output: Output) -> int:
    """Plan the scooping job; write joints.csv, muck.png and muck.json."""
    check_folder(options.out)
    changed = {"muck_depth_m": options.depth, "muck_length_m": options.length}
    given = {name: value for name, value in changed.items() if value is not None}
    parameters = load_muck_parameters(**given)
    arm = load_arm(MACHINE)
    job = solve_muck(arm, parameters, options.seed, output)
    tree = {"ok": True, "out": str(options.out), **job_tree(job, parameters)}
    picture = draw_muck(arm, parameters, job.scoops)
    files = {"joints.csv": _encode(arm, job.scoops), "muck.png": picture}
    write_folder(options.out, files, "muck.json", tree)
    output.result(tree, _text(job, parameters, options.out))
    return OK


def job_tree(job: MuckJob, parameters: MuckParameters) -> dict[str, Any]:
    """Return the job's figures for JSON."""
    cycles = [scoop.cycle_s for scoop in job.scoops]
    return {
        "volume_m3": job.volume_m3,
        "scoops": len(job.scoops),
        "cycle_s": {"mean": float(np.mean(cycles)), "min": min(cycles), "max": max(cycles)},
        "total_min": job.total_s / 60.0,
        "limit_min": parameters.time_limit_min,
        "within_limit": job.total_s / 60.0 <= parameters.time_limit_min,
        "clearance_min_m": min(scoop.clearance for scoop in job.scoops),
        "lip_to_wall_min_m": min(scoop.floor for scoop in job.scoops),
        "full_bucket_steepest_deg": float(np.degrees(max(scoop.steepest for scoop in job.scoops))),
        "depth_max_m": job.depth_m,
        "cover_deg": job.cover_deg,
        "cycles": [
            {
                "angle_deg": float(np.degrees(scoop.postures.angle)),
                **{f"{leg.name}_s": float(leg.t[-1]) for leg in scoop.legs},
                "tip_s": scoop.tip_s,
                "travel": scoop.postures.travel,
            }
            for scoop in job.scoops
        ],
    }


def _text(job: MuckJob, parameters: MuckParameters, out: Path) -> str:
    rows = [
        [
            f"{number} at {np.degrees(scoop.postures.angle):+.1f} deg",
            *(f"{leg.t[-1]:.1f}" for leg in scoop.legs),
            f"{scoop.tip_s:.1f}",
            f"{scoop.cycle_s:.1f}",
            f"{1e3 * scoop.clearance:.0f}",
        ]
        for number, scoop in enumerate(job.scoops, start=1)
    ]
    head = ["scoop", "dig [s]", "carry [s]", "return [s]", "tip [s]", "cycle [s]", "clearance [mm]"]
    cycle = job.total_s / len(job.scoops)
    met = "within" if job.total_s / 60.0 <= parameters.time_limit_min else "OVER"
    return "\n".join(
        [
            table(head, rows),
            f"{job.volume_m3:.4f} m3 in {len(job.scoops)} scoops of {parameters.bucket_m3:g} m3, "
            f"{cycle:.1f} s each: {job.total_s / 60.0:.1f} min, {met} {parameters.time_limit_min:g} min",
            f"greatest depth {1e3 * job.depth_m:.1f} mm; invert covered to +-{job.cover_deg:.0f} deg "
            f"(wanted {parameters.cover_deg:g})",
            f"-> {out}/joints.csv",
        ]
    )


def _encode(arm: Arm, scoops: Sequence[Scoop]) -> bytes:
    """Write every row of the job; the clock runs on while the hand tips."""
    units = np.where(arm.prismatic, 1.0, 180.0 / np.pi)
    names = [f"q{joint.number}_{'m' if joint.prismatic else 'deg'}" for joint in arm.joints]
    lines = [",".join(["t_s", "scoop", "leg", *names])]
    clock = 0.0
    for number, scoop in enumerate(scoops, start=1):
        for leg in scoop.legs:
            for t, q in zip(leg.t + clock, leg.q * units, strict=True):
                lines.append(f"{t:.3f},{number},{leg.name}," + ",".join(f"{x:.5f}" for x in q))
            clock += float(leg.t[-1]) + (scoop.tip_s if leg.name == "carry" else 0.0)
    return ("\n".join(lines) + "\n").encode()
