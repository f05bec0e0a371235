"""The muck job: volume, slices, postures by least travel, legs within the joints' limits (muck paper)."""

from itertools import pairwise

import msgspec
import numpy as np
import pytest
from scipy.integrate import quad

from ascrcp.core.errors import ConfigError, UnreachableError
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.choice import travel_cost
from ascrcp.planning.muck import (
    count_scoops,
    cut_slices,
    find_segment_area,
    find_volume,
    load_muck_parameters,
)
from ascrcp.planning.muck_leg import time_leg
from ascrcp.planning.muck_path import Scoop, find_cover, plan_muck, plan_postures
from ascrcp.planning.muck_pose import bucket_pose, find_candidates, find_pitch, list_poses, measure_clearance

ARM = load_arm("muck")
P = load_muck_parameters()
ANGLES = (-0.4, 0.0, 0.3)


@pytest.fixture(scope="module")
def scoops() -> tuple[Scoop, ...]:
    return plan_muck(ARM, P, ANGLES, lambda _: None)


def test_the_segment_is_the_integral_and_the_paper_s_volume_is_it_bulked():
    for radius, depth in ((3.2, 0.5), (2.0, 1.9), (4.5, 0.01)):
        half = np.sqrt(2 * radius * depth - depth**2)
        area = quad(lambda y, r=radius, d=depth: np.sqrt(r * r - y * y) - (r - d), -half, half)[0]
        assert find_segment_area(radius, depth) == pytest.approx(area, rel=1e-6)
    assert find_volume(P) == pytest.approx(0.5821, abs=5e-5)
    assert count_scoops(P) == 15
    bulked = load_muck_parameters(bulking=1.2)
    assert find_volume(bulked) == pytest.approx(0.6984, abs=2e-4)
    assert count_scoops(bulked) == 18


def test_slices_hold_the_same_and_mirror_each_other():
    angle = cut_slices(P, 15)
    np.testing.assert_allclose(angle, -angle[::-1], atol=1e-9)
    assert (np.diff(angle) > 0).all()
    assert np.abs(angle).max() < np.arccos((P.tunnel_radius_m - P.muck_depth_m) / P.tunnel_radius_m)
    third = 1e-3 + P.tunnel_radius_m * np.sin(cut_slices(P, 1))
    assert third == pytest.approx(1e-3)
    rest = P.tunnel_radius_m - P.muck_depth_m
    y = P.tunnel_radius_m * np.sin(cut_slices(P, 2)[1])  # a quarter of the whole lies beyond
    beyond = quad(lambda v: np.sqrt(P.tunnel_radius_m**2 - v * v) - rest, y, np.sqrt(3.2**2 - rest**2))[0]
    assert beyond == pytest.approx(find_segment_area(P.tunnel_radius_m, P.muck_depth_m) / 4, rel=1e-3)


def test_a_depth_beyond_the_tunnel_is_refused():
    with pytest.raises(ConfigError, match="muck_depth_m"):
        load_muck_parameters(muck_depth_m=4.0)


def test_a_bucket_pose_points_where_it_says():
    for slew, pitch in ((0.3, 0.0), (-1.0, 0.8), (1.2, -0.5), (0.0, np.pi)):
        T = bucket_pose(ARM, slew, 1.0, 2.0, 3.0, pitch)
        outward = np.array([np.cos(slew), np.sin(slew), 0.0])
        wanted = np.cos(pitch) * outward + np.array([0.0, 0.0, np.sin(pitch)])  # z is down
        np.testing.assert_allclose(T[:3, 0], wanted, atol=1e-12)
        np.testing.assert_allclose(T[:3, 3], [1.0, 2.0, 3.0])


def test_postures_go_from_start_over_the_invert_and_the_wall_to_above_the_beam(scoops: tuple[Scoop, ...]):
    for scoop, angle in zip(scoops, ANGLES, strict=True):
        mine = scoop.postures
        T = ARM.forward(mine.q)
        off = P.tunnel_radius_m - np.hypot(T[:, 1, 3], T[:, 2, 3] - P.base_above_axis_m)
        assert list(dict.fromkeys(mine.names)) == ["start", "scoop", "lift", "wall", "tip"]
        names = np.array(mine.names)
        np.testing.assert_allclose(off[names == "scoop"], P.floor_gap_m, atol=1e-9)
        np.testing.assert_allclose(off[names == "wall"], P.wall_gap_m, atol=1e-9)
        dug = T[names == "scoop", :3, 3]
        np.testing.assert_allclose(dug[-1, 0] - dug[0, 0], P.muck_length_m, atol=1e-9)
        np.testing.assert_allclose(np.arctan2(dug[:, 1], dug[:, 2] - P.base_above_axis_m), angle, atol=1e-9)
        assert T[-1, 2, 3] < P.beam.top_z_m and abs(T[-1, 1, 3]) < P.beam.half_width_m
        assert (np.sign(T[names == "wall", 1, 3]) == (1.0 if angle >= 0 else -1.0)).all()
        np.testing.assert_allclose(np.degrees(find_pitch(ARM, mine.q[mine.loaded :])), 0.0, atol=1e-6)


