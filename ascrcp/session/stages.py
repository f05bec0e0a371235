"""The stages of a round as functions of the compute process: read the round folder, write it back.

Each is one arrow of design.md section 2 with its files around it; the session and the command line
run the very same functions.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ascrcp.control.config import ControlConfig
from ascrcp.control.move import check_ends, find_changeover, plan_move
from ascrcp.core.errors import InputError, RecognitionError
from ascrcp.core.file import make_folder
from ascrcp.core.flow import Cloud, JointSequence, Scan, SprayPath, Surface
from ascrcp.core.geometry import apply_transform
from ascrcp.core.profile import Profile
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.path import solve_path
from ascrcp.kinematics.route import find_route
from ascrcp.kinematics.sag import sagged_forward, sagged_lidar
from ascrcp.perception.alignment import align
from ascrcp.perception.features import build_features
from ascrcp.perception.parameter import PerceptionParameters
from ascrcp.perception.project import project
from ascrcp.perception.reader import read_cloud
from ascrcp.perception.recognise import recognise as recognise_cloud
from ascrcp.perception.registration import register
from ascrcp.perception.survey import load_survey
from ascrcp.perception.thickness import stable_points
from ascrcp.perception.writer import write_labelled_cloud
from ascrcp.planning.dryrun import check_sequence
from ascrcp.planning.mend import time_and_mend
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.path import plan as plan_path
from ascrcp.planning.prediction import predict
from ascrcp.planning.pump import fill_flow
from ascrcp.planning.spray_plan import plan_spray, replan
from ascrcp.planning.table import read_joints, read_path, write_joints, write_path
from ascrcp.session.achieved import Achieved, measure_achieved
from ascrcp.session.layout_store import find_expected, layout_of, learn, write_layout
from ascrcp.session.outcome import Loaded, Solution
from ascrcp.session.round import Round
from ascrcp.session.store import read_json, read_scan, read_surface, write_json, write_surface
from ascrcp.session.surroundings import find_obstacles

Progress = Callable[[float], None]


def quiet(fraction: float) -> None:
    """Progress nobody wants."""


def recognise(
    folder: Path,
    cloud_file: Path | None,
    machine: str,
    profile: Profile,
    parameters: PerceptionParameters,
    payload_kg: float = 0.0,
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
    progress: Progress = quiet,
) -> Surface:
    """Scan or cloud file -> surface.npz, features.json, cloud.ply in the folder.

    Args:
        folder: Round folder.
        cloud_file: A cloud in the base frame, or None for the folder's scan.
        machine: Machine name or YAML, for the lidar's place on the arm.
        profile: Design profile.
        parameters: Of recognition.
        payload_kg: Concrete in the hose while scanning, for the sag of the lidar's place [kg].
        shift: Taken off a cloud file's coordinates, for one in a surveyor's frame [m].
        progress: Called with the fraction done.

    Raises:
        InputError: Nothing readable, or no tunnel in it; nothing is written then.
    """
    round_ = Round(folder)
    notes: dict[str, Any] = {}
    if cloud_file is not None:
        cloud = read_cloud(cloud_file, shift)
    else:
        cloud = project_scan(read_scan(round_.need("scan", "scan")), machine, payload_kg, notes)
    progress(0.2)
    timing: dict[str, float] = {}
    surface = recognise_cloud(
        cloud, profile, parameters, progress=lambda _, done: progress(0.2 + 0.7 * done), timing=timing
    )
    make_folder(folder)
    round_.forget("now", "path", "plan", "prediction", "joints")  # planned on another surface
    write_surface(round_.surface, surface)
    write_labelled_cloud(round_.cloud, surface)
    write_json(round_.features, {**build_features(surface, len(cloud.points), timing), **notes})
    return surface


def project_scan(scan: Scan, machine: str, payload_kg: float, notes: dict[str, Any]) -> Cloud:
    """Align the pan head to the lance it sees (thesis 3.2), then carry the points into the base frame.

    Args:
        scan: Raw scan.
        machine: Machine name or YAML, for the lidar's place on the arm.
        payload_kg: Concrete in the hose while scanning, for the sag of that place [kg].
        notes: Filled with what the alignment found.
    """
    zero = 0.0
    try:
        found = align(scan, load_survey().alignment)
    except RecognitionError as error:
        notes["alignment"] = {"pan_zero_deg": None, "reason": str(error)}
    else:
        zero = found.pan_zero
        notes["alignment"] = {
            "pan_zero_deg": math.degrees(zero),
            "sigma_deg": math.degrees(found.sigma),
            "residual_mm": 1e3 * found.residual,
        }
    return project(scan, sagged_lidar(load_arm(machine), scan.q, payload_kg), zero)


def plan(
    folder: Path,
    config: PlanningParameters,
    after: Path | None = None,
    progress: Progress = quiet,
) -> SprayPath:
    """surface.npz -> path.csv, plan.npz, plan.json; with `after` surface-now.npz too.

    Args:
        folder: Round folder.
        config: Planner, distances and the spraying process.
        after: A second scan of the heading, as a recognised round folder or a cloud in the base frame of a
            machine that has not moved: only what is still too thin is planned. The rebound is learned if
            the folder's result tells that its plan was driven to its end.
        progress: Called with the fraction done.

    Raises:
        InputError: Nothing recognised, nothing to spray, or nothing left to spray.
    """
    round_ = Round(folder)
    surface = read_surface(round_.need("surface", "recognise"))
    if config.planner == "thesis":
        if after is not None:
            raise InputError("a plan after a second scan needs the planner coverage, not thesis")
        path = plan_path(surface, config.path, progress=progress)
        path = replace(path, flow=np.full(len(path), config.process.spray.pump_steps[1]))
        with round_.staged("now", "plan", "prediction", "joints") as new:
            write_path(new.path, path)
        round_.leave_rescans()
        return path
    process, found = config.process, None
    if after is not None:
        sprayed = round_ if round_.was_run() else None
        found = _measure_after(surface, config, after, sprayed)
        process = process if sprayed is None else learn(sprayed, surface, found.after, process)
    planned = plan_spray(surface, config.path, process, None if found is None else found.after, progress)
    predicted = predict(planned, process)
    rebound = msgspec.to_builtins(process.rebound)
    told = {"planned": predicted.to_dict(), "again": found is not None, "rebound": rebound}
    with round_.staged("now", "joints") as new:
        write_path(new.path, planned.path)
        write_layout(new.plan, planned, predicted.finish.value)
        write_json(new.prediction, told)
        if found is not None:
            write_surface(new.now, found.surface)
    round_.leave_rescans()
    return planned.path


def _measure_after(
    surface: Surface, config: PlanningParameters, after: Path, sprayed: Round | None
) -> Achieved:
    """Read a second scan, lay it over the first and measure what was laid (`measure_achieved`).

    Args:
        surface: The heading as recognised before spraying.
        config: For the grid.
        after: Recognised round folder, or a cloud in the base frame of the first scan.
        sprayed: Folder of the plan that was driven since the first scan; None if none is known to be.

    Raises:
        InputError: Nothing readable, or a scan that does not fit the first one.
    """
    survey = load_survey()
    if after.is_dir():
        second = read_surface(Round(after).need("surface", "recognise"))
        points = second.points
    else:
        second, points = None, read_cloud(after).points
    expected = None if sprayed is None else find_expected(sprayed, surface)
    try:
        if second is not None:  # the machine may have moved: by what was recognised anew
            moved = register(stable_points(surface), stable_points(second), survey.registration)
            points = apply_transform(moved.T_first_second, points.astype(float)).astype(np.float32)
        return measure_achieved(points, surface, None, config, survey, expected)
    except RecognitionError as error:
        raise InputError(f"{after}: {error}; is it of this heading, in the base frame?") from error


def solve(
    folder: Path, machine: str, config: PlanningParameters, payload_kg: float, progress: Progress = quiet
) -> Solution:
    """path.csv and surface.npz -> joints.csv, clear of what the scan saw.

    The path stays as planned; where poses had to be tilted, the joints' file holds them as driven.

    Raises:
        InputError: Nothing planned, or a damaged file.
        UnreachableError: Not one point can be sprayed.
    """
    round_ = Round(folder)
    arm = load_arm(machine)
    path = read_path(round_.need("path", "plan"))
    surface = read_surface(round_.need("surface", "recognise"))
    layout = layout_of(round_, path, surface)
    around = find_obstacles(round_, arm, config)
    progress(0.1)
    found = solve_path(
        arm,
        path,
        arm.zero_pose,
        payload_kg=payload_kg,
        progress=lambda done: progress(0.1 + 0.75 * done),
        obstacles=around,
    )
    planned = None if layout is None else replan(layout, surface, found.path, found.solved, config.process)
    driven = found.path if planned is None else planned.path
    mended = time_and_mend(
        arm,
        driven,
        found.q,
        found.break_before,
        config,
        around,
        payload_kg,
        progress=lambda done: progress(0.85 + 0.13 * done),
    )
    sequence = fill_flow(mended.timed.sequence, driven, config.process.spray)
    mended.run.require()
    with round_.staged("trace", "result") as new:  # of the sequence before
        write_joints(new.joints, sequence, arm.prismatic)
        if planned is not None:
            predicted = predict(planned, config.process, sequence)
            told = read_json(round_.prediction) if round_.prediction.exists() else {}
            write_layout(new.plan, planned, predicted.finish.value)
            write_json(new.prediction, {**told, "driven": predicted.to_dict()})
    late = [mended.replaced.get(i, why) for i, why in enumerate(mended.timed.reasons)]
    reasons = tuple(a or b for a, b in zip(found.reasons, late, strict=True))
    return Solution(
        solved=np.array([reason is None for reason in reasons]),
        reasons=reasons,
        duration_s=sequence.duration,
        tilt=found.tilt,
        clearance=found.clearance,
        move_clearance=_move_clearance(arm, sequence, around),
    )


def _move_clearance(arm: Arm, sequence: JointSequence, obstacles: Obstacles | None) -> float | None:
    between = sequence.q[~sequence.spraying & (sequence.point < 0)]
    if obstacles is None or not len(between):
        return None
    return float(least_distance(arm, between, obstacles).min())


def approach(
    folder: Path,
    machine: str,
    config: PlanningParameters,
    control: ControlConfig,
    payload_kg: float,
    q_from: Sequence[float],
    q_to: Sequence[float],
    progress: Progress = quiet,
) -> JointSequence:
    """Plan a move from pose to pose, clear of what the round's scan saw if there is one.

    Args:
        folder: Round folder.
        machine: Machine name or YAML.
        config: Whether bodies count.
        control: Speeds and coupling rule of moves.
        payload_kg: Concrete in the hose [kg], for the nozzle's pose.
        q_from: Joints as measured [rad, m].
        q_to: Joints where the move ends.
        progress: Called with the fraction done.

    Raises:
        InputError: A joint vector that is not finite or has the wrong length.
        UnreachableError: A target outside the limits, or no way found that keeps clear; the message says
            what would be hit.
    """
    arm = load_arm(machine)
    mover = SaggedArm(arm, payload_kg)
    start, end = check_ends(mover, q_from, q_to)
    between = find_changeover(mover, start, end, control)
    around = find_obstacles(Round(folder), arm, config)
    progress(0.5)
    if around is not None:
        between = list(find_route(arm, start, end, around, between))
    progress(1.0)
    return plan_move(mover, start.tolist(), end.tolist(), control, between)


class SaggedArm:
    """The arm as a move sees it: its nozzle where gravity takes it."""

    def __init__(self, arm: Arm, payload_kg: float) -> None:
        self.max_speed, self.max_acceleration, self.max_jerk = (
            arm.max_speed,
            arm.max_acceleration,
            arm.max_jerk,
        )
        self.within_limits = arm.within_limits
        self.forward = lambda q: sagged_forward(arm, q, payload_kg)


def load(folder: Path, machine: str, config: PlanningParameters, progress: Progress = quiet) -> Loaded:
    """joints.csv -> a sequence checked whole against the arm and the heading of the folder (thesis 5.3).

    For which load it was solved is not checked: the hose fills and empties.

    Args:
        folder: Round folder.
        machine: Machine name or YAML.
        config: What the check lets pass, and whether bodies count.
        progress: Called with the fraction done.

    Raises:
        InputError: A damaged file, or joints of another path than the folder's.
        RefusedError: A row that breaks a limit or comes too near to something.
    """
    round_, arm = Round(folder), load_arm(machine)
    sequence = read_joints(round_.need("joints", "solve"))
    planned = len(read_path(round_.path)) if round_.path.exists() else int((sequence.point >= 0).sum())
    if round_.path.exists() and sequence.point.max(initial=-1) >= planned:
        raise InputError(
            f"{round_.joints}: names point {sequence.point.max() + 1}, the path has {planned}; "
            "run `ascrcp solve` on this round again"
        )
    progress(0.3)
    around = find_obstacles(round_, arm, config)
    progress(0.6)
    check_sequence(arm, sequence, config.check, around).require()
    return Loaded(sequence, planned)
