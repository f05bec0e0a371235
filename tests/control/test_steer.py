"""Steering without a machine: speeds within jerk and rates, rest before edges, joints a function of place."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ascrcp.control.steer import Steering, SteerStatus, shape_stick, stopping_speed
from ascrcp.control.steer_config import load_steer_config
from ascrcp.control.steer_jog import CartesianJog, JointJog
from ascrcp.control.steer_plan import SteerPlan, find_areas
from ascrcp.control.steer_pose import find_joints
from ascrcp.control.steer_relax import relax_joints
from ascrcp.control.steer_surface import Spot, SteerSurface
from ascrcp.core.clock import CYCLE_S
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.sag import sagged_forward

ARM = load_arm("kc")
CONFIG = load_steer_config()
ROWS, COLUMNS = 4, 40
HOLE = (1, 20)


def make_plan() -> SteerPlan:
    """Four passes round a quarter of a tunnel; one node of the second cannot be reached."""
    angle = np.linspace(0.6, 1.5, COLUMNS)
    q = np.zeros((ROWS, COLUMNS, 8))
    first = np.array([-0.2, 0.1, 0.9, 0.2, 0.0, 0.9, 2.2, 1.4])
    station = 11.0 + 0.3 * np.arange(ROWS)
    position = np.stack(np.broadcast_arrays(
        station[:, None], -4.2 * np.cos(angle)[None], 4.2 * np.sin(angle)[None]), -1)  # fmt: skip
    direction = np.broadcast_to(
        np.stack([0 * angle, -np.cos(angle), np.sin(angle)], -1), (ROWS, COLUMNS, 3)
    ).copy()
    near = first
    for r in range(ROWS):
        for c in range(COLUMNS) if r % 2 == 0 else reversed(range(COLUMNS)):
            q[r, c], miss = find_joints(ARM, near, position[r, c], direction[r, c])
            for _ in range(20):
                if miss < 1e-3:
                    break
                q[r, c], miss = find_joints(ARM, q[r, c], position[r, c], direction[r, c])
            assert miss < 1e-3
            near = q[r, c]
    node = np.ones((ROWS, COLUMNS), bool)
    node[HOLE] = False
    q[HOLE] = np.nan
    cross = node[:-1] & node[1:]
    point = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    return SteerPlan(angle, q, position, direction, node, cross, point, find_areas(node, cross))


PLAN = make_plan()
SURFACE = SteerSurface(PLAN, ARM, 0.0, CONFIG.turn_m)


def steer_from(row: int, column: int) -> Steering:
    steering = Steering(SURFACE, CONFIG, ARM.max_speed)
    steering.begin(row, column)
    return steering


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_stick_keeps_its_sign_and_never_exceeds_one(x: float, y: float) -> None:
    a, b = shape_stick(x, y, CONFIG)
    assert math.hypot(a, b) <= 1.0 + 1e-9
    assert a * x >= 0.0 and b * y >= 0.0
    if math.hypot(x, y) <= CONFIG.dead_zone:
        assert (a, b) == (0.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_stick_that_is_no_number_is_neutral(bad: float) -> None:
    assert shape_stick(bad, 0.5, CONFIG) == (0.0, 0.0)
    assert shape_stick(0.5, bad, CONFIG) == (0.0, 0.0)


@given(st.floats(0.001, 5.0))
def test_stopping_speed_needs_just_the_distance(distance: float) -> None:
    a, j = CONFIG.acceleration_m_s2, CONFIG.jerk_m_s3
    v = stopping_speed(distance, a, j)
    assert v * v / (2 * a) + v * a / (2 * j) == pytest.approx(distance)
    assert stopping_speed(-distance, a, j) == stopping_speed(math.nan, a, j) == 0.0


@settings(max_examples=8)
@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=2, max_size=5),
    st.integers(0, ROWS - 1),
    st.integers(0, COLUMNS - 1),
)
def test_wherever_it_is_pushed_it_stays_on_the_surface(
    pushes: list[tuple[float, float]], row: int, column: int
) -> None:
    if not PLAN.node[row, column]:
        return
    steering = steer_from(row, column)
    before = steering.sample()
    for x, y in pushes:
        for _ in range(40):
            now = steering.step(x, y, 1.0)
            assert SURFACE.is_free(steering.spot)
            T = sagged_forward(ARM, np.array(now.q), 0.0)
            assert np.linalg.norm(T[:3, 3] - now.position) < 2e-4
            assert np.linalg.norm(T[:3, 0] - now.direction) < 2e-4
            moved = np.abs(np.subtract(now.q, before.q)) / CYCLE_S
            assert (moved <= CONFIG.joint_share * ARM.max_speed * 1.06).all()
            rate = math.dist(now.position, before.position) / CYCLE_S
            assert rate <= 1.5 * CONFIG.speed_m_s
            before = now


@pytest.mark.parametrize("x, y", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0)])
def test_pushed_against_the_edge_it_comes_to_rest_there(x: float, y: float) -> None:
    steering = steer_from(2, 20)
    for _ in range(1600):
        steering.step(x, y, 1.0)
    assert max(abs(v) for v in steering._smooth.speed) < 1e-3
    assert steering.status is SteerStatus.EDGE
    if x:
        assert steering.spot.column == pytest.approx(COLUMNS - 1 if x > 0 else 0, abs=0.3)
    if y:
        assert steering.spot.row == pytest.approx(ROWS - 1 if y > 0 else 0, abs=0.3)


def test_it_slides_round_a_hole_in_the_pass() -> None:
    """Between two passes, where one of them ends: it goes over to the one that goes on, and says so."""
    steering = steer_from(1, 12)
    seen = set()
    for _ in range(60):
        steering.step(0.0, 1.0, 1.0)  # off the pass, toward the third
    for _ in range(1600):
        steering.step(1.0, 0.0, 1.0)
        seen.add(steering.status)
    assert SteerStatus.SLIDING in seen
    assert steering.spot.column > HOLE[1] + 1


def test_it_looks_for_a_way_across_beside_the_hole() -> None:
    steering = steer_from(0, 20)
    seen = set()
    for _ in range(1600):
        steering.step(0.0, 1.0, 1.0)
        seen.add(steering.status)
    assert SteerStatus.SLIDING in seen
    assert steering.spot.row == pytest.approx(ROWS - 1, abs=0.1)


def test_coming_back_finds_the_joints_as_they_were() -> None:
    steering = steer_from(2, 10)
    first = np.array(steering.sample().q)
    for x in (1.0, -1.0):
        for _ in range(200):
            steering.step(x, 0.0, 1.0)
    q, _ = SURFACE.joints(Spot(2.0, 10.0))
    np.testing.assert_allclose(q, first, atol=1e-12)


def test_relaxed_joints_reach_the_same_poses_and_differ_less() -> None:
    node = PLAN.node.ravel()
    q, position, direction = (
        a.reshape(-1, a.shape[-1])[node] for a in (PLAN.q, PLAN.position, PLAN.direction)
    )
    rng = np.random.default_rng(4)
    row = np.repeat(np.arange(ROWS), COLUMNS)[node]
    rough, _ = find_joints(ARM, q + rng.normal(0, 0.05, (ROWS, 8))[row], position, direction)
    index = np.flatnonzero(row[1:] == row[:-1])
    edges = np.stack([index, index + 1], 1)
    number = np.full(ROWS * COLUMNS, -1)
    number[node] = np.arange(node.sum())
    number = number.reshape(ROWS, COLUMNS)
    across = np.stack([number[:-1].ravel(), number[1:].ravel()], 1)
    edges = np.concatenate([edges, across[(across >= 0).all(1)]])
    calm = relax_joints(ARM, rough, position, direction, edges)
    T = sagged_forward(ARM, calm, 0.0)
    assert np.linalg.norm(T[:, :3, 3] - position, axis=1).max() < 1e-3
    a, b = edges.T
    assert np.square(calm[a] - calm[b]).sum() < 0.8 * np.square(rough[a] - rough[b]).sum()


def test_areas_are_what_the_stick_can_reach() -> None:
    """Two nodes lie in one area just if a walk over free nodes and crossings joins them."""
    rng = np.random.default_rng(7)
    node = rng.uniform(size=(6, 25)) < 0.7
    cross = node[:-1] & node[1:] & (rng.uniform(size=(5, 25)) < 0.5)
    area = find_areas(node, cross)
    assert ((area >= 0) == node).all()
    same = area[:, :-1] == area[:, 1:]
    assert same[node[:, :-1] & node[:, 1:]].all()
    assert (area[:-1] == area[1:])[cross].all()
    for number in range(area.max() + 1):
        reached = {tuple(np.argwhere(area == number)[0])}
        front = list(reached)
        while front:
            r, c = front.pop()
            steps = [(r, c - 1), (r, c + 1)]
            steps += [(r + 1, c)] if r < 5 and cross[r, c] else []
            steps += [(r - 1, c)] if r > 0 and cross[r - 1, c] else []
            for place in steps:
                if 0 <= place[1] < 25 and node[place] and place not in reached:
                    reached.add(place)
                    front.append(place)
        assert len(reached) == (area == number).sum()


def test_another_area_is_offered_until_all_were_left() -> None:
    plan = PLAN
    split = plan.area.copy()
    split[2:][plan.node[2:]] = 1
    cut = SteerPlan(
        plan.angle, plan.q, plan.position, plan.direction, plan.node, plan.cross, plan.point, split
    )
    here = plan.position[0, 5]
    assert cut.nearest(here) == (0, 5)
    assert cut.nearest(here, frozenset({0}))[0] == 2
    assert cut.nearest(here, frozenset({0, 1})) == (0, 5)


def wall_at(x: float):
    """Distance of the nozzle from a plane across the tunnel [m]."""
    return lambda q: x - float(ARM.forward(q)[0, 3])


@pytest.mark.parametrize("kind", ["nozzle", "joint"])
def test_a_jog_comes_no_nearer_than_allowed_but_goes_away_again(kind: str) -> None:
    """F18: clearance is looked at while jogging."""
    q = np.array([-0.3, 0.1, 0.8, 0.1, 0.1, 0.8, 2.0, 1.5])
    start = float(ARM.forward(q)[0, 3])
    distance = wall_at(start + CONFIG.clearance_m + 0.05)
    jog = (
        CartesianJog(ARM, CONFIG, 0.0, distance)
        if kind == "nozzle"
        else JointJog(ARM, 3, CONFIG, 0.0, distance)
    )
    jog.begin(q)
    push = (0.0, 1.0) if kind == "nozzle" else (1.0, 0.0)
    seen = set()
    for _ in range(400):
        now = jog.step(*push, 1.0)
        seen.add(jog.status)
    most = 0.02  # what a tenth of a second between two looks can add
    assert SteerStatus.NEAR in seen
    assert CONFIG.clearance_m - most <= distance(np.array(now.q)) <= CONFIG.clearance_m + 0.04
    for _ in range(200):
        now = jog.step(-push[0], -push[1], 1.0)
    assert distance(np.array(now.q)) > CONFIG.clearance_m + 0.05


def test_a_jog_stops_at_the_end_of_a_joint_and_comes_back() -> None:
    q = np.array([-0.3, 0.1, 1.88, 0.1, 0.1, 0.8, 2.0, 1.5])
    jog = JointJog(ARM, 3, CONFIG)
    jog.begin(q)
    for _ in range(300):
        now = jog.step(1.0, 0.0, 1.0)
    assert jog.status is SteerStatus.LIMIT and 1.88 < now.q[2] <= 1.9
    for _ in range(100):
        now = jog.step(-1.0, 0.0, 1.0)
    assert now.q[2] < 1.88
