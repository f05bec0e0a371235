import dataclasses

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_heading import heading, profile
from scipy.spatial import cKDTree

from ascrcp.core.errors import CancelledError, ConfigError, InputError
from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import apply_transform, inverse_transform, rotation
from ascrcp.planning.parameter import PlanningParameters, load_parameters
from ascrcp.planning.path import plan

DEFAULT = load_parameters().path


def changed(**values: float | None) -> PlanningParameters:
    return msgspec.structs.replace(DEFAULT, **values)


def in_tunnel(surface: Surface, path: SprayPath) -> np.ndarray:
    return apply_transform(inverse_transform(surface.axis.T_base_tunnel), path.position)


def local_direction(surface: Surface, path: SprayPath) -> np.ndarray:
    return path.direction @ surface.axis.T_base_tunnel[:3, :3]


headings = st.builds(
    heading,
    seed=st.integers(0, 50),
    arches=st.sampled_from([(), (11.7,), (11.2, 12.18), (10.5, 11.5, 12.5)]),
    yaw_deg=st.floats(-5, 5),
    grade_deg=st.floats(-3, 3),
    holes=st.sampled_from([0.0, 0.05, 0.2]),
)


@given(headings)
@settings(max_examples=15, deadline=None)
def test_stand_off_is_one_metre_along_the_spray_direction(surface: Surface) -> None:
    path = plan(surface, DEFAULT)
    hit = in_tunnel(surface, path) + 1.0 * local_direction(surface, path)
    _, offset = profile().locate(hit[:, 1:])
    np.testing.assert_allclose(hit[:, 0], path.station, atol=1e-9)
    # the mean wall of these headings is 50 mm outside the design line; roughness averages out
    assert abs(np.median(offset) - 0.05) < 0.01
    assert np.quantile(np.abs(offset - 0.05), 0.95) < 0.05


def test_stand_off_meets_a_smooth_wall_within_20_mm() -> None:
    surface = heading(roughness=1e-6, holes=0.2)
    path = plan(surface, DEFAULT)
    hit = in_tunnel(surface, path) + 1.0 * local_direction(surface, path)
    np.testing.assert_allclose(np.hypot(hit[:, 1], hit[:, 2]), 5.95, atol=0.02)


@given(headings)
@settings(max_examples=15, deadline=None)
def test_direction_is_the_tilted_normal(surface: Surface) -> None:
    path = plan(surface, DEFAULT)
    d = local_direction(surface, path)
    outward = np.column_stack([-np.cos(path.angle), np.sin(path.angle)])
    wanted = np.column_stack([np.cos(path.theta2), np.sin(path.theta2)[:, None] * outward])
    angle = np.degrees(np.arccos(np.clip((d * wanted).sum(-1), -1, 1)))
    assert np.quantile(angle, 0.99) < 5.0 and np.median(angle) < 2.0
    smooth = plan(heading(roughness=1e-6), DEFAULT)
    np.testing.assert_allclose(smooth.theta3, np.pi - smooth.angle, atol=np.radians(0.1))


def test_theta_angles_rebuild_the_pose_of_the_thesis() -> None:
    path = plan(heading(), DEFAULT)
    T = path.R_base_tunnel @ rotation("x", path.theta3) @ rotation("z", path.theta2)
    np.testing.assert_allclose(T[..., 0], path.direction, atol=1e-12)


def test_theta3_is_right_on_both_halves() -> None:
    path = plan(heading(yaw_deg=0, grade_deg=0), DEFAULT)
    right, left = path.angle < np.radians(60), path.angle > np.radians(120)
    assert right.any() and left.any()
    assert (path.direction[right, 1] < 0).all() and (path.direction[left, 1] > 0).all()
    assert (np.sign(path.direction[:, 2]) == np.sign(np.sin(path.theta3))).all()


