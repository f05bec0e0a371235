"""Collision feedback: levers and tilts by themselves, the stop of joint 7, and whole paths kept clear."""

import dataclasses

import numpy as np
import pytest
from test_clearance import FACE, on_box, smooth_heading
from test_path import assert_on_path, joint_rates, make_path

from ascrcp.core.flow import Arch, SprayPath, Surface
from ascrcp.core.geometry import Array, angle_between
from ascrcp.kinematics import load_arm, solve_path
from ascrcp.kinematics.barrier import Sight, make_barrier, no_emphasis
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.feedback import (
    add_tilt,
    find_lever,
    raise_weights,
    rotation_matrices,
    soften_tilt,
    split_collisions,
    spread_tilt,
    tilt_path,
)
from ascrcp.kinematics.obstacle import Obstacle, Obstacles
from ascrcp.kinematics.seam import choose_turns, find_seam_tilt

STEP, LIMIT = np.radians(3.0), np.radians(15.0)


def rings(
    stations: list[float], low_deg: float = 20.0, high_deg: float = 160.0, jitter: float = 0.0
) -> SprayPath:
    """S path 1 m off the smooth tube, square to it but for a jitter of the direction [rad]."""
    phi = np.radians(np.arange(low_deg, high_deg, 2.5))
    s = np.repeat(stations, len(phi))
    angle = np.concatenate([phi if k % 2 == 0 else phi[::-1] for k in range(len(stations))])
    noise = np.random.default_rng(0).uniform(-jitter, jitter, len(s))
    return make_path(
        np.stack([s, -4.0 * np.cos(angle), 4.0 * np.sin(angle)], axis=-1),
        np.full(len(s), np.pi / 2),
        np.pi - angle + noise,
        station=s,
        angle=angle,
        pass_index=np.repeat(np.arange(len(stations)), len(phi)),
    )


def box_of_points(low: list[float], high: list[float]) -> Array:
    return on_box(low, high, 6000)


@pytest.fixture(scope="module")
def surface() -> Surface:
    return smooth_heading((Arch(11.0, 0.2, 0.0, (-40.0, 220.0)),))


def test_tilts_keep_the_sprayed_point_and_the_stand_off():
    path = rings([12.0])
    rng = np.random.default_rng(2)
    tilt = add_tilt(
        np.zeros((len(path), 3)), rng.normal(0.0, 0.1, (len(path), 3)), path.direction, STEP, LIMIT
    )
    tilted = tilt_path(path, tilt, 1.0)
    np.testing.assert_allclose(tilted.position + tilted.direction, path.position + path.direction, atol=1e-12)
    size = np.linalg.norm(tilt, axis=1)
    np.testing.assert_allclose(angle_between(tilted.direction, path.direction), size, atol=1e-7)
    assert (size <= LIMIT + 1e-12).all()
    np.testing.assert_allclose(size / STEP, np.rint(size / STEP), atol=1e-9)
    assert np.abs((tilt * path.direction).sum(axis=1)).max() < 1e-12
    assert np.abs(tilted.theta3 - path.theta3).max() < 0.3
    assert tilt_path(path, np.zeros_like(tilt), 1.0) is path


def test_rotation_vectors_turn_as_far_as_they_are_long():
    vector = np.random.default_rng(3).normal(size=(50, 3))
    R = rotation_matrices(vector)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose((R @ vector[..., None])[..., 0], vector, atol=1e-12)
    np.testing.assert_allclose(np.trace(R, axis1=1, axis2=2), 1 + 2 * np.cos(np.linalg.norm(vector, axis=1)))


