"""The reach map of a round knows the scan's obstacles, and its picture bears a rough wall."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ascrcp.cli.parser import Options
from ascrcp.cli.wall_cell import WallCells, imagine_heading, lay_cells
from ascrcp.cli.workspace import _find_blocked
from ascrcp.cli.workspace_picture import draw_reach
from ascrcp.core.flow import Label, Surface
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.reach import ReachMap, find_reach
from ascrcp.kinematics.workspace import load_config
from ascrcp.planning.parameter import load_parameters
from ascrcp.session.round import Round
from ascrcp.session.store import write_surface

ARM = load_arm("kc")
FACE = 10.5
"""Station of a face that stands in the middle of what is to be sprayed [m]."""


def heading(face: bool) -> Surface:
    bare = imagine_heading(load_profile(CONFIG / "profiles" / "circle-5.9.yaml"), load_config().heading)
    y, z = np.random.default_rng(0).uniform(-6.0, 6.0, (2, 20000))
    points = np.column_stack([np.full(20000, FACE), y, z]).astype(np.float32)
    return replace(bare, points=points, labels=np.full(len(points), Label.FACE, np.uint8)) if face else bare


def map_of(surface: Surface) -> tuple[WallCells, ReachMap]:
    config = load_config()
    cells = lay_cells(surface, load_parameters().path, 0.8)
    return cells, find_reach(ARM, cells.T, config.reach)


def blocked_of(folder: Path, face: bool) -> tuple[WallCells, ReachMap, np.ndarray]:
    surface = heading(face)
    folder.mkdir()
    write_surface(Round(folder).surface, surface)
    cells, reach = map_of(surface)
    blocked = _find_blocked(Options(round=folder, load_kg=0.0), ARM, cells, reach)
    assert blocked is not None
    return cells, reach, blocked


def test_cells_beyond_the_face_are_blocked_and_none_far_before_it(tmp_path: Path):
    assert not blocked_of(tmp_path / "free", False)[2].any()
    cells, reach, blocked = blocked_of(tmp_path / "face", True)
    within, station = cells.asked & reach.reachable, cells.path.station
    assert blocked[within & (station > FACE + 0.2)].all()
    assert not blocked[station < FACE - 1.0].any()
    assert not (blocked & ~reach.reachable).any()
    assert draw_reach(ARM, cells, reach, blocked).startswith(b"\x89PNG")


def test_without_a_round_nothing_is_known_of_obstacles():
    cells, reach = map_of(heading(False))
    assert _find_blocked(Options(round=None), ARM, cells, reach) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_rough_wall_is_drawn_without_a_warning(seed: int):
    bare = heading(False)
    rough = np.random.default_rng(seed).normal(0.0, 0.15, bare.offset.shape).astype(np.float32)
    cells, reach = map_of(replace(bare, offset=rough))
    assert (np.diff(cells.arc_angle) > 0.0).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        draw_reach(ARM, cells, reach, np.ones(len(cells.T), dtype=bool))
