"""The simulated heading: its mesh agrees with its truth, and chance comes from the seed alone."""

from typing import Any

import numpy as np
import pytest
from tunnel_case import CIRCLE, LIDAR, SMOOTH, THREE_CENTRE, TUNNEL

from ascrcp.core.config import convert, load, merge, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import TunnelConfig
from ascrcp.simulation.tunnel_mesh import rough
from ascrcp.simulation.tunnel_wall import Patch


def make(seed: int, overlay: Any = None, profile: Profile = CIRCLE) -> Heading:
    return build_heading(load(TUNNEL, TunnelConfig, overlay), np.random.default_rng(seed), profile)


def look_out(heading: Heading, station: Array, along: Array) -> Array:
    """Measure the offset of what a ray from the axis square to the design line meets first."""
    config = load(LIDAR, LidarConfig, {"own_parts": []})
    profile, axis = heading.truth.profile, heading.truth.axis
    model = LidarModel(config, heading)
    T = axis.T_base_tunnel
    normal = profile.normal(along)
    foot = profile.point(along, -1.0)
    rays = np.column_stack([station, foot, np.zeros_like(station), normal])
    rays[:, :3] = rays[:, :3] @ T[:3, :3].T + T[:3, 3]
    rays[:, 3:] = rays[:, 3:] @ T[:3, :3].T
    hit = model._scene.cast_rays(model._tensor(rays.astype(np.float32)))
    return hit["t_hit"].numpy().astype(float) - 1.0


def above_floor(heading: Heading, count: int) -> Array:
    along = np.linspace(0.0, heading.truth.profile.length, count)
    return along[1:-1][heading.truth.profile.point(along[1:-1], -1.0)[:, 1] > -1.2]


@pytest.mark.parametrize("seed", range(4))
def test_truth_axis_is_where_the_configuration_says(seed: int) -> None:
    axis = make(seed).truth.axis
    assert abs(np.linalg.norm(axis.direction) - 1.0) < 1e-12
    assert abs(axis.point @ axis.direction) < 1e-12  # station 0 is nearest the base origin
    assert -1.95 <= axis.point[2] <= -1.7
    assert abs(np.degrees(np.arctan2(axis.direction[1], axis.direction[0]))) <= 3.0


def test_same_seed_same_heading_other_seed_other_heading() -> None:
    a, b, c = make(3), make(3), make(4)
    np.testing.assert_array_equal(a.vertices, b.vertices)
    np.testing.assert_array_equal(a.triangles, b.triangles)
    assert a.truth.to_dict() == b.truth.to_dict()
    assert a.truth.to_dict() != c.truth.to_dict()


def test_one_more_arch_moves_no_rock() -> None:
    a, b = make(5, {"arches": {"count": 1}}), make(5, {"arches": {"count": 3}})
    assert len(a.truth.arches) == 1 and len(b.truth.arches) >= 2
    assert a.truth.overbreak_volume == b.truth.overbreak_volume
    assert a.truth.pockets == b.truth.pockets and a.truth.axis.point.tolist() == b.truth.axis.point.tolist()