def test_a_tilt_is_spread_in_steps_within_its_stroke():
    tilt = np.zeros((20, 3))
    tilt[10] = [0.0, 4 * STEP, 0.0]
    tilt[12] = [0.0, 0.0, STEP]
    stretch = np.where(np.arange(20) < 14, 0, 1)
    spread = np.linalg.norm(spread_tilt(tilt, stretch, STEP), axis=1) / STEP
    assert np.rint(spread).astype(int).tolist() == [0] * 7 + [1, 2, 3, 4, 3, 2, 1] + [0] * 6
    np.testing.assert_allclose(spread_tilt(tilt, stretch, STEP)[12], [0.0, 2 * STEP, 0.0])


def test_softened_tilts_are_no_less_and_bend_less():
    """A lean of one point among straight ones throws the nozzle out and back: that is what is smoothed."""
    tilt = np.zeros((40, 3))
    tilt[[9, 15, 16, 30], 1] = np.array([1.0, 2.0, 1.0, 5.0]) * STEP
    stretch = np.repeat([0, 1], 20)
    rough = spread_tilt(tilt, stretch, STEP)
    soft = soften_tilt(rough, stretch, 3)
    assert (soft[:, 1] >= rough[:, 1] - 1e-12).all() and soft.max() <= tilt.max() + 1e-12
    bends = [np.abs(np.diff(values[:20, 1], n=2)).max() for values in (rough, soft)]
    assert bends[1] < 0.5 * bends[0]
    alone = np.where((stretch == 0)[:, None], rough, 0.0)
    np.testing.assert_array_equal(soften_tilt(alone, stretch, 3)[:20], soft[:20])
    assert not soften_tilt(alone, stretch, 3)[20:].any()
    crossed = np.zeros((9, 3))
    crossed[3], crossed[5] = [0.0, STEP, 0.0], [STEP, 0.0, 0.0]
    size = np.linalg.norm(soften_tilt(crossed, np.zeros(9, dtype=int), 3), axis=1)
    assert (size[[3, 5]] >= STEP - 1e-12).all()


def test_links_before_the_wrist_are_avoidable_and_get_more_weight():
    arm = load_arm("kc")
    barrier = make_barrier(arm, Obstacles.from_surface(smooth_heading(), arm))
    names = barrier.body.names
    sight = Sight(np.full((1, len(names)), 0.2), np.zeros((1, len(names), 3)))
    avoidable, tied = split_collisions(barrier.body, sight, 0.25, 6)
    assert {n for n, t in zip(names, tied[0], strict=True) if t} == {"wrist", "nozzle"}
    assert (avoidable ^ tied).all()
    raised = raise_weights(no_emphasis(barrier, 1), avoidable)
    assert (raised[avoidable] > 1.0).all() and (raised[tied] == 1.0).all()


def test_the_barrier_is_linearised_rightly():
    """Gradient of the cost against finite differences of the very distances."""
    arm = load_arm("kc")
    barrier = make_barrier(arm, Obstacles.from_surface(smooth_heading(), arm))
    path = rings([FACE - 0.25, 12.0], 60.0, 120.0)
    q = solve_path(arm, path, arm.zero_pose).q
    q = q[np.isfinite(q[:, 0])]
    sight = barrier.look(q)
    near = sight.distance.min(axis=1) < 0.3
    assert near.sum() > 5
    q = q[near]
    emphasis = no_emphasis(barrier, len(q))
    _, slope = barrier.terms(q, barrier.look(q), emphasis)
    numeric = np.empty_like(slope)
    for j in range(arm.n):
        h = np.zeros(arm.n)
        h[j] = 1e-3
        ahead, behind = (barrier.cost(barrier.look(q + sign * h), emphasis) for sign in (1.0, -1.0))
        numeric[:, j] = (ahead - behind) / (2 * 2e-3)  # terms are of half the cost
    assert (slope * numeric).sum() > 0.9 * np.linalg.norm(slope) * np.linalg.norm(numeric)
    assert 0.8 < np.linalg.norm(slope) / np.linalg.norm(numeric) < 1.25


