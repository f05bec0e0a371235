"""The stages that make a round ready for the stick: its plan as a mesh, what a jog keeps clear of."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.steer_plan import SteerPlan, build_steer_plan
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.table import read_joints, read_path
from ascrcp.session.round import Round
from ascrcp.session.surroundings import find_obstacles

ROUNDING_M = 0.01
"""The mesh lies between the planned points; so much less clearance than theirs is let pass [m]."""


def prepare_plan(
    folder: Path,
    machine: str,
    planning: PlanningParameters,
    config: SteerConfig,
    payload_kg: float,
    progress: Callable[[float], None] = lambda done: None,
) -> SteerPlan:
    """path.csv, joints.csv, surface.npz -> the surface the stick moves on; for the compute process.

    Raises:
        InputError: A file is missing or damaged, or nothing can be steered.
    """
    round_ = Round(folder)
    arm = load_arm(machine)
    path = read_path(round_.need("path", "plan"))
    sequence = read_joints(round_.need("joints", "solve"))
    around = find_obstacles(round_, arm, planning)
    model = arm.description.clearance
    progress(0.5)
    clear = None
    if around is not None and model is not None:
        least = model.least - ROUNDING_M

        def clear(q: Array) -> Any:
            return least_distance(arm, q, around) >= least

    plan = build_steer_plan(arm, path, sequence, config, payload_kg, clear)
    progress(1.0)
    return plan


def prepare_obstacles(
    folder: Path,
    machine: str,
    planning: PlanningParameters,
    progress: Callable[[float], None] = lambda done: None,
) -> Obstacles | None:
    """surface.npz -> what a jog keeps clear of, None without a scan; for the compute process."""
    return find_obstacles(Round(folder), load_arm(machine), planning)
