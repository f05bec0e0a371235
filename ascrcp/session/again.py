"""The stages of a second spraying, for the compute process: scan it again, measure, plan what is too thin.

A further scan has a folder of its own inside the round. Its surface is the heading as it is now, in the
frame of the first scan, so that solving, loading and moving work on that folder as on any round.
"""

from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import NothingToSprayError, RecognitionError
from ascrcp.core.flow import Label, SprayPath, Surface
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.look import find_look_pose
from ascrcp.perception.crop import crop
from ascrcp.perception.parameter import PerceptionParameters
from ascrcp.perception.registration import register
from ascrcp.perception.survey import load_survey
from ascrcp.perception.voxel import voxel
from ascrcp.perception.writer import write_labelled_cloud
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.prediction import predict
from ascrcp.planning.spray_plan import plan_spray
from ascrcp.planning.table import write_path
from ascrcp.session.achieved import Achieved, carry_labels, measure_achieved
from ascrcp.session.layout_store import find_expected, learn, read_layout, write_layout
from ascrcp.session.outcome import Measured
from ascrcp.session.round import Round
from ascrcp.session.snapshot import WallLayer
from ascrcp.session.stages import Progress, project_scan, quiet
from ascrcp.session.store import (
    read_archive,
    read_scan,
    read_surface,
    write_archive,
    write_json,
    write_surface,
)
from ascrcp.session.surroundings import find_obstacles

_GRIDS = ("after", "layer", "finish")
_WALL = (Label.SPRAYED, Label.BAY, Label.ARCH, Label.OVERBREAK, Label.FACE)


def look_pose(
    folder: Path, machine: str, config: PlanningParameters, progress: Progress = quiet
) -> Array | None:
    """surface.npz of a further scan -> where the lidar looks behind arches (`find_look_pose`) or None.

    Args:
        folder: Folder of the further scan, measured: the wall and what stands before it as they are now.
        machine: Machine name or YAML.
        config: Whether bodies count.
        progress: Called with the fraction done.
    """
    round_, arm = Round(folder), load_arm(machine)
    around = find_obstacles(round_, arm, config)
    progress(0.9)
    return None if around is None else find_look_pose(arm, around, read_surface(round_.surface))


def measure(
    folder: Path,
    first: Path,
    sprayed: Path | None,
    machine: str,
    config: PlanningParameters,
    perception: PerceptionParameters,
    payload_kg: float,
    progress: Progress = quiet,
) -> Measured:
    """scan.npz, look.npz of a further scan -> achieved.npz, achieved.json, surface.npz, cloud.ply beside it.

    Args:
        folder: Folder of the further scan.
        first: Round folder of the first.
        sprayed: Folder of the plan that was driven to its end since the scan before; None if none was.
        machine: Machine name or YAML, for the lidar's place on the arm.
        config: Planner: grid, wanted surface.
        perception: For thinning the cloud.
        payload_kg: Concrete in the hose while scanning, for the sag of the lidar's place [kg].
        progress: Called with the fraction done.

    Raises:
        InputError: A file is missing or damaged.
        RecognitionError: The scans do not show the same wall.
    """
    round_, before = Round(folder), Round(first)
    surface = read_surface(before.need("surface", "recognise"))
    notes: dict[str, object] = {}
    cloud = project_scan(read_scan(round_.need("scan", "scan")), machine, payload_kg, notes)
    points = voxel(crop(cloud.points, surface.profile, perception.crop), perception.voxel)
    behind = None
    if round_.look.exists():
        look = project_scan(read_scan(round_.look), machine, payload_kg, {}).points
        look = voxel(crop(look, surface.profile, perception.crop), perception.voxel)
        behind = _lay_over(points, look, surface, notes)
    progress(0.3)
    layout = read_layout(before.plan, surface)[0] if before.plan.exists() else None
    expected = None if sprayed is None else find_expected(Round(sprayed), surface)
    found = measure_achieved(points, surface, layout, config, load_survey(), expected, behind)
    progress(0.8)
    write_surface(round_.surface, found.surface)
    write_labelled_cloud(round_.cloud, found.surface)
    _write_achieved(round_, found)
    write_json(round_.finish, {**found.figures, **notes})
    progress(1.0)
    target = found.target
    layer = WallLayer(target.station, target.along, found.layer.astype(np.float32), found.figures)
    return Measured(found.surface, layer)


def _lay_over(
    points: NDArray[np.float32],
    look: NDArray[np.float32],
    surface: Surface,
    notes: dict[str, object],
) -> NDArray[np.float32] | None:
    """Lay the scan from further in over the one of the same wall: the boom sags otherwise when drawn out.

    Args:
        points: The scan from the scan pose, base frame [m], shape (n, 3).
        look: The one from further in, shape (k, 3).
        surface: The heading as recognised: tells what is wall, for people and the arm itself move.
        notes: Filled with how well they fit.

    Returns:
        The second moved onto the first, shape (k, 3); None if they do not show the same wall.
    """
    on_wall = [cloud[np.isin(carry_labels(cloud, surface), _WALL)] for cloud in (points, look)]
    try:
        found = register(on_wall[0], on_wall[1], load_survey().registration)
        if not found.converged:
            raise RecognitionError("registration: the two sweeps did not settle on one another")
    except RecognitionError as error:
        notes["look"] = {"residual_mm": None, "reason": str(error)}
        return None
    notes["look"] = {"residual_mm": 1e3 * found.residual, "share": found.share}
    return apply_transform(found.T_first_second, look.astype(float)).astype(np.float32)


def _write_achieved(round_: Round, found: Achieved) -> None:
    arrays = {name: getattr(found, name) for name in _GRIDS}
    arrays |= {"station": found.target.station, "along": found.target.along}
    write_archive(round_.achieved, "achieved", {}, arrays)


def plan_again(
    folder: Path,
    first: Path,
    sprayed: Path | None,
    config: PlanningParameters,
    progress: Progress = quiet,
) -> SprayPath | None:
    """achieved.npz -> path.csv, plan.npz, plan.json beside it, for what is still too thin.

    Args:
        folder: Folder of a further scan that has been measured.
        first: Round folder of the first scan.
        sprayed: Folder of the plan that was driven to its end since the scan before, from which the rebound
            is learned; None if none was.
        config: Planner; what is still too thin is always dosed, whoever planned the first spraying.
        progress: Called with the fraction done.

    Returns:
        The path, None if nothing is left to spray.

    Raises:
        InputError: A file is missing or damaged.
    """
    round_ = Round(folder)
    surface = read_surface(Round(first).need("surface", "recognise"))
    _, arrays = read_archive(round_.need("achieved", "run"), "achieved", _GRIDS)
    round_.forget("path", "plan", "prediction", "joints")
    after, process = arrays["after"], config.process
    if sprayed is not None:
        process = learn(Round(sprayed), surface, after, process)
    progress(0.3)
    try:
        planned = plan_spray(surface, config.path, process, after, lambda done: progress(0.3 + 0.7 * done))
    except NothingToSprayError:
        return None
    predicted = predict(planned, process)
    rebound = msgspec.to_builtins(process.rebound)
    with round_.staged() as new:
        write_path(new.path, planned.path)
        write_layout(new.plan, planned, predicted.finish.value)
        write_json(new.prediction, {"planned": predicted.to_dict(), "again": True, "rebound": rebound})
    return planned.path