def test_the_lever_moves_the_link_away():
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(), arm)
    pivot = np.array([[FACE - 0.2, 0.0, 5.0]])
    centre = np.array([[FACE - 0.15, 0.0, 3.2]])
    sight = Sight(np.array([[0.05]]), centre[:, None])
    lever = find_lever(obstacles, sight, np.array([[True]]), pivot, 0.25)
    moved = pivot + (rotation_matrices(lever) @ (centre - pivot)[..., None])[..., 0]
    assert obstacles.distance(moved)[0] - obstacles.distance(centre)[0] == pytest.approx(0.2, abs=0.03)
    assert not find_lever(obstacles, sight, np.array([[False]]), pivot, 0.25).any()


def test_passes_beside_the_face_are_tilted_until_wrist_and_nozzle_keep_clear(surface: Surface):
    arm = load_arm("kc")
    path = rings([FACE - 0.75, FACE - 0.45, FACE - 0.15])
    obstacles = Obstacles.from_surface(surface, arm)
    blind = solve_path(arm, path, arm.zero_pose)
    assert not blind.tilt.any() and np.isnan(blind.clearance).all() and blind.path is path
    before = clearance(arm, blind.q[blind.solved], obstacles)
    assert before.distance.min() < 0.0 and before.obstacle[before.distance.argmin()] == Obstacle.FACE
    found = solve_path(arm, path, arm.zero_pose, obstacles=obstacles)
    reached = blind.solved
    assert found.solved[reached].mean() > 0.97
    assert_on_path(arm, found.path, found)
    kept = found.clearance[found.solved]
    assert kept.min() >= 0.10 and np.percentile(kept, 5) > 0.2
    outer = path.station > FACE - 0.2
    assert (found.tilt[outer & found.solved] > 0.0).all() and not found.tilt[path.station < FACE - 0.7].all()
    assert np.degrees(found.tilt.max()) <= 15.0 + 1e-9
    same_pass = np.diff(path.pass_index) == 0
    assert np.degrees(np.abs(np.diff(found.tilt))[same_pass].max()) < 3.0 + 1e-6


def test_a_lance_gives_way_by_self_motion_without_a_tilt():
    arm = load_arm("kc")
    path = rings([11.6, 11.9], 150.0, 185.0)
    blind = solve_path(arm, path, arm.zero_pose)
    start, end = make_body(arm).segments(blind.q[blind.solved])
    x, y, z = ((start + end)[:, 4] / 2.0)[::5].T  # the lance's middle along the path
    lowest = z.argmin()
    top = float(z[lowest]) - 0.2
    block = box_of_points([x[lowest] - 0.3, y[lowest] - 0.3, -3.0], [x[lowest] + 0.3, y[lowest] + 0.3, top])
    cluttered = Obstacles.from_surface(smooth_heading(body=block), arm)
    before = clearance(arm, blind.q[blind.solved], cluttered)
    found = solve_path(arm, path, arm.zero_pose, obstacles=cluttered)
    assert before.distance.min() < 0.1 and before.obstacle[before.distance.argmin()] == Obstacle.BODY
    assert found.solved[blind.solved].all()
    assert found.clearance.min() > 0.24
    assert_on_path(arm, found.path, found)
    assert (joint_rates(arm, found.path, found) < 1.5).all()


def test_what_cannot_be_reached_without_a_hit_says_what_it_would_hit():
    arm = load_arm("kc")
    path = rings([12.0], 60.0, 120.0)
    wall_of_muck = box_of_points([10.0, -1.2, 2.0], [12.2, 1.2, 4.5])
    obstacles = Obstacles.from_surface(smooth_heading(body=wall_of_muck), arm)
    found = solve_path(arm, path, arm.zero_pose, obstacles=obstacles)
    blocked = np.abs(path.position[:, 1]) < 0.6
    assert not found.solved[blocked].any()
    reasons = [r for r, b in zip(found.reasons, blocked, strict=True) if b]
    assert all(r and r.startswith("would hit: ") and "body" in r for r in reasons)
    assert (found.clearance[found.solved] >= 0.10).all()


