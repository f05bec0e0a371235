"""The stages plan and solve on a round folder: doses go with the path into the joints, and come back."""

from pathlib import Path

import numpy as np
import pytest
from planning_heading import heading

from ascrcp.core.errors import InputError
from ascrcp.planning.parameter import Parameters, change, load_parameters
from ascrcp.planning.spray_plan import plan_spray
from ascrcp.planning.table import read_joints, read_path
from ascrcp.session import stages
from ascrcp.session.layout_store import read_layout
from ascrcp.session.round import Round
from ascrcp.session.store import read_json, write_archive, write_surface

CONFIG = load_parameters()
SURFACE = heading(
    unsprayed=(10.2, 11.0), arches=(), pockets=((10.6, 90.0, 0.3, 0.25),), floor_z=-1.9, yaw_deg=1.0
)
THESIS: Parameters = change(CONFIG, planner="thesis")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("round")
    write_surface(Round(place).surface, SURFACE)
    return place


def test_plan_and_solve_carry_the_dose_into_the_joints(folder: Path) -> None:
    seen: list[float] = []
    path = stages.plan(folder, CONFIG, progress=seen.append)
    round_ = Round(folder)
    assert seen[-1] == 1.0 and len(read_path(round_.path)) == len(path)
    layout, growth, finish = read_layout(round_.plan, SURFACE)
    direct = plan_spray(SURFACE, CONFIG.path, CONFIG.process)
    np.testing.assert_array_equal(layout.lines.nozzle, direct.lines.nozzle)
    np.testing.assert_array_equal(layout.target.left, direct.target.left)
    np.testing.assert_allclose(growth, direct.growth)
    assert np.isfinite(finish).any() and not layout.again
    solution = stages.solve(folder, "kc", CONFIG, 0.0)
    assert solution.solved.mean() > 0.95
    sequence = read_joints(round_.joints)
    on = sequence.flow[sequence.flow > 0.0]
    assert on.min() >= CONFIG.process.spray.pump_least and (sequence.flow[~sequence.spraying] == 0.0).all()
    tree = read_json(round_.prediction)
    assert tree["planned"]["within_tolerance"] > 0.95 and tree["driven"]["within_tolerance"] > 0.9
    assert tree["driven"]["pumped_m3"] == pytest.approx(
        float((sequence.flow[:-1] * np.diff(sequence.t)).sum()) * CONFIG.process.spray.pump_m3_s, rel=0.02
    )
    assert tree["driven"]["duration_s"] == pytest.approx(sequence.duration)


@pytest.mark.parametrize("config", [CONFIG, THESIS])
def test_a_new_plan_leaves_no_joints_of_the_old_one_to_run(folder: Path, config: Parameters) -> None:
    joints = Round(folder).joints
    joints.touch()
    stages.plan(folder, config)
    assert not joints.exists()


def test_the_thesis_planner_keeps_speed_and_flow_constant(folder: Path) -> None:
    path = stages.plan(folder, THESIS)
    assert (path.speed == 0.0).all() and (path.flow == CONFIG.process.spray.pump_steps[1]).all()
    assert not Round(folder).plan.exists() and not Round(folder).prediction.exists()
    assert set(np.round(np.degrees(path.theta2))) == {90}
    stages.solve(folder, "kc", THESIS, 0.0)
    sequence = read_joints(Round(folder).joints)
    assert set(np.unique(sequence.flow)) <= {0.0, CONFIG.process.spray.pump_steps[1]}
    with pytest.raises(InputError, match="needs the planner coverage"):
        stages.plan(folder, THESIS, folder)


def test_a_plan_of_another_path_is_refused(folder: Path) -> None:
    stages.plan(folder, CONFIG)
    kept = Round(folder).plan.read_bytes()
    stages.plan(folder, THESIS)
    Round(folder).plan.write_bytes(kept)
    with pytest.raises(InputError, match="belongs to another path"):
        stages.solve(folder, "kc", CONFIG, 0.0)
    Round(folder).prediction.write_text("{}")
    Round(folder).plan.unlink()
    with pytest.raises(InputError, match=r"plan\.npz: not there"):
        stages.solve(folder, "kc", CONFIG, 0.0)
    Round(folder).plan.write_bytes(kept[: len(kept) // 2])
    with pytest.raises(InputError, match=r"plan\.npz"):
        stages.solve(folder, "kc", CONFIG, 0.0)


def test_a_plan_that_does_not_tell_its_rebound_is_refused(folder: Path, tmp_path: Path) -> None:
    """As one planned before the rebound was learned."""
    stages.plan(folder, CONFIG)
    with np.load(Round(folder).plan) as archive:
        arrays = {name: archive[name] for name in archive.files if name != "head"}
    old = tmp_path / "plan.npz"
    write_archive(old, "plan", {"again": False}, arrays)
    with pytest.raises(InputError, match=r"plan\.npz: rebound: .*run `ascrcp plan` on this round again"):
        read_layout(old, SURFACE)
