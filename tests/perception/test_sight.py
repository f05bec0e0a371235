"""What was in sight, what closes a tunnel, where the floor lies: the rules that dust, water and mesh try."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_heading import CIRCLE

from ascrcp.core.profile import Profile
from ascrcp.perception.arch_rule import _longest
from ascrcp.perception.ground import find_ground
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.raster import Unrolled, raster_over
from ascrcp.perception.section import find_face
from ascrcp.perception.thickness import _beside_heap, _is_edge
from ascrcp.perception.wall import _share, expected_share

PARAMETERS = load_parameters()


@given(
    st.integers(0, 40),
    st.floats(0.2, 30.0),
    st.floats(0.0, 0.95),
    st.floats(0.001, 0.05),
)
def test_a_share_lies_between_dark_and_whole_and_grows_with_the_count(
    count: int, density: float, whole: float, dark: float
) -> None:
    some, more = (
        float(expected_share(np.array(float(n)), np.array(density), np.array(whole), np.array(dark)))
        for n in (count, count + 1)
    )
    assert 0.0 <= some <= more + 1e-9 and more <= 1.0 + 1e-9


def test_far_more_points_than_expected_make_a_whole_cell() -> None:
    share = expected_share(np.array([500.0]), np.array([1.0]), np.array([0.5]), np.array([0.01]))
    assert share[0] == pytest.approx(1.0, abs=0.05)


def test_shares_are_right_in_the_mean_over_cells_cut_anywhere() -> None:
    rng = np.random.default_rng(4)
    true = np.where(rng.random(200_000) < 0.3, 1.0, rng.random(200_000))
    for density in (1.5, 6.0):
        count = rng.poisson(density * true).astype(float)
        found = expected_share(count, np.full(len(true), density), np.array(0.3), np.array(0.0))
        assert found.mean() == pytest.approx(true.mean(), abs=0.005)
        few = count <= 1
        assert found[few].mean() == pytest.approx(true[few].mean(), abs=0.02)


@pytest.mark.parametrize("mean", [3.0, 5.0])
def test_a_shadow_too_narrow_to_be_bridged_is_dark_and_cells_empty_by_chance_are_not(mean: float) -> None:
    rng = np.random.default_rng(5)
    true = np.ones((60, 240))
    true[20:22, 40:200] = 0.0
    count = rng.poisson(mean * true).astype(float)
    share = _share(count, np.ones(true.shape, dtype=bool), np.zeros(true.shape, dtype=bool))
    assert share[20:22, 40:200].mean() < 0.25
    clear = share[30:, :]
    assert clear.mean() > 0.97 and clear[count[30:, :] > 0].mean() > 0.98


@pytest.mark.parametrize("slope", [-0.03, 0.0, 0.03])
def test_the_floor_is_found_though_water_mirrors_the_wall_below_it(slope: float) -> None:
    rng = np.random.default_rng(1)
    x = rng.uniform(-8, 12, 60_000)
    turn = rng.uniform(np.radians(-18), np.radians(198), len(x))
    y, z = -5.9 * np.cos(turn), 5.9 * np.sin(turn)
    floor = slope * x - 2.0
    wall = np.column_stack([x, y, np.maximum(z, floor)])
    mirrored = np.column_stack([x, y, 2 * floor - np.maximum(z, floor)])[::3]
    dry = np.column_stack([x, rng.uniform(-5.5, 5.5, len(x)), floor])[::2]
    cloud = np.concatenate([wall, mirrored, dry]).astype(np.float32)
    plane = find_ground(cloud, PARAMETERS.ground)
    assert plane is not None
    assert plane[0] == pytest.approx(slope, abs=0.005) and plane[2] == pytest.approx(-2.0, abs=0.06)


def test_dust_all_over_the_section_is_no_face_and_rock_behind_it_is() -> None:
    rng = np.random.default_rng(2)

    def scattered(count: int, first: float, last: float) -> Unrolled:
        r, turn = 5.0 * np.sqrt(rng.random(count)), rng.uniform(-0.3, np.pi + 0.3, count)
        yz = np.column_stack([-r * np.cos(turn), r * np.sin(turn)])
        along, offset = CIRCLE.locate(yz)
        return Unrolled(rng.uniform(first, last, count), along, offset, yz, np.ones(count, dtype=bool))

    def both(a: Unrolled, b: Unrolled) -> Unrolled:
        return Unrolled(
            *(
                np.concatenate([getattr(a, n), getattr(b, n)])
                for n in ("station", "along", "offset", "yz", "beside")
            )
        )

    dust = scattered(6000, 8.0, 14.0)
    assert find_face(dust, CIRCLE, PARAMETERS.section) is None
    face = find_face(both(dust, scattered(20_000, 12.9, 13.1)), CIRCLE, PARAMETERS.section)
    assert face == pytest.approx(13.0, abs=0.05)


def test_half_a_slice_may_be_missing_from_an_arch_but_not_two_in_a_row() -> None:
    def flags(text: str) -> list[bool]:
        return [c == "#" for c in text]

    assert _longest(flags("..###.####..")) == 7
    assert _longest(flags("..###..####.")) == 4
    assert _longest(flags("##.##.##")) == 4  # one gap is forgiven, not every second one
    assert _longest([]) == 0


def test_no_layer_is_told_on_steep_edges_and_beside_a_heap() -> None:
    profile: Profile = CIRCLE
    raster = raster_over(0.0, 1.0, 0.05, 0.05, profile)
    grid = np.full(raster.shape, 0.02)
    grid[:, 100:] = 0.30
    edge = _is_edge(grid, raster)
    assert edge[:, 99:101].all() and not edge[:, :98].any() and not edge[:, 103:].any()
    heap = np.full(raster.shape, 0.02)
    heap[10:, :5] = -0.50
    beside = _beside_heap(heap, raster, profile)
    assert beside[10:, :12].all() and not beside[:10].any() and not beside[:, 20:].any()