@pytest.mark.parametrize("profile", [CIRCLE, THREE_CENTRE], ids=lambda p: p.name)
def test_smooth_heading_lies_where_it_should(profile: Profile) -> None:
    heading = make(1, SMOOTH, profile)
    along = above_floor(heading, 200)
    start, end = heading.truth.unsprayed
    sprayed = look_out(heading, np.full_like(along, start - 1.0), along)
    rock = look_out(heading, np.full_like(along, (start + end) / 2), along)
    np.testing.assert_allclose(sprayed, profile.arch_line - 0.01, atol=1e-3)
    np.testing.assert_allclose(rock, 0.02, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_arches_reach_the_arch_line_and_stand_off_the_rock(seed: int) -> None:
    heading = make(seed, {"bumps": {"count": 0}})
    along = above_floor(heading, 150)
    z = CIRCLE.point(along, -0.2)[:, 1]
    assert len(heading.truth.arches) == 2
    for arch in heading.truth.arches:
        middle = arch.station + np.tan(np.radians(arch.lean_deg)) * (z - 5.9)
        for aside in (-0.09, 0.0, 0.09):
            np.testing.assert_allclose(look_out(heading, middle + aside, along), -0.22, atol=0.02)
        for aside in (-0.12, 0.12):  # the wall shows beside the flange, clear of it
            assert look_out(heading, middle + aside, along).min() > -0.16


@pytest.mark.parametrize("seed", range(3))
def test_pockets_are_overbreak_and_nothing_else_is(seed: int) -> None:
    heading = make(seed, {"arches": {"count": 0}})
    truth = heading.truth
    assert len(truth.pockets) == 3 and len(truth.bumps) == 1
    s, a = np.meshgrid(
        np.arange(truth.unsprayed[0] + 0.3, truth.unsprayed[1] - 0.25, 0.05), above_floor(heading, 400)
    )
    s, a = s.ravel(), a.ravel()
    offset = look_out(heading, s, a)
    inside = np.any([p.radius(s, a) < 0.9 for p in truth.pockets], axis=0)
    outside = np.all([p.radius(s, a) > 1.2 for p in truth.pockets], axis=0)
    assert (offset[inside] > CIRCLE.overbreak_line).mean() > 0.99
    assert offset[outside].max() < CIRCLE.overbreak_line
    for pocket in truth.pockets:
        deepest = offset[pocket.radius(s, a) < 0.9].max() - CIRCLE.overbreak_line
        assert pocket.depth - 0.1 < deepest < pocket.depth + 0.15
    bump = truth.bumps[0]
    assert offset[bump.radius(s, a) < 0.1].min() < CIRCLE.arch_line + 0.02


def test_volume_of_a_smooth_pocket_matches_its_integral() -> None:
    overlay = merge(SMOOTH, {"pockets": {"count": 1}, "mesh": {"step": 0.02}})
    heading = make(2, overlay)
    p = heading.truth.pockets[0]
    line = 5.9 + CIRCLE.overbreak_line
    # depth (1 - r^4) over the ellipse, arc lengths stretched from the design line to the
    # overbreak line, prisms widening outward
    flat = np.pi * p.half_length * p.half_arc * p.depth * 2 / 3 * line / 5.9
    widening = 1.0 + p.depth * (1 - 2 / 3 + 1 / 5) / (2 / 3) / (2 * line)
    assert heading.truth.overbreak_volume == pytest.approx(flat * widening, rel=0.01)
    assert heading.truth.overbreak_area == pytest.approx(
        np.pi * p.half_length * p.half_arc * line / 5.9, rel=0.02
    )


def test_visible_volume_lies_between_nothing_and_all() -> None:
    heading = make(1)
    model = LidarModel(load(LIDAR, LidarConfig), heading)
    seen = model.visible_volume(np.array([9.75, -0.2, 0.3]))
    assert 0.2 * heading.truth.overbreak_volume < seen < heading.truth.overbreak_volume


def test_face_closes_the_tunnel_unless_left_open() -> None:
    for present in (True, False):
        heading = make(1, merge(SMOOTH, {"face": {"present": present}}))
        axis = heading.truth.axis
        s = (heading.vertices - axis.point) @ axis.direction
        assert ((abs(s - heading.truth.unsprayed[1]) < 1e-3).sum() > 1000) == present


def test_empty_heading_of_options_still_builds() -> None:
    heading = make(0, SMOOTH)
    assert (
        heading.truth.arches == () and heading.truth.pockets == () and heading.truth.overbreak_volume == 0.0
    )
    assert len(heading.drips) == 0


@pytest.mark.parametrize("profile", [CIRCLE, THREE_CENTRE], ids=lambda p: p.name)
def test_no_gap_between_wall_and_floor(profile: Profile) -> None:
    heading = make(1, SMOOTH, profile)
    model = LidarModel(load(LIDAR, LidarConfig, {"own_parts": []}), heading)
    T = heading.truth.axis.T_base_tunnel.copy()
    T[:3, 3] += T[:3, 0] * 11.0
    for pan in (np.pi / 2, 1.3, -1.0):  # the whole section, looking across and forward
        assert np.isfinite(model.cast(T, pan)[0]).all()


def test_patches_keep_their_distance() -> None:
    a = Patch(0.0, 0.0, 0.5, 0.5, 0.3)
    assert not a.is_clear_of(Patch(0.9, 0.9, 0.5, 0.5, 0.3))
    assert a.is_clear_of(Patch(0.0, 1.2, 0.5, 0.5, 0.3))


def test_roughness_has_the_height_it_is_asked_for() -> None:
    octaves = load(TUNNEL, TunnelConfig).rock.roughness
    s, a = np.arange(0.0, 40.0, 0.05)[:, None], np.arange(0.0, 40.0, 0.05)[None, :]
    for octave in octaves:
        field = rough(np.random.default_rng(0), s, a, [octave])
        assert field.std() == pytest.approx(octave.rms, rel=0.2)
        assert abs(field.mean()) < 0.2 * octave.rms


@pytest.mark.parametrize(
    ("overlay", "named"),
    [
        ({"placement": {"yaw_deg": [3.0, -3.0]}}, "yaw_deg"),
        ({"placement": {"yaw_deg": [0.0, 60.0]}}, "yaw_deg"),
        ({"arches": {"count": -1}}, "count"),
        ({"arches": {"colour": "red"}}, "colour"),
        ({"length": {"rear": 50.0}}, "rear"),
        ({"mesh": {"step": 0.0}}, "step"),
        ({"bodies": [{"shape": "horse"}]}, "shape"),
        ({"rock": {"offset": float("nan")}}, "offset"),
    ],
)
def test_bad_configuration_is_refused_by_name(overlay: Any, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        convert(merge(read_yaml(TUNNEL), overlay), TunnelConfig, "tunnel.yaml")


def test_wire_mesh_hangs_before_the_rock_and_is_looked_through() -> None:
    bare, meshed = make(8), make(8, {"net": {"present": True}})
    assert bare.solid == len(bare.triangles) and meshed.solid == len(bare.triangles)
    assert len(meshed.triangles) > meshed.solid
    along = np.repeat(above_floor(bare, 300), 20)
    station = np.tile(np.linspace(*bare.truth.unsprayed, 22)[1:-1], len(along) // 20)
    before = look_out(bare, station, along) - look_out(meshed, station, along)
    on_bar = before > 1e-4
    assert 0.03 < on_bar.mean() < 0.15  # two bars of 8 mm every 200 mm
    assert before.min() > -1e-4 and np.median(before[on_bar]) == pytest.approx(0.03, abs=0.03)
    origin = bare.truth.axis.point + bare.truth.axis.direction * 9.7
    config = load(LIDAR, LidarConfig)
    seen = [LidarModel(config, heading).is_visible(origin) for heading in (bare, meshed)]
    np.testing.assert_array_equal(seen[0], seen[1])


def test_a_layer_moves_the_rock_and_nothing_else() -> None:
    thin, thick = make(9, SMOOTH), make(9, merge(SMOOTH, {"rock": {"layer": 0.08}}))
    along = above_floor(thin, 60)
    part = thin.truth.unsprayed
    for station, moved in ((sum(part) / 2, 0.08), (part[0] - 1.0, 0.0)):
        at = np.full(len(along), station)
        assert np.allclose(look_out(thin, at, along) - look_out(thick, at, along), moved, atol=2e-3)


def test_a_tunnels_profile_has_arches_as_wide_as_those_built() -> None:
    config = load(TUNNEL, TunnelConfig, {"arches": {"width": 0.16}})
    assert config.load_profile().arch_width == 0.16
