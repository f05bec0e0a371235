"""Moves between strokes keep clear of heading, carrier and the arm itself, or are refused by name."""

import dataclasses

import numpy as np
import pytest
from planning_heading import heading

from ascrcp.cli.bench_headings import make_case
from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.flow import JointSequence, Label
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.clearance import clearance
from ascrcp.kinematics.leg import plan_leg
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.path import PathSolution, solve_path
from ascrcp.kinematics.route import find_route
from ascrcp.planning.move import plan_move
from ascrcp.planning.parameter import load_parameters
from ascrcp.planning.timing import find_strokes, time_path, time_sequence

ARM = load_arm("kc")
PARAMETERS = load_parameters()
TIMING = PARAMETERS.timing
MODEL = ARM.description.clearance
assert MODEL is not None
LEAST, WANTED = MODEL.least, MODEL.wanted
SEEDS = (0, 4, 5)


@pytest.fixture(scope="module", params=SEEDS)
def case(request: pytest.FixtureRequest) -> tuple[Obstacles, PathSolution]:
    """A heading drawn, scanned, recognised, planned and solved."""
    made = make_case(ARM, request.param)
    return made.obstacles, solve_path(ARM, made.path, ARM.zero_pose, obstacles=made.obstacles)


@pytest.fixture(scope="module")
def room() -> Obstacles:
    return Obstacles.from_surface(heading(floor_z=-1.9), ARM)


def least_between(sequence: JointSequence, obstacles: Obstacles) -> float:
    between = sequence.q[~sequence.spraying & (sequence.point < 0)]
    return float(clearance(ARM, between, obstacles).distance.min())


def test_no_move_comes_nearer_than_the_least_clearance(case):
    obstacles, found = case
    blind = time_sequence(ARM, found.path, found.q, found.break_before, TIMING)
    assert least_between(blind, obstacles) < LEAST  # straight moves would have met something
    timed = time_path(ARM, found.path, found.q, found.break_before, TIMING, obstacles)
    assert least_between(timed.sequence, obstacles) >= LEAST - 1e-3
    assert all(reason is None for reason in timed.reasons)
    again = time_sequence(ARM, found.path, found.q, found.break_before, TIMING, obstacles)
    assert again.q.tobytes() == timed.sequence.q.tobytes() and again.t.tobytes() == timed.sequence.t.tobytes()


def test_a_stroke_nothing_reaches_is_left_out_with_its_reason(case):
    obstacles, found = case
    stroke = find_strokes(found.path, found.q, found.break_before, TIMING.gap_m)[1]
    q = found.q.copy()
    # boom and lance lowered and drawn out: the wrist is below any floor
    q[stroke, 1:6] = np.radians(-25.0), 1.9, 0.0, 0.0, 2.2
    timed = time_path(ARM, found.path, q, found.break_before, TIMING, obstacles)
    left_out = np.flatnonzero([reason is not None for reason in timed.reasons])
    np.testing.assert_array_equal(left_out, stroke)
    assert "cannot be approached: target: " in str(timed.reasons[stroke[0]])
    assert not np.isin(timed.sequence.point, stroke).any()
    assert least_between(timed.sequence, obstacles) >= LEAST - 1e-3


def at_slew(slew_deg: float) -> Array:
    """The boom nearly level, half drawn out, slewed."""
    q = np.radians([slew_deg, -5.0, 0.0, 5.0, 0.0, 0.0, 0.0, 90.0])
    q[[2, 5]] = 1.0, 0.5
    return q


def test_a_move_goes_round_what_stands_in_its_way():
    axes = [np.arange(a, b, 0.1) for a, b in ((6.0, 9.0), (0.5, 0.9), (-3.9, 0.9))]
    block = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    inside = ((block > block.min(axis=0)) & (block < block.max(axis=0))).all(axis=1)
    block = block[~inside]  # a lidar sees its sides
    empty = heading(floor_z=-1.9)
    surface = dataclasses.replace(
        empty,
        points=np.concatenate([empty.points, block]),
        labels=np.concatenate([empty.labels, np.full(len(block), Label.OTHER, np.uint8)]),
    )
    obstacles = Obstacles.from_surface(surface, ARM)
    start, end = at_slew(-15.0), at_slew(25.0)
    straight = start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start)
    assert clearance(ARM, straight, obstacles).distance.min() < 0.0
    duration, t, q = plan_move(ARM, start, end, TIMING, obstacles)
    assert clearance(ARM, q, obstacles).distance.min() >= WANTED - 1e-2
    assert ARM.within_limits(q, 1e-6).all() and (np.diff(t) > 0).all() and t[-1] < duration
    rate = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
    assert (rate <= ARM.max_speed * TIMING.move_fraction * 1.001).all()


def test_the_wanted_way_is_taken_if_it_is_clear(room):
    between = at_slew(0.0)
    route = find_route(ARM, at_slew(-15.0), at_slew(15.0), room, [between])
    np.testing.assert_array_equal(route, [between])


def into_the_floor(distance: float, obstacles: Obstacles) -> Array:
    """Lower the boom until the arm is this near to the floor [m], negative inside."""
    q = at_slew(0.0)
    while clearance(ARM, q, obstacles).distance[0] > distance:
        q[1] -= 0.002
    return q


def test_refusal_names_link_and_obstacle(room):
    for distance, how in ((0.08, "from"), (-0.2, "into")):
        target = into_the_floor(distance, room)
        with pytest.raises(UnreachableError, match=rf"target: \w+ .* m {how} the floor at .*at least"):
            find_route(ARM, ARM.zero_pose, target, room)


def test_an_arm_that_stands_too_near_may_leave(room):
    start = into_the_floor(0.05, room)
    near = float(clearance(ARM, start, room).distance[0])
    _, _, q = plan_move(ARM, start, ARM.zero_pose, TIMING, room)
    assert clearance(ARM, q, room).distance.min() >= near - 1e-3


def test_an_arm_without_shapes_is_refused(room):
    duct = load_arm("duct")
    with pytest.raises(InputError, match="no clearance model"):
        find_route(duct, duct.zero_pose, duct.zero_pose, room)


def test_a_leg_is_straight_also_where_joints_differ_widely():
    rng = np.random.default_rng(5)
    for scale in (1.0, 1e-2, 1e-5):
        ends = rng.uniform(ARM.lower, ARM.upper, (60, ARM.n))
        for start, other in zip(ends[::2], ends[1::2], strict=True):
            end = start + scale * rng.uniform(0.0, 1.0, ARM.n) ** 6 * (other - start)
            _, q = plan_leg(ARM, start, end, 0.1, speed=0.6, acceleration=0.6)
            way = end - start
            share = (q - start) @ way / (way @ way)
            np.testing.assert_allclose(q, start + share[:, None] * way, atol=1e-9)
            assert (np.diff(share) > -1e-12).all()
