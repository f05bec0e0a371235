"""The stages of a round as functions of the compute process: read the round folder, write it back.

Each is one arrow of design.md section 2 with its files around it; the session and the command line
run the very same functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Cloud, JointSequence, SprayPath, Surface
from ascrcp.core.profile import Profile
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.path import solve_path
from ascrcp.kinematics.sag import sagged_lidar
from ascrcp.perception.features import build_features
from ascrcp.perception.parameter import PerceptionParameters
from ascrcp.perception.project import project
from ascrcp.perception.reader import read_cloud
from ascrcp.perception.recognise import recognise as recognise_cloud
from ascrcp.perception.writer import write_labelled_cloud
from ascrcp.planning.dryrun import check_sequence
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.path import plan as plan_path
from ascrcp.planning.table import read_joints, read_path, write_joints, write_path
from ascrcp.planning.timing import time_sequence
from ascrcp.session.round import Round
from ascrcp.session.store import read_scan, read_surface, write_json, write_surface

Progress = Callable[[float], None]


def _quiet(fraction: float) -> None:
    """Progress nobody wants."""


def recognise(
    folder: Path,
    cloud_file: Path | None,
    machine: str,
    profile: Profile,
    parameters: PerceptionParameters,
    payload_kg: float = 0.0,
    progress: Progress = _quiet,
) -> Surface:
    """Scan or cloud file -> surface.npz, features.json, cloud.ply in the folder.

    Args:
        folder: Round folder.
        cloud_file: A cloud in the base frame, or None for the folder's scan.
        machine: Machine name or YAML, for the lidar's place on the arm.
        profile: Design profile.
        parameters: Of recognition.
        payload_kg: Concrete in the hose while scanning, for the sag of the lidar's place [kg].
        progress: Called with the fraction done.

    Raises:
        InputError: Nothing readable, or no tunnel in it; nothing is written then.
    """
    round_ = Round(folder)
    cloud = read_cloud(cloud_file) if cloud_file is not None else _projected(round_, machine, payload_kg)
    progress(0.2)
    timing: dict[str, float] = {}
    surface = recognise_cloud(
        cloud, profile, parameters, progress=lambda _, done: progress(0.2 + 0.7 * done), timing=timing
    )
    folder.mkdir(parents=True, exist_ok=True)
    write_surface(round_.surface, surface)
    write_labelled_cloud(round_.cloud, surface)
    write_json(round_.features, build_features(surface, len(cloud.points), timing))
    return surface


def _projected(round_: Round, machine: str, payload_kg: float) -> Cloud:
    scan = read_scan(round_.need("scan", "scan"))
    return project(scan, sagged_lidar(load_arm(machine), scan.q, payload_kg))


def plan(folder: Path, config: PlanningParameters, progress: Progress = _quiet) -> SprayPath:
    """surface.npz -> path.csv."""
    round_ = Round(folder)
    path = plan_path(read_surface(round_.need("surface", "recognise")), config.path, progress=progress)
    write_path(round_.path, path, config.timing.nozzle_speed_m_s)
    return path


@dataclass(frozen=True)
class Solution:
    """Outcome of `solve`: which points have joints, and why the others have none."""

    solved: NDArray[np.bool_]
    reasons: tuple[str | None, ...]
    duration_s: float


def solve(
    folder: Path, machine: str, config: PlanningParameters, payload_kg: float, progress: Progress = _quiet
) -> Solution:
    """path.csv -> joints.csv."""
    round_ = Round(folder)
    arm = load_arm(machine)
    path = read_path(round_.need("path", "plan"))
    found = solve_path(arm, path, arm.zero_pose, payload_kg=payload_kg, progress=lambda f: progress(0.85 * f))
    sequence = time_sequence(arm, path, found.q, found.break_before, config.timing)
    check_sequence(arm, sequence, config.check).require()
    write_joints(round_.joints, sequence, arm.prismatic)
    return Solution(found.solved, found.reasons, sequence.duration)


@dataclass(frozen=True)
class Loaded:
    """A checked sequence and the number of points that were planned, solved or not."""

    sequence: JointSequence
    planned: int


def load(folder: Path, machine: str, config: PlanningParameters, progress: Progress = _quiet) -> Loaded:
    """joints.csv -> a sequence checked whole against the arm (thesis 5.3)."""
    round_ = Round(folder)
    sequence = read_joints(round_.need("joints", "solve"))
    progress(0.6)
    check_sequence(load_arm(machine), sequence, config.check).require()
    planned = len(read_path(round_.path)) if round_.path.exists() else int((sequence.point >= 0).sum())
    return Loaded(sequence, planned)