def test_first_point_is_right_bottom_and_passes_make_an_s() -> None:
    path = plan(heading(), changed(seam_deg=None))
    assert path.angle[0] == pytest.approx(path.angle.min()) and path.station[0] < 10.5
    for bay in np.unique(path.bay):
        passes = np.unique(path.pass_index[path.bay == bay])
        for turn, index in enumerate(passes):
            rows = path.pass_index == index
            step = np.diff(path.angle[rows])
            assert (step > 0).all() if turn % 2 == 0 else (step < 0).all()
        stations = [path.station[path.pass_index == index].mean() for index in passes]
        assert (np.diff(stations) > 0).all()
    assert (np.diff(path.bay) >= 0).all() and (np.diff(path.pass_index) >= 0).all()


def test_seam_parts_passes_and_the_left_foot_comes_after() -> None:
    path = plan(heading(), DEFAULT)
    seam = np.radians(180.0) + 1e-9
    for index in np.unique(path.pass_index):
        above = path.angle[path.pass_index == index] <= seam
        assert above.all() or not above.any()
    for bay in np.unique(path.bay):
        above = path.angle[path.bay == bay] <= seam
        assert (np.diff(above.astype(int)) <= 0).all()


def test_tilt_beside_arches() -> None:
    path = plan(heading(arches=(11.2, 12.18)), DEFAULT)
    tilt = np.round(np.degrees(path.theta2))
    assert set(tilt[path.bay == 0]) == {90, 75}
    assert set(tilt[path.bay == 1]) == {105, 90, 75}
    assert set(tilt[path.bay == 2]) == {105, 90}
    for arch in (11.2, 12.18):
        near = np.abs(path.station - arch) < 0.3
        assert (tilt[near & (path.station < arch)] == 75).all()
        assert (tilt[near & (path.station > arch)] == 105).all()
    # toward the sprayed part the spray leans into the heading, behind the arch back out of it
    assert np.cos(path.theta2[tilt == 75]).min() > 0 > np.cos(path.theta2[tilt == 105]).max()


def test_no_arch_is_sprayed_square_everywhere() -> None:
    path = plan(heading(arches=()), DEFAULT)
    assert set(np.round(np.degrees(path.theta2))) == {90}
    assert np.ptp(path.station) == pytest.approx(3.0 - 2 * DEFAULT.edge_distance_m)


@given(headings, st.floats(0.15, 0.6))
@settings(max_examples=15, deadline=None)
def test_every_bay_cell_is_within_one_spray_radius_of_a_point(surface: Surface, radius: float) -> None:
    p = changed(spray_radius_m=radius, edge_distance_m=radius / 2, floor_clearance_m=0.0)
    path = plan(surface, p)
    tree = cKDTree(np.column_stack([path.station, path.angle * 5.9]))
    known = np.isfinite(surface.offset)
    angle = profile().angle(surface.along)
    high = -5.9 * np.sin(np.radians(28)) + 0.5  # the lowest nozzles are left out: floor clearance
    for bay in surface.bays:
        rows = (surface.station >= bay.station[0]) & (surface.station <= bay.station[1])
        s, a = np.meshgrid(surface.station[rows], angle, indexing="ij")
        seen = known[rows] & (4.9 * np.sin(a) > high)
        cells = np.column_stack([s[seen], a[seen] * 5.9])
        assert tree.query(cells)[0].max() <= radius + 1e-6


def test_overbreak_is_sprayed_first_from_the_stand_off() -> None:
    surface = heading(pockets=((10.6, 63.0, 0.4, 0.4), (12.9, 157.0, 0.4, 0.45)), roughness=1e-6)
    path = plan(surface, DEFAULT)
    assert path.overbreak[0] and (np.diff(path.overbreak.astype(int)) <= 0).all()
    inside = path.overbreak & (np.abs(path.station - 10.6) < 0.2) & (np.abs(np.degrees(path.angle) - 63) < 2)
    assert inside.any()
    nozzle = in_tunnel(surface, path)
    r = np.hypot(nozzle[inside, 1], nozzle[inside, 2])
    np.testing.assert_allclose(r, 5.9 + 0.45 - 1.0, atol=0.05)


