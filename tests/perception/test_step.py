"""Single steps of the chain: properties that hold for any cloud."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic_heading import CIRCLE, three_centre

from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.file import write_atomic
from ascrcp.core.flow import Arch, Axis, Scan, Surface
from ascrcp.core.geometry import rotation, transform
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Profile, load_profile
from ascrcp.perception.arch_rule import stretch
from ascrcp.perception.bay import find_bays
from ascrcp.perception.fill import bridge, bulge, extend
from ascrcp.perception.ground import find_ground, is_ground
from ascrcp.perception.parameter import PerceptionParameters, load_parameters
from ascrcp.perception.project import project
from ascrcp.perception.raster import raster_over, unroll
from ascrcp.perception.reader import read_cloud
from ascrcp.perception.voxel import first_of_each, voxel
from ascrcp.perception.wall import density_of_full
from ascrcp.perception.writer import write_labelled_cloud

RNG = np.random.default_rng(0)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(1, 3000), size=st.floats(0.01, 2.0), seed=st.integers(0, 100))
def test_voxel_keeps_at_least_one_point_of_every_voxel(n: int, size: float, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-3, 3, (n, 3)).astype(np.float32)
    keep = first_of_each(points, size)
    cell = ((points - points.min(axis=0)) * np.float32(1.0 / size)).astype(int)
    whole = {tuple(c) for c in cell}
    assert {tuple(c) for c in cell[keep]} == whole
    assert (np.diff(keep) > 0).all()
    assert len(whole) <= len(keep) <= 1.02 * len(whole) + 2


def test_voxel_in_two_threads_still_sees_every_voxel_and_repeats() -> None:
    points = np.random.default_rng(4).uniform(-3, 3, (500_000, 3)).astype(np.float32)
    keep = first_of_each(points, 0.1)
    cell = ((points - points.min(axis=0)) * np.float32(1.0 / 0.1)).astype(int)
    key = cell @ [10_000, 100, 1]
    whole = len(np.unique(key))
    assert len(np.unique(key[keep])) == whole <= len(keep) <= 1.02 * whole
    assert np.array_equal(keep, first_of_each(points, 0.1))


def test_voxel_grows_until_few_enough_are_left() -> None:
    points = RNG.uniform(-5, 5, (60_000, 3)).astype(np.float32)
    parameters = load_parameters().voxel
    few = type(parameters)(size=0.025, max_points=20_000)
    assert 5_000 < len(voxel(points, few)) <= 20_000


@pytest.mark.parametrize("slope", [-0.05, 0.0, 0.05])
def test_ground_is_found_under_grade_and_left_alone_under_a_vault(slope: float) -> None:
    floor = np.column_stack([RNG.uniform(-5, 15, 20_000), RNG.uniform(-5, 5, 20_000), np.zeros(20_000)])
    floor[:, 2] = -3.0 + slope * floor[:, 0] + 0.01 * RNG.standard_normal(len(floor))
    a = RNG.uniform(0, np.pi, 20_000)
    vault = np.column_stack([RNG.uniform(-5, 15, 20_000), -5.9 * np.cos(a), 5.9 * np.sin(a)])
    parameters = load_parameters().ground
    both = np.concatenate([floor, vault]).astype(np.float32)
    plane = find_ground(both, parameters)
    assert plane is not None
    assert plane == pytest.approx([slope, 0.0, -3.0], abs=0.02)
    mask = is_ground(both, plane, parameters.clearance)
    assert mask[:20_000].all() and not mask[20_000:][vault[:, 2] > 1.0].any()
    assert find_ground(vault.astype(np.float32), parameters) is None


@settings(max_examples=50, deadline=None)
@given(count=arrays(np.int64, st.integers(1, 40), elements=st.integers(0, 5)), data=st.data())
def test_stretch_is_the_longest_with_the_share(count: np.ndarray, data: st.DataObject) -> None:
    inside = np.array([data.draw(st.integers(0, int(c))) for c in count])
    share = 0.8
    _, _, length = stretch(inside.astype(float), count.astype(float), share)
    seen = count > 0
    hit = (inside >= share * count)[seen]
    best = max(
        (
            j - i
            for i in range(len(hit))
            for j in range(i + 1, len(hit) + 1)
            if hit[i:j].mean() >= share - 1e-12
        ),
        default=0,
    )
    assert length == best


@settings(max_examples=50, deadline=None)
@given(arrays(np.float64, (12, 5), elements=st.floats(-1, 1) | st.just(float("nan"))), st.integers(0, 5))
def test_bridge_fills_only_short_gaps_between_values(grid: np.ndarray, longest: int) -> None:
    out = bridge(grid, 0, longest)
    known = ~np.isnan(grid)
    assert np.array_equal(out[known], grid[known])
    for column in range(grid.shape[1]):
        places = np.flatnonzero(known[:, column])
        for row in np.flatnonzero(~known[:, column]):
            before, after = places[places < row], places[places > row]
            short = len(before) and len(after) and after[0] - before[-1] - 1 <= longest
            assert bool(short) == (not np.isnan(out[row, column]))
    assert np.isnan(extend(np.full((4, 2), np.nan), 3)).all()


@pytest.mark.parametrize("profile", [CIRCLE, three_centre()], ids=lambda p: p.name)
def test_unroll_undoes_the_profile(profile: Profile) -> None:
    direction = rotation("z", 0.1) @ rotation("y", -0.04) @ np.array([1.0, 0, 0])
    point = np.array([0.0, 0.5, -1.5])
    axis = Axis(point - direction * (point @ direction), direction)
    along = RNG.uniform(0.3, profile.length - 0.3, 500)
    station, offset = RNG.uniform(-3, 12, 500), RNG.uniform(-0.3, 0.6, 500)
    local = np.column_stack([station, profile.point(along, offset)])
    T = axis.T_base_tunnel
    flat = unroll((local @ T[:3, :3].T + T[:3, 3]).astype(np.float32), axis, profile)
    assert flat.station == pytest.approx(station, abs=1e-5)
    assert flat.offset == pytest.approx(offset, abs=1e-5)
    assert flat.along == pytest.approx(along, abs=1e-4)


def test_raster_counts_every_point_once_and_none_outside() -> None:
    raster = raster_over(2.0, 5.0, 0.05, 0.05, CIRCLE)
    station, along = RNG.uniform(1, 6, 1000), RNG.uniform(0, CIRCLE.length, 1000)
    count = raster.total(raster.index(station, along))
    inside = (station >= 2.0) & (station < 2.0 + raster.shape[0] * 0.05)
    assert count.shape == raster.shape and count.sum() == inside.sum()


def test_bays_beyond_the_ends_are_left_out() -> None:
    arches = (Arch(10.0, 0.2, 0.0, (0, 180)), Arch(11.0, 0.2, 0.0, (0, 180)))
    bays = find_bays(arches, (10.05, 13.0))
    assert np.array([b.station for b in bays]) == pytest.approx(np.array([[10.1, 10.9], [11.1, 13.0]]))
    assert [(b.arch_before, b.arch_after) for b in bays] == [(0, 1), (1, None)]
    assert find_bays((), (3.0, 3.0)) == ()


def test_project_carries_echoes_through_pan_and_mount() -> None:
    beam, pan = np.linspace(-0.7, 3.5, 60), np.linspace(-1.5, 1.5, 40)
    ranges = RNG.uniform(1, 10, (40, 60)).astype(np.float32)
    ranges[3, 7] = np.nan
    T = transform(rotation("z", 0.3) @ rotation("y", 0.2), np.array([9.75, -0.2, 0.3]))
    scan = Scan(ranges, beam, pan, np.zeros(8))
    points = project(scan, T, pan_zero=0.05).points
    assert len(points) == 40 * 60 - 1
    ray = T[:3, :3] @ rotation("z", pan[0] - 0.05) @ np.array([np.cos(beam[5]), 0.0, np.sin(beam[5])])
    assert points[5] == pytest.approx(T[:3, 3] + ranges[0, 5] * ray, abs=1e-5)


def test_project_refuses_an_empty_scan_and_a_bad_mount() -> None:
    empty = Scan(np.full((2, 3), np.nan, np.float32), np.zeros(3), np.zeros(2), np.zeros(8))
    with pytest.raises(InputError, match="no echo"):
        project(empty, np.eye(4))
    with pytest.raises(InputError, match="rotation"):
        project(empty, np.diag([2.0, 1, 1, 1]))
    with pytest.raises(InputError, match="pan_zero"):
        project(empty, np.eye(4), float("nan"))


def test_labelled_cloud_is_read_back_by_our_reader(tmp_path: Path) -> None:
    points = RNG.uniform(-5, 5, (50, 3)).astype(np.float32)
    surface = Surface(
        Axis(np.zeros(3), np.array([1.0, 0, 0])), CIRCLE, (0.0, 1.0), (), (), (),
        np.arange(2.0), np.arange(3.0),
        np.zeros((2, 3), np.float32), np.zeros((2, 3), bool), points, RNG.integers(0, 7, 50).astype(np.uint8),
    )  # fmt: skip
    path = tmp_path / "cloud.ply"
    write_labelled_cloud(path, surface)
    np.testing.assert_array_equal(read_cloud(path).points, points)
    assert [p.name for p in tmp_path.iterdir()] == ["cloud.ply"]


def test_nothing_is_left_behind_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_atomic(tmp_path / "no" / "cloud.ply", lambda file: file.write(b"x"))
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_atomic(tmp_path / "taken", lambda file: file.write(b"x"))
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


def test_settings_out_of_bounds_are_refused_by_name() -> None:
    tree = read_yaml(CONFIG / "perception.yaml")
    tree["arch"]["share"] = 1.5
    with pytest.raises(ConfigError, match="share"):
        convert(tree, PerceptionParameters, "perception.yaml")


@pytest.mark.parametrize("path", sorted((CONFIG / "profiles").glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_profiles_load(path: Path) -> None:
    profile = load_profile(path)
    assert profile.name == path.stem
    along = np.linspace(0.1, profile.length - 0.1, 50)
    back, offset = profile.locate(profile.point(along))
    assert back == pytest.approx(along, abs=1e-6) and offset == pytest.approx(np.zeros(50), abs=1e-9)


@given(st.floats(0.2, 0.6), st.floats(-0.3, 0.3), st.integers(8, 16))
def test_a_shadow_goes_on_at_the_slopes_of_its_rims(deep: float, slope: float, dark: int) -> None:
    row = np.arange(40.0)
    rock = deep * (1.0 - ((row - 20.0) / 15.0) ** 2) + slope * row / 40.0
    mean = rock.copy()
    mean[20 - dark // 2 : 20 + dark // 2] = np.nan
    straight, full = bridge(mean[:, None], 0, 24)[:, 0], bulge(mean[:, None], 24)[:, 0]
    assert (full >= straight - 1e-12).all() and np.isfinite(full).all()
    assert np.abs(full - rock).sum() < 0.8 * np.abs(straight - rock).sum()


@given(st.floats(0.5, 20.0))
def test_density_is_found_from_the_cells_that_hold_points(density: float) -> None:
    mean = density / -np.expm1(-density)
    assert abs(float(density_of_full(np.array(mean))) / density - 1.0) < 0.03
