"""Clearance: distances against geometry known exactly, closest pairs, refusals."""

import dataclasses

import numpy as np
import pytest

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.flow import Arch, Axis, Bay, Label, Surface
from ascrcp.core.geometry import rotation
from ascrcp.core.profile import Arc, Profile
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.clearance import clearance, rough_clearance
from ascrcp.kinematics.description import ArmDescription, Capsule
from ascrcp.kinematics.kernel_call import kernel
from ascrcp.kinematics.obstacle import Obstacle, Obstacles, box_distance

RADIUS, FLOOR, FACE = 5.0, -3.0, 13.0


def smooth_heading(
    arches: tuple[Arch, ...] = (), body: np.ndarray | None = None, yaw: float = 0.0, radius: float = RADIUS
) -> Surface:
    """A smooth tube round the base's x axis with a level floor and a flat face, exactly known."""
    arc = Arc(centre=(0.0, 0.0), radius=radius, start_deg=-40.0, end_deg=220.0)
    profile = Profile(name="tube", arcs=[arc], arch_line=-0.2)
    station, along = np.arange(8.0, FACE, 0.05), np.arange(0.0, profile.length, 0.05)
    offset = np.where(station < 9.5, profile.arch_line, 0.0)[:, None] * np.ones(len(along))
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(4, FACE, 4000), rng.uniform(-5, 5, 4000), np.full(4000, FLOOR)])
    y, z = rng.uniform(-5, 5, (2, 4000))
    parts = [(floor, Label.GROUND), (np.column_stack([np.full(4000, FACE), y, z]), Label.FACE)]
    if body is not None:
        parts.append((body, Label.OTHER))
    points = np.concatenate([part for part, _ in parts])
    R = rotation("z", yaw)
    return Surface(
        axis=Axis(point=np.zeros(3), direction=R[:, 0]),
        profile=profile,
        unsprayed=(9.5, FACE),
        arches=arches,
        overbreak=(),
        bays=(Bay((9.5, FACE), None, None),),
        station=station,
        along=along,
        offset=offset.astype(np.float32),
        filled=np.zeros(offset.shape, dtype=bool),
        points=(points @ R.T).astype(np.float32),
        labels=np.concatenate([np.full(len(p), label, np.uint8) for p, label in parts]),
    )


def on_box(low: list[float], high: list[float], count: int) -> np.ndarray:
    """Points on the sides of a box, as a lidar sees it."""
    rng, corner = np.random.default_rng(3), np.array([low, high])
    points = rng.uniform(low, high, (count, 3))
    side = rng.integers(0, 3, count)
    points[np.arange(count), side] = corner[rng.integers(0, 2, count), side]
    return points


def random_joints(n: int, seed: int = 0) -> np.ndarray:
    arm, rng = load_arm("kc"), np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (20 * n, arm.n))
    q[:, 0] = rng.uniform(-0.6, 0.6, len(q))
    return q[arm.within_limits(q)][:n]


def test_field_agrees_with_the_exact_distance_to_a_tube_its_floor_and_face():
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(yaw=0.1), arm)
    rng = np.random.default_rng(1)
    local = rng.uniform([10.0, -4.6, -2.9], [12.9, 4.6, 4.6], (4000, 3))
    local = local[np.hypot(local[:, 1], local[:, 2]) < 4.95]
    wall = RADIUS - np.hypot(local[:, 1], local[:, 2])
    exact = np.minimum.reduce([wall, local[:, 2] - FLOOR, FACE - local[:, 0]])
    near = exact < 0.8  # further off, the lining behind station 9.5 may be nearer
    error = np.abs(obstacles.distance(local @ rotation("z", 0.1).T) - exact)[near]
    assert near.sum() > 1000
    assert np.percentile(error, 95) < 0.02 and error.max() < 0.06
    deep = np.array([[12.0, 0.0, 5.3], [12.0, 0.0, -3.3], [13.3, 0.0, 0.0]]) @ rotation("z", 0.1).T
    assert (obstacles.distance(deep) < -0.2).all()


def test_clearance_agrees_with_dense_points_on_every_link():
    """The nearest pair against brute force: 400 points along each capsule, exact distances to the tube."""
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(), arm)
    q = random_joints(1500)
    found = clearance(arm, q, obstacles)
    start, end = make_body(arm).segments(q)
    share = np.linspace(0.0, 1.0, 400)[:, None]
    best = np.full((len(q), len(arm.description.capsules)), np.inf)
    for c, capsule in enumerate(arm.description.capsules):
        if capsule.joint <= 1:
            continue
        p = start[:, c, None] + share * (end - start)[:, c, None]
        lining = np.where(p[..., 0] < 9.5, RADIUS - 0.2, RADIUS)
        wall = lining - np.hypot(p[..., 1], p[..., 2])
        exact = np.minimum.reduce([wall, p[..., 2] - FLOOR, FACE - p[..., 0]])
        best[:, c] = exact.min(axis=1) - capsule.radius
    heading = (found.obstacle != Obstacle.CARRIER) & (found.obstacle != Obstacle.ARM)
    inside = heading & (best.min(axis=1) > -0.1) & (best.min(axis=1) < 1.0)
    inside &= np.abs(found.point_b[:, 0] - 9.5) > 0.5  # the step where the lining ends
    assert inside.sum() > 60
    error = np.abs(found.distance - best.min(axis=1))[inside]
    assert np.percentile(error, 90) < 0.03 and error.max() < 0.1
    runner_up = np.sort(best, axis=1)
    sure = inside & (runner_up[:, 1] - runner_up[:, 0] > 0.1)
    assert (found.link[sure] == best[sure].argmin(axis=1)).all()


