"""Two scans of one wall: registered within millimetres, a layer between them measured per square metre."""

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest
from synthetic_heading import Heading, Recipe

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Cloud, Surface
from ascrcp.core.geometry import Array, angle_between, apply_transform, rotation, transform
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.recognise import recognise
from ascrcp.perception.registration import Registration, register
from ascrcp.perception.survey import load_survey
from ascrcp.perception.thickness import mean_per_block, measure_thickness, stable_points

PARAMETERS = load_survey()
LAYER = 0.08
CELLS = msgspec.structs.replace(PARAMETERS.thickness, cell=0.1)  # for the few points of a quick test
# the machine was parked anew: the second scan's frame in the first's
T_FIRST_SECOND = transform(
    rotation("z", 0.012) @ rotation("y", -0.006) @ rotation("x", 0.008), np.array([0.12, -0.08, 0.05])
)


class Sprayed(Heading):
    """A heading on whose unsprayed part a layer may lie."""

    layer = 0.0

    def wall(self, s: Array, along: Array) -> Array:
        wall = super().wall(s, along)
        return np.where((s > self.s0) & (s < self.s1), wall - self.layer, wall)


@dataclass
class Pair:
    first: np.ndarray
    second: np.ndarray
    surface: Surface
    found: Registration


@pytest.fixture(scope="module")
def pair() -> Pair:
    heading = Sprayed(Recipe(seed=6, rays=260_000))
    first = heading.cast()
    heading.layer, heading.rng = LAYER, np.random.default_rng(99)
    second = heading.cast()
    T = T_FIRST_SECOND
    moved = ((second - T[:3, 3]) @ T[:3, :3]).astype(np.float32)
    surface = recognise(Cloud(first), heading.profile, load_parameters())
    again = recognise(Cloud(moved), heading.profile, load_parameters())
    found = register(stable_points(surface), stable_points(again), PARAMETERS.registration)
    return Pair(first, moved, surface, found)


def test_two_scans_of_one_wall_agree_within_three_millimetres(pair: Pair) -> None:
    T = pair.found.T_first_second
    points = pair.second[:: len(pair.second) // 2000]
    away = np.linalg.norm(apply_transform(T, points) - apply_transform(T_FIRST_SECOND, points), axis=1)
    assert away.mean() < 0.003
    for axis in np.eye(3):
        assert angle_between(T[:3, :3] @ axis, T_FIRST_SECOND[:3, :3] @ axis) < np.radians(0.03)
    assert pair.found.converged and pair.found.share > 0.5 and pair.found.residual < 0.01


def test_a_layer_is_measured_on_every_square_metre(pair: Pair) -> None:
    second = apply_transform(pair.found.T_first_second, pair.second).astype(np.float32)
    found = measure_thickness(pair.first, second, pair.surface, CELLS)
    column = float(found.along[1] - found.along[0])
    blocks = mean_per_block(found.thickness, found.sprayed, CELLS.cell, column)
    blocks = blocks[~np.isnan(blocks)]
    assert len(blocks) > 20
    assert np.abs(blocks - LAYER).max() < 0.005
    assert found.mean == pytest.approx(LAYER, abs=0.002)
    assert found.volume == pytest.approx(found.area * LAYER, rel=0.05)
    assert abs(found.bias) < 0.003 and found.noise_floor < 0.012 and found.noise_floor_m2 < 0.004
    assert np.nanmedian(found.sigma) == pytest.approx(found.noise_floor, rel=0.7)


def test_a_scan_beside_itself_has_no_thickness(pair: Pair) -> None:
    found = measure_thickness(pair.first, pair.first, pair.surface, CELLS)
    assert np.nanmax(np.abs(found.thickness)) == 0.0 and found.mean == 0.0 and found.bias == 0.0


def test_blocks_average_and_leave_out_what_is_hardly_measured() -> None:
    grid = np.arange(1600.0).reshape(40, 40)
    mask = np.ones((40, 40), dtype=bool)
    mask[20:, 25:] = False
    blocks = mean_per_block(grid, mask, 0.05, 0.05)
    assert blocks.shape == (2, 2)
    assert blocks[0, 0] == grid[:20, :20].mean() and np.isnan(blocks[1, 1])


def test_other_walls_and_open_directions_are_refused(pair: Pair) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(RecognitionError, match="registration"):
        register(pair.first, pair.first + np.float32([0.0, 40.0, 0.0]), PARAMETERS.registration)
    with pytest.raises(RecognitionError, match="too few points"):
        register(pair.first, pair.first[:50], PARAMETERS.registration)
    plane = np.column_stack([rng.uniform(0, 10, (20_000, 2)), np.zeros(20_000)]).astype(np.float32)
    with pytest.raises(RecognitionError, match="direction open"):
        register(plane, plane, PARAMETERS.registration)
    behind = pair.first[pair.first[:, 0] < 6.0]
    with pytest.raises(RecognitionError, match="thickness"):
        measure_thickness(pair.first, behind, pair.surface, CELLS)
