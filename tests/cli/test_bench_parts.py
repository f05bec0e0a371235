"""The dense search beside the solver, and the sag calibration of the bench."""

from dataclasses import replace

import numpy as np
import pytest

from ascrcp.cli import bench_calibration
from ascrcp.cli.bench_calibration import measure_calibration
from ascrcp.cli.bench_clearance import find_most_clearance
from ascrcp.cli.bench_path import make_path
from ascrcp.cli.wall_cell import imagine_heading
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.kinematics import load_arm, solve_path
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.workspace import load_config

ARM = load_arm("kc")


def test_the_dense_search_finds_what_solving_finds_and_nothing_out_of_reach():
    surface = imagine_heading(load_profile(CONFIG / "profiles" / "circle-5.9.yaml"), load_config().heading)
    obstacles, path = Obstacles.from_surface(surface, ARM), make_path(110)
    solved = solve_path(ARM, path, ARM.zero_pose, obstacles=obstacles)
    rows = np.flatnonzero(solved.solved)[[3, 40]]
    found = find_most_clearance(ARM, path, rows, obstacles)
    wanted = ARM.description.clearance.wanted
    assert (found >= np.minimum(solved.clearance[rows], wanted) - 0.01).all()
    far = replace(path, position=path.position + np.array([40.0, 0.0, 0.0]))
    assert find_most_clearance(ARM, far, rows[:1], obstacles).tolist() == [-np.inf]


def test_calibration_is_held_to_its_aim(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bench_calibration, "MACHINES", 1)
    (figure,) = measure_calibration("kc", 0, lambda _: None)
    assert figure.is_met and figure.unit == "mm"
    (none,) = measure_calibration("duct", 0, lambda _: None)
    assert none.value is None and "no sag model" in none.note