def test_closest_points_lie_the_distance_apart_and_on_link_and_obstacle():
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(), arm)
    q = random_joints(900, seed=2)
    found = clearance(arm, q, obstacles)
    gap = np.linalg.norm(found.point_b - found.point_a, axis=1)
    np.testing.assert_allclose(gap, np.abs(found.distance), atol=1e-6)
    near = (found.obstacle <= Obstacle.BODY) & (found.distance > 0.0) & (found.distance < 0.5)
    assert near.sum() > 20 and np.abs(obstacles.distance(found.point_b[near])).max() < 0.1
    start, end = make_body(arm).segments(q)
    for i in range(len(q)):
        c = found.link[i]
        on = start[i, c] + np.linspace(0.0, 1.0, 400)[:, None] * (end[i, c] - start[i, c])
        radius = arm.description.capsules[c].radius
        assert np.linalg.norm(on - found.point_a[i], axis=1).min() < radius + 0.15


def test_kinds_are_told_apart():
    arm = load_arm("kc")
    arch = Arch(11.0, 0.2, 0.0, (-40.0, 220.0))
    box = on_box([10.0, -1.0, -3.0], [11.0, 1.0, -1.5], 4000)
    obstacles = Obstacles.from_surface(smooth_heading((arch,), box), arm)
    where = {
        Obstacle.WALL: [12.0, 0.0, 4.7],
        Obstacle.ARCH: [11.0, 0.0, 4.6],
        Obstacle.FLOOR: [12.5, 0.0, -2.7],
        Obstacle.FACE: [12.7, 0.0, 0.0],
        Obstacle.BODY: [10.5, 0.0, -1.2],
        Obstacle.CARRIER: [-2.0, 0.0, -0.4],
    }
    points = np.array(list(where.values()))
    assert obstacles.kind_at(points).tolist() == [int(kind) for kind in where]
    np.testing.assert_allclose(obstacles.distance(points), [0.3, 0.2, 0.3, 0.3, 0.3, 0.25], atol=0.06)
    cleared = Obstacles.from_surface(smooth_heading((arch,), box), arm, bodies=False)
    assert cleared.distance(points)[4] > 1.5


