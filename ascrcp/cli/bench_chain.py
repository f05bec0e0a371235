"""From a cloud of three million points to joints: recognise, plan and solve, as the application runs them."""

import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ascrcp.cli.bench import Figure, Say
from ascrcp.kinematics.arm import load_arm
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.planning.parameter import load_parameters
from ascrcp.session.compute import Compute
from ascrcp.session.outcome import Solution
from ascrcp.session.remote import Remote
from ascrcp.simulation.variety import Sample, draw_sample, load_variety

BEAMS = 3.15
"""Cast for three million echoes [millions]."""

HEADINGS = 5

ASKED_S = 5.0
"""On two cores; about 120 s in the thesis."""


def measure_chain(machine: str, seed: int, say: Say) -> list[Figure]:
    """Time the three stages in the compute process, files and the way to and fro included.

    Args:
        machine: Name of the arm.
        seed: Of the first heading; the others follow it.
        say: Takes progress.
    """
    description = load_arm(machine).description
    if description.path is None or description.clearance is None or description.lidar is None:
        return [
            Figure("recognise + plan + solve", None, "s", note=f"machine {machine} does not spray by a scan")
        ]
    variety = load_variety()
    taken: list[list[float]] = []
    points = solved = planned = 0
    compute = Compute()
    compute.start()
    try:
        for number in range(HEADINGS):
            sample = draw_sample(variety, variety.kinds[0], seed + number, (BEAMS, BEAMS))
            points += len(sample.cloud.points)
            seconds, found = _run(compute, sample, machine)
            taken.append(seconds)
            solved, planned = solved + int(found.solved.sum()), planned + len(found.solved)
            say(f"bench: heading {number + 1} of {HEADINGS}: {sum(seconds):.1f} s to joints")
    finally:
        compute.close()
    whole = [sum(seconds) for seconds in taken]
    one, two, three = np.median(taken, axis=0).tolist()
    return [
        Figure(
            "recognise + plan + solve",
            median(whole),
            "s",
            ASKED_S,
            note=f"{one:.2f} + {two:.2f} + {three:.2f}, wall clock, median of {HEADINGS} headings, longest "
            f"{max(whole):.1f}; {points / HEADINGS / 1e6:.2f} M points, {solved} of {planned} points solved",
        ),
        Figure(
            "the thesis's about 120 s over it", 120.0 / median(whole), "x", note="its computer is not named"
        ),
    ]


def _run(compute: Compute, sample: Sample, machine: str) -> tuple[list[float], Solution]:
    """Take a cloud to joints; how long each stage took [s], and what came of the last."""
    planning = load_parameters()
    with tempfile.TemporaryDirectory() as place:
        cloud, folder = Path(place) / "cloud.ply", Path(place) / "round"
        _write_ply(cloud, sample.cloud.points)
        marks = [time.perf_counter()]
        compute.run(Remote.RECOGNISE, folder, cloud, machine, sample.heading.truth.profile, load_perception())
        marks.append(time.perf_counter())
        compute.run(Remote.PLAN, folder, planning)
        marks.append(time.perf_counter())
        found: Solution = compute.run(Remote.SOLVE, folder, machine, planning, 0.0)
        marks.append(time.perf_counter())
    return np.diff(marks).tolist(), found


def _write_ply(file: Path, points: NDArray[np.float32]) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file.write_bytes(head.encode() + points.astype("<f4").tobytes())
