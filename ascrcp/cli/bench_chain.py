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
from ascrcp.simulation.variety import draw_sample, load_variety

BEAMS = 3.15
"""Cast for three million echoes [millions]."""

REPEATS = 3

ASKED_S = 5.0
"""On two cores; about 120 s in the thesis."""


def measure_chain(machine: str, seed: int, say: Say) -> list[Figure]:
    """Time the three stages in the compute process, files and the way to and fro included.

    Args:
        machine: Name of the arm.
        seed: Of the heading.
        say: Takes progress.
    """
    description = load_arm(machine).description
    if description.path is None or description.clearance is None or description.lidar is None:
        return [
            Figure("recognise + plan + solve", None, "s", note=f"machine {machine} does not spray by a scan")
        ]
    say(f"bench: scanning {BEAMS:g} million beams")
    variety = load_variety()
    sample = draw_sample(variety, variety.kinds[0], seed, (BEAMS, BEAMS))
    profile, planning = sample.heading.truth.profile, load_parameters()
    taken: list[list[float]] = []
    compute = Compute()
    compute.start()
    try:
        with tempfile.TemporaryDirectory() as place:
            cloud, folder = Path(place) / "cloud.ply", Path(place) / "round"
            _write_ply(cloud, sample.cloud.points)
            for number in range(REPEATS):
                say(f"bench: recognise, plan and solve, {number + 1} of {REPEATS}")
                marks = [time.perf_counter()]
                compute.run(Remote.RECOGNISE, folder, cloud, machine, profile, load_perception())
                marks.append(time.perf_counter())
                compute.run(Remote.PLAN, folder, planning)
                marks.append(time.perf_counter())
                found: Solution = compute.run(Remote.SOLVE, folder, machine, planning, 0.0)
                marks.append(time.perf_counter())
                taken.append(np.diff(marks).tolist())
    finally:
        compute.close()
    whole = median(map(sum, taken))
    one, two, three = np.median(taken, axis=0).tolist()
    return [
        Figure(
            "recognise + plan + solve",
            whole,
            "s",
            ASKED_S,
            note=f"{one:.2f} + {two:.2f} + {three:.2f}; {len(sample.cloud.points) / 1e6:.2f} M points, "
            f"{int(found.solved.sum())} of {len(found.solved)} solved; wall clock, median of {REPEATS}",
        ),
        Figure("the thesis's about 120 s over it", 120.0 / whole, "x", note="its computer is not named"),
    ]


def _write_ply(file: Path, points: NDArray[np.float32]) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file.write_bytes(head.encode() + points.astype("<f4").tobytes())