def test_dust_and_falling_water_and_the_arm_itself_are_no_bodies():
    arm, rng = load_arm("kc"), np.random.default_rng(4)
    dust = rng.uniform([6.0, -3.0, -2.0], [12.5, 3.0, 3.0], (600, 3))
    water = np.column_stack([rng.normal([12.0, 2.0], 0.02, (900, 2)), rng.uniform(-3.0, 4.0, 900)])
    start, end = (ends[0] for ends in make_body(arm).segments(arm.zero_pose[None]))
    own = start[4] + rng.uniform(0, 1, (2000, 1)) * (end - start)[4] + rng.normal(0.0, 0.08, (2000, 3))
    plain = Obstacles.from_surface(smooth_heading(), arm)
    beside = water[:30] + rng.uniform([-0.19, -0.19, 0.0], [0.19, 0.19, 0.0], (30, 3))  # dust that touches it
    clutter = np.concatenate([dust, water, beside, own])
    cluttered = Obstacles.from_surface(smooth_heading(body=clutter), arm)
    np.testing.assert_array_equal(plain.kind, cluttered.kind)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_dust_before_a_lidar_of_many_beams_is_no_body_but_a_person_in_it_is(noise: float) -> None:
    """Its echoes fill the air the more densely the nearer they are: more than four to a cube of 0.2 m."""
    arm, rng = load_arm("kc"), np.random.default_rng(5)
    mount = arm.lidar(arm.zero_pose)[:3, 3]
    ray = rng.normal(size=(5000, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    dust = mount + rng.uniform(0.0, 2.5, (5000, 1)) * ray
    turn, height = rng.uniform(0.0, 2.0 * np.pi, 4000), rng.uniform(-3.0, -1.25, 4000)
    person = np.column_stack([9.0 + 0.25 * np.cos(turn), -2.0 + 0.25 * np.sin(turn), height])
    person += rng.normal(0.0, noise, person.shape)
    plain = Obstacles.from_surface(smooth_heading(), arm)
    dusty = Obstacles.from_surface(smooth_heading(body=dust), arm)
    np.testing.assert_array_equal(plain.kind, dusty.kind)
    both = Obstacles.from_surface(smooth_heading(body=np.concatenate([dust, person])), arm)
    beside = np.array([[9.0, -2.0 + 0.25 + 0.3, -2.0], [9.0 - 0.25 - 0.3, -2.0, -1.6]])
    assert (both.kind_at(beside) == Obstacle.BODY).all()
    np.testing.assert_allclose(both.distance(beside), 0.3, atol=0.06)


def test_boom_lowered_onto_the_carrier_and_lance_against_the_crown():
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(), arm)
    back = np.radians([-175.0, -20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    up = np.array([0.0, np.radians(70.0), 0.5, np.radians(-60.0), 0.0, 0.0, np.pi, np.pi / 2])
    found = clearance(arm, np.stack([back, up]), obstacles)
    assert (found.distance < 0.0).all()
    assert found.obstacle.tolist() == [Obstacle.CARRIER, Obstacle.WALL]
    assert "lance" in found.describe(arm, 0) and "into the carrier" in found.describe(arm, 0)


def test_links_that_could_meet_are_checked_against_each_other():
    arm = load_arm("kc")
    twin = next(c for c in arm.description.capsules if c.name == "boom")
    extra = Capsule(name="post", joint=0, start=(3.0, -0.2, 0.0), end=(3.0, -0.2, 0.2), radius=0.1)
    fields = {name: getattr(arm.description, name) for name in arm.description.__struct_fields__}
    fields["capsules"] = [*arm.description.capsules, extra]
    fields["self_pairs"] = [("boom", "post")]
    fields["sag"] = None
    changed = type(arm)(ArmDescription(**fields))
    obstacles = Obstacles.from_surface(smooth_heading(radius=9.0), changed)
    found = clearance(changed, changed.zero_pose, obstacles)
    assert found.obstacle[0] == Obstacle.ARM
    height = np.hypot(0.2, 0.4)  # boom at z = 0.6, post up to z = 0.2, 0.2 m aside
    assert found.distance[0] == pytest.approx(height - twin.radius - extra.radius, abs=1e-9)


def test_segments_and_boxes():
    rng = np.random.default_rng(5)
    a0, a1, b0, b1 = rng.normal(size=(4, 300, 3))
    a1[:10], b1[10:20] = a0[:10], b0[10:20]  # points
    b1[20:30] = b0[20:30] + (a1 - a0)[20:30]  # parallel
    on = np.empty((300, 2, 3))
    ends = np.stack([a0, a1], axis=1), np.stack([b0, b1], axis=1)
    found = np.array([kernel("clearance").gap(a, b, place) for a, b, place in zip(*ends, on, strict=True)])
    s = np.linspace(0.0, 1.0, 80)
    A = a0[:, None] + s[:, None] * (a1 - a0)[:, None]
    B = b0[:, None] + s[:, None] * (b1 - b0)[:, None]
    dense = np.linalg.norm(A[:, :, None] - B[:, None], axis=-1).min(axis=(1, 2))
    np.testing.assert_allclose(np.linalg.norm(on[:, 1] - on[:, 0], axis=1), found)
    assert (found <= dense + 1e-9).all() and (dense - found < 0.1).all()
    box = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 1.0]])
    points = np.array([[3.0, 0.5, 0.5], [1.0, 0.5, 0.9], [3.0, 2.0, 0.5], [2.0, 1.0, 1.0]])
    np.testing.assert_allclose(box_distance(box, points), [1.0, -0.1, np.sqrt(2.0), 0.0], atol=1e-12)


def test_rough_look_is_near_the_exact_one():
    arm = load_arm("kc")
    obstacles = Obstacles.from_surface(smooth_heading(), arm)
    q = random_joints(200, seed=6)
    exact = clearance(arm, q, obstacles)
    heading = (exact.obstacle != Obstacle.ARM) & (exact.distance > -0.1)
    rough = rough_clearance(arm, q, obstacles)
    assert np.abs(rough - exact.distance)[heading].max() < 0.2


def test_bad_calls_and_files_are_refused():
    arm = load_arm("kc")
    surface = smooth_heading()
    obstacles = Obstacles.from_surface(surface, arm)
    for bad in (np.zeros((2, 7)), np.full((1, 8), np.nan), np.zeros((1, 1, 8))):
        with pytest.raises(InputError, match="joint vectors"):
            clearance(arm, bad, obstacles)
    blind = dataclasses.replace(surface, offset=np.full_like(surface.offset, np.nan))
    with pytest.raises(InputError, match="nothing was seen"):
        Obstacles.from_surface(blind, arm)
    with pytest.raises(InputError, match="clearance model"):
        Obstacles.from_surface(surface, load_arm("muck"))
    fields = {name: getattr(arm.description, name) for name in arm.description.__struct_fields__}
    with pytest.raises(ConfigError, match="self_pairs"):
        ArmDescription(**{**fields, "self_pairs": [("boom", "tail")]})
    with pytest.raises(ConfigError, match="two capsules"):
        ArmDescription(**{**fields, "capsules": [*arm.description.capsules, arm.description.capsules[0]]})