def test_overbreak_across_the_arch_leaves_the_arch_out() -> None:
    surface = heading(pockets=((11.2, 90.0, 0.5, 0.3),))
    path = plan(surface, DEFAULT)
    assert set(path.bay[path.overbreak]) == {0, 1}
    assert (np.abs(path.station - 11.2) > 0.1 + 0.5 * DEFAULT.edge_distance_m).all()


def test_nozzle_keeps_clear_of_arches_beside_a_deep_pocket() -> None:
    surface = heading(pockets=((10.9, 90.0, 0.3, 1.2),))
    p = changed(position_smooth_m=0.0)
    path = plan(surface, p)
    nozzle = in_tunnel(surface, path)
    _, offset = profile().locate(nozzle[:, 1:])
    beside = np.maximum(np.abs(nozzle[:, 0] - 11.2) - 0.1, 0.0)
    inside = np.maximum(-0.22 - offset, 0.0)
    assert np.hypot(beside, inside).min() > p.arch_clearance_m - 1e-3
    assert offset.max() > -0.3  # the pocket does draw the nozzle outward elsewhere


def test_leaning_arches_lean_the_passes() -> None:
    path = plan(heading(lean_deg=3.0), DEFAULT)
    last = path.station[(path.bay == 0) & (np.degrees(path.theta2) < 80)]
    angle = path.angle[(path.bay == 0) & (np.degrees(path.theta2) < 80)]
    arch = 11.2 + np.tan(np.radians(3.0)) * 5.9 * (np.sin(angle) - 1.0)
    assert np.all(arch - 0.1 - last > 0.1) and np.all(arch - 0.1 - last < 0.2)


def test_points_stay_clear_of_the_floor() -> None:
    surface = heading(floor_z=-1.9)
    low = in_tunnel(surface, plan(surface, DEFAULT))[:, 2].min()
    assert -1.4 - 1e-6 <= low < -1.2
    assert (
        in_tunnel(heading(), plan(heading(), DEFAULT))[:, 2].min()
        >= -5.9 * np.sin(np.radians(28)) + 0.5 - 1e-6
    )


def test_unseen_wall_is_left_out_beyond_the_bridge() -> None:
    surface = heading()
    offset = surface.offset.copy()
    angle = np.degrees(profile().angle(surface.along))
    offset[:, (angle > 80) & (angle < 110)] = np.nan
    path = plan(dataclasses.replace(surface, offset=offset), DEFAULT)
    reach = np.degrees(DEFAULT.bridge_m / 5.9) + 1.0
    phi = np.degrees(path.angle)
    assert not ((phi > 80 + reach) & (phi < 110 - reach)).any()
    assert ((phi > 60) & (phi < 80)).any() and ((phi > 110) & (phi < 130)).any()


def test_nothing_seen_is_refused() -> None:
    surface = heading()
    with pytest.raises(InputError, match="nothing was seen"):
        plan(dataclasses.replace(surface, offset=np.full_like(surface.offset, np.nan)), DEFAULT)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stand_off_m", 0.0),
        ("spray_radius_m", -0.1),
        ("point_spacing_m", 0.0),
        ("point_spacing_m", float("nan")),
        ("tilt_outer_deg", 10.0),
        ("edge_distance_m", 0.9),
        ("floor_clearance_m", float("inf")),
    ],
)
def test_bad_parameters_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        plan(heading(), changed(**{name: value}))


def test_progress_rises_to_one_and_may_cancel() -> None:
    seen: list[float] = []
    plan(heading(), DEFAULT, seen.append)
    assert seen == sorted(seen) and seen[-1] == 1.0

    def cancel(fraction: float) -> None:
        raise CancelledError("cancelled by the operator")

    with pytest.raises(CancelledError):
        plan(heading(), DEFAULT, cancel)


def test_same_surface_same_path() -> None:
    a, b = plan(heading(holes=0.1), DEFAULT), plan(heading(holes=0.1), DEFAULT)
    assert a.position.tobytes() == b.position.tobytes()