def test_a_joint_stays_on_its_side_of_the_stop_where_a_small_tilt_allows():
    turn = 2 * np.pi
    wander = np.radians([20.0, 5.0, -3.0, 4.0, -6.0, -2.0, 6.0, 30.0])
    stops = np.zeros(8, dtype=bool)
    assert choose_turns(wander, 0.0, turn, LIMIT, 12.0, stops).tolist() == [0] * 8
    far = np.radians([20.0, 5.0, -20.0, -40.0, -60.0, -50.0])
    assert choose_turns(far, 0.0, turn, LIMIT, 12.0, np.zeros(6, dtype=bool)).tolist() == [0, 0, 1, 1, 1, 1]
    angle = wander % turn
    axis, direction = (
        np.tile([1.0, 0.0, 0.0], (8, 1)),
        np.stack([0 * wander, np.cos(wander), np.sin(wander)], -1),
    )
    kept, tilt = find_seam_tilt(angle, 0.0, turn, LIMIT, 12.0, stops, axis, direction)
    assert (np.abs(np.diff(kept)) < 1.0).all()
    assert np.flatnonzero(tilt.any(axis=1)).tolist() == [2, 4, 5]
    np.testing.assert_allclose(np.degrees(tilt[[2, 4, 5], 0]), [3.5, 6.5, 2.5], atol=1e-6)
    same, none = find_seam_tilt(wander[-2:], 0.0, turn, LIMIT, 12.0, stops[:2], axis[:2], direction[:2])
    assert not none.any() and (same == wander[-2:]).all()


def test_varying_normals_beside_the_stop_cost_no_breaks():
    arm = load_arm("kc")
    path = rings([11.0, 11.3, 11.6], 180.0, 198.0, jitter=np.radians(8.0))
    path = dataclasses.replace(path, position=path.position * [1.0, 1.2, 1.2] + [0.0, 0.0, -0.85])
    blind = solve_path(arm, path, arm.zero_pose)
    found = solve_path(
        arm, path, arm.zero_pose, obstacles=Obstacles.from_surface(smooth_heading(radius=9.0), arm)
    )
    assert found.solved.all() and blind.solved.all()
    assert found.break_before.sum() == 1 < blind.break_before.sum()
    assert 0.0 < np.degrees(found.tilt.max()) <= 9.0 + 1e-9


def test_obstacles_change_nothing_where_nothing_is_near():
    arm = load_arm("kc")
    path = rings([11.5, 11.8], 40.0, 120.0)
    wide = Obstacles.from_surface(smooth_heading(radius=12.0), arm)
    far, plain = solve_path(arm, path, arm.zero_pose, obstacles=wide), solve_path(arm, path, arm.zero_pose)
    assert not far.tilt.any()
    np.testing.assert_allclose(far.q, plain.q, atol=1e-6)


def test_what_is_just_out_of_reach_is_sprayed_leaning():
    arm = load_arm("kc")
    wide = Obstacles.from_surface(smooth_heading(radius=18.0), arm)
    for stretched, reached in ((2.28, True), (2.5, False)):
        path = rings([12.0], 60.0, 120.0)
        path = dataclasses.replace(path, position=path.position * [1.0, stretched, stretched])
        assert not solve_path(arm, path, arm.zero_pose).solved.any()
        found = solve_path(arm, path, arm.zero_pose, obstacles=wide)
        assert found.solved.all() == reached and found.solved.any() == reached
        if reached:
            assert_on_path(arm, found.path, found)
            assert np.degrees(found.tilt).min() > 0.0 and np.degrees(found.tilt).max() <= 15.0 + 1e-9
            wall = found.path.position + found.path.direction
            np.testing.assert_allclose(wall, path.position + path.direction, atol=1e-9)
        else:
            assert all(reason and "reach" in reason for reason in found.reasons)
