"""Workspace: exact extremes, cloud inside them, reach map that agrees with a dense search."""

import msgspec
import numpy as np
import pytest

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import rotation, transform
from ascrcp.kinematics import load_arm, sagged_forward
from ascrcp.kinematics.reach import compare_places, find_margin, find_reach
from ascrcp.kinematics.task import compute_error
from ascrcp.kinematics.workspace import find_extremes, load_config, sample_cloud, sample_joints

CONFIG = load_config()


def spray_targets(n: int, seed: int) -> np.ndarray:
    """Nozzles 1 m off a circular wall, square to it, from near to beyond reach."""
    rng = np.random.default_rng(seed)
    angle = np.radians(rng.uniform(-10.0, 190.0, n))  # 0 right, 90 crown
    R = rotation("x", np.pi - angle) @ rotation("z", np.pi / 2)
    p = np.stack([rng.uniform(6.0, 15.0, n), -4.9 * np.cos(angle), 1.85 + 4.9 * np.sin(angle)], axis=-1)
    return transform(R, p)


def test_the_muck_arms_greatest_depth_is_that_of_its_lengths():
    arm = load_arm("muck")
    depth = find_extremes(arm, 12, np.random.default_rng(1))["z_max"]
    assert depth.value == pytest.approx(0.58 + 1.0819 + 1.415 + 0.107 + 0.6666, abs=1e-9)
    assert 1e3 * depth.value == pytest.approx(3850.5, abs=1e-6)  # errata 1.4
    np.testing.assert_allclose(np.degrees(depth.q[[1, 2, 5]]), 90.0, atol=1e-4)
    assert depth.value == pytest.approx(3.830, rel=0.01)  # the paper's Monte Carlo figure


@pytest.mark.parametrize("name", ["kc", "muck", "duct"])
def test_no_random_pose_passes_an_extreme_and_each_is_reached(name: str):
    arm = load_arm(name)
    extremes = find_extremes(arm, 12, np.random.default_rng(2))
    p = arm.forward(sample_joints(arm, 100_000, np.random.default_rng(3)))[:, :3, 3]
    largest = dict(zip(("x_max", "y_max", "z_max"), p.max(axis=0), strict=True))
    smallest = dict(zip(("x_min", "y_min", "z_min"), p.min(axis=0), strict=True))
    largest["radius_max"] = np.hypot(p[:, 0], p[:, 1]).max()
    assert all(extremes[key].value >= value for key, value in largest.items())
    assert all(extremes[key].value <= value for key, value in smallest.items())
    for end in extremes.values():
        assert arm.within_limits(end.q)


def test_the_cloud_is_the_seeds_and_sags():
    arm = load_arm("kc")
    a, b = (sample_cloud(arm, 500, np.random.default_rng(4), load) for load in (0.0, 181.0))
    np.testing.assert_array_equal(a, sample_cloud(arm, 500, np.random.default_rng(4)))
    assert (b[:, 2] < a[:, 2]).all() and (a[:, :2] == b[:, :2]).all()


def test_margin_is_the_least_share_of_a_range():
    arm = load_arm("kc")
    middle = np.linalg.solve(arm.limit_matrix, (arm.limit_lower + arm.limit_upper) / 2)
    assert find_margin(arm, middle) == pytest.approx(0.5)
    low = middle.copy()
    low[2] = -0.19  # a tenth of joint 3's range below it
    assert find_margin(arm, low) == pytest.approx(-0.1)
    assert find_margin(arm, np.full(8, np.nan)) == -np.inf


def test_postures_of_the_map_reach_their_points_with_the_sag():
    arm = load_arm("kc")
    T = spray_targets(60, 5)
    found = find_reach(arm, T, CONFIG.reach, payload_kg=90.0)
    good = found.reachable
    assert 20 < good.sum() < 60
    assert arm.within_limits(found.q[good]).all()
    np.testing.assert_allclose(find_margin(arm, found.q[good]), found.margin[good])
    sagged = sagged_forward(arm, found.q[good], 90.0)
    np.testing.assert_allclose(sagged[:, :3, 3], T[good, :3, 3], atol=1e-9)
    np.testing.assert_allclose(sagged[:, :3, 0], T[good, :3, 0], atol=1e-9)
    for row in range(60):
        reason = found.reason(arm, row)
        assert (reason is None) == good[row]
    assert "joint 3 boom telescope" in (found.reason(arm, int(T[:, 0, 3].argmax())) or "")
    assert compute_error(arm, T[good], found.q[good]).facing.all()


def test_a_dense_search_finds_little_more():
    """The map is a lower bound; a search 30 times denser reaches no cell the map is sure to lack."""
    arm = load_arm("kc")
    T = spray_targets(60, 6)
    dense = msgspec.structs.replace(
        CONFIG.reach, roll_step_deg=5.0, yaw_candidates=13, telescope_candidates=9, starts=12
    )
    coarse, fine = find_reach(arm, T, CONFIG.reach), find_reach(arm, T, dense)
    gain = fine.margin - coarse.margin
    assert np.quantile(gain, 0.9) < 0.02
    assert not fine.reachable[coarse.margin < -0.05].any()


def test_parking_nearer_to_a_wall_out_of_reach_covers_more():
    arm = load_arm("kc")
    T = spray_targets(40, 7)
    T[:, 0, 3] += 3.0
    coarse = msgspec.structs.replace(
        CONFIG.reach, yaw_candidates=3, telescope_candidates=3, starts=2, refine_rounds=4
    )
    parking = compare_places(arm, T, np.array([-2.0, 0.0, 2.0, 4.0]), coarse)
    assert parking.covered[0] < parking.covered[2]
    assert parking.covered[parking.best] == parking.covered.max()
    assert parking.offset[parking.best] > 0.0


@pytest.mark.parametrize("name", ["muck", "duct"])
def test_arms_that_do_not_spray_walls_are_refused(name: str):
    with pytest.raises(InputError, match="no reach map"):
        find_reach(load_arm(name), np.eye(4)[None], CONFIG.reach)