def test_the_way_keeps_ranges_walls_beam_and_a_level_bucket(scoops: tuple[Scoop, ...]):
    for scoop in scoops:
        rows = np.vstack([leg.q for leg in scoop.legs])
        assert ARM.within_limits(rows).all()
        assert measure_clearance(ARM, P, rows).min() == scoop.clearance >= 0.0
        assert scoop.floor >= 0.0
        assert np.abs(find_pitch(ARM, scoop.legs[1].q)).max() == scoop.steepest
        assert scoop.steepest <= np.radians(P.carry_pitch_deg) + 1e-9
        joined = [first.q[-1] - second.q[0] for first, second in pairwise(scoop.legs)]
        np.testing.assert_allclose(joined, 0.0, atol=1e-9)
    for one, following in pairwise(scoops):
        np.testing.assert_allclose(one.legs[-1].q[-1], following.legs[0].q[0], atol=1e-9)


def test_legs_keep_speed_acceleration_and_jerk_and_use_them(scoops: tuple[Scoop, ...]):
    q = scoops[0].postures.q
    leg = time_leg(ARM, "carry", q[scoops[0].postures.loaded :], 0.002, 1.0)
    dt = np.diff(leg.t).mean()
    rates = leg.q
    for limit in (ARM.max_speed, ARM.max_acceleration, ARM.max_jerk):
        rates = np.diff(rates, axis=0) / dt
        assert (np.abs(rates) <= 1.02 * limit).all()
    assert np.abs(np.diff(leg.q[[0, 1, -2, -1]], axis=0)[[0, 2]]).max() < 1e-6  # from rest to rest
    slow = time_leg(ARM, "carry", q[scoops[0].postures.loaded :], 0.1, 0.5)
    assert slow.t[-1] > 1.2 * leg.t[-1]
    for row in q[scoops[0].postures.loaded :]:
        assert np.abs(leg.q - row).max(axis=1).min() < 5e-3  # through every posture


def test_no_other_posture_at_any_pose_would_travel_less():
    for angle in (-0.3, 0.2):
        mine, poses = plan_postures(ARM, P, angle), list_poses(P, angle)
        steps = [float(travel_cost(ARM, b, a)) for a, b in pairwise(mine.q)]
        assert mine.travel == pytest.approx(sum(steps))
        for k in range(1, len(poses) - 1):
            options, place = find_candidates(ARM, P, poses[k], np.sign(angle))
            before, after = mine.q[k - 1], mine.q[k + 1]
            cost = travel_cost(ARM, options, before) + travel_cost(ARM, options, after)
            allowed = np.ones(len(options), dtype=bool)
            if poses[k].ahead is not None:
                allowed &= place == place[np.abs(options - mine.q[k]).max(axis=1).argmin()]
            for other, from_pose in ((before, k), (after, k + 1)):
                if from_pose > mine.loaded:
                    halfway = (options + other) / 2
                    allowed &= np.abs(find_pitch(ARM, halfway)) <= np.radians(P.carry_pitch_deg)
            assert len(options) > 5
            assert cost[allowed].min() >= steps[k - 1] + steps[k] - 1e-9


def test_mirrored_places_take_mirrored_ways():
    left, right = plan_postures(ARM, P, 0.3), plan_postures(ARM, P, -0.3)
    assert left.travel == pytest.approx(right.travel, rel=1e-6)
    y = [ARM.forward(way.q)[:, 1, 3] for way in (left, right)]
    np.testing.assert_allclose(y[0], -y[1], atol=1e-9)


def test_the_invert_is_covered_as_the_paper_asks_and_not_from_too_high():
    assert np.degrees(find_cover(ARM, P, np.radians(15.0))) >= P.cover_deg
    high = load_muck_parameters(base_above_axis_m=1.2)
    assert find_cover(ARM, high, np.radians(15.0)) == 0.0  # errata 1.4: at most 0.65
    with pytest.raises(UnreachableError, match=r"'scoop'|'start'"):
        plan_postures(ARM, high, 0.0)


def test_a_beam_in_the_way_is_named():
    wide = msgspec.convert(
        {**msgspec.to_builtins(P), "beam": {"half_width_m": 2.5, "top_z_m": -1.1, "bottom_z_m": -0.1}},
        type(P),
    )
    with pytest.raises(UnreachableError, match="clear of wall and beam"):
        plan_postures(ARM, wide, 0.0)


def test_poses_are_spaced_along_the_wall():
    poses = [pose for pose in list_poses(P, 0.2) if pose.name == "wall"]
    angle = [np.arctan2(pose.y or 0.0, pose.z - P.base_above_axis_m) for pose in poses]
    assert np.degrees(angle[0]) == pytest.approx(P.wall_from_deg)
    assert np.degrees(angle[-1]) == pytest.approx(P.wall_to_deg)
    assert np.degrees(np.diff(angle)).max() <= P.wall_step_deg + 1e-9
