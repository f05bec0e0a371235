"""Machine code against NumPy, SciPy and finite differences; the bits hang on neither number nor threads."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from test_clearance import random_joints, smooth_heading

from ascrcp.core.geometry import transform
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.barrier import make_barrier, no_emphasis
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.clearance import clearance, least_distance, rough_clearance
from ascrcp.kinematics.kernel_call import kernel
from ascrcp.kinematics.kernel_table import LegRule, freeze
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.reason import largest_excess, limit_excess
from ascrcp.kinematics.smooth import TASK_STIFFNESS, make_cost, point_cost, smooth_round
from ascrcp.kinematics.task import compute_error, project_task

ARM = load_arm("kc")
ROOM = Obstacles.from_surface(smooth_heading(), ARM)


def test_every_node_gets_the_nearest_point():
    rng, shape = np.random.default_rng(0), (9, 31, 17)
    owner = np.full(shape, -1, dtype=np.int32)
    nodes = np.unique(rng.integers(0, shape, (40, 3)), axis=0)
    nodes = nodes[nodes[:, 0] != 4]  # a plane without any point
    owner[tuple(nodes.T)] = np.arange(len(nodes))
    low, cell, field = np.array([-1.0, 2.0, 0.5]), 0.25, np.empty(shape, dtype=np.float32)
    points = low + cell * nodes
    code = kernel("nearest")
    across, who = code.spread_across(owner)
    found = code.spread_along(np.arange(shape[1]), across, who, points, low, cell, field)
    places = low + cell * np.moveaxis(np.indices(shape), 0, -1)
    exact, _ = cKDTree(points).query(places)
    np.testing.assert_allclose(field, exact, atol=1e-6)
    np.testing.assert_allclose(
        np.linalg.norm(points[np.moveaxis(found, 0, 1)] - places, axis=-1), exact, atol=1e-12
    )


def test_the_field_is_read_as_scipy_reads_it():
    from scipy.ndimage import map_coordinates

    rng = np.random.default_rng(1)
    points = rng.uniform([-8.0, -9.0, -9.0], [20.0, 9.0, 9.0], (5000, 3))  # beyond the grid too
    nodes = (
        ROOM.T_tunnel_base[:3, :3] @ points.T + ROOM.T_tunnel_base[:3, 3:] - ROOM.low[:, None]
    ) / ROOM.cell
    exact = map_coordinates(ROOM.field.astype(float), nodes, order=1, mode="nearest")
    np.testing.assert_allclose(ROOM.distance(points), exact, atol=1e-9)
    away = ROOM.direction(points)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.0)
    risen = ROOM.distance(points + 0.02 * away) - ROOM.distance(points - 0.02 * away)
    inside = ((nodes.T > 1.0) & (np.array(ROOM.field.shape) - 2.0 > nodes.T)).all(axis=1)
    assert np.median(risen[inside]) == pytest.approx(0.04, abs=0.004)


def test_many_postures_are_measured_as_each_by_itself():
    """Many rows run in two threads: the same bits, also on a second call and after a journey by pickle."""
    q, there = random_joints(1600, seed=3), pickle.loads(pickle.dumps(ROOM))
    q = np.concatenate([q, q + 1e-3])[:2200]
    assert len(q) == 2200
    for measure in (least_distance, rough_clearance):
        whole = measure(ARM, q, ROOM)
        np.testing.assert_array_equal(whole, [measure(ARM, q[i : i + 1], ROOM)[0] for i in range(len(q))])
        np.testing.assert_array_equal(whole, measure(ARM, q, there))
    np.testing.assert_array_equal(clearance(ARM, q, ROOM).distance, least_distance(ARM, q, ROOM))
    T, metric = ARM.forward(q[::-1].copy()), make_cost(ARM, ARM.description.path).metric
    few = [project_task(ARM, T[i : i + 1], q[i : i + 1], metric)[0] for i in range(0, 2200, 100)]
    np.testing.assert_array_equal(project_task(ARM, T, q, metric)[::100], few)


def test_misses_and_their_derivatives():
    q = random_joints(200, seed=4)
    T = ARM.forward(q + np.random.default_rng(4).normal(0.0, 0.02, q.shape))
    error, reached, h = compute_error(ARM, T, q), ARM.forward(q), 1e-6
    np.testing.assert_allclose(error.residual[:, :3], reached[:, :3, 3] - T[:, :3, 3], atol=1e-12)
    aside = np.einsum("nij,ni->nj", T[:, :3, 1:3], reached[:, :3, 0])
    np.testing.assert_allclose(error.residual[:, 3:], aside, atol=1e-12)
    for i in range(ARM.n):
        step = h * np.eye(ARM.n)[i]
        rise = compute_error(ARM, T, q + step).residual - compute_error(ARM, T, q - step).residual
        np.testing.assert_allclose(error.jacobian[:, :, i], rise / (2.0 * h), atol=1e-6)
    assert (
        error.facing.all()
        and not compute_error(ARM, T @ transform(np.diag([-1.0, 1.0, -1.0])), q).facing.any()
    )


def test_largest_excess_is_that_of_all_ranges():
    q = np.random.default_rng(5).uniform(ARM.lower - 1.0, ARM.upper + 1.0, (3000, ARM.n))
    q[7, 2] = np.nan
    np.testing.assert_allclose(largest_excess(ARM, q), limit_excess(ARM, q).max(axis=1), atol=1e-12)


def test_a_raised_tool_rises_and_keeps_its_direction():
    q, lift = random_joints(300, seed=6), 1e-3
    found = kernel("task").raise_tool(ARM.table, q, ARM.max_speed**2, lift, 1e-9)
    before, after = ARM.forward(q), ARM.forward(found)
    np.testing.assert_allclose(after[:, 2, 3] - before[:, 2, 3], lift, atol=1e-4)
    np.testing.assert_allclose(after[:, :3, 0], before[:, :3, 0], atol=1e-4)


def test_a_step_onto_a_pose_leaves_its_square_behind():
    q = random_joints(300, seed=12)
    rng = np.random.default_rng(12)
    T = ARM.forward(q + rng.normal(0.0, 2e-3, q.shape))
    moved = kernel("task").step_onto(
        ARM.table, q, T[:, :3, 3].copy(), T[:, :3, 0].copy(), ARM.max_speed**2, 1e-9
    )
    before, after = ARM.forward(q), ARM.forward(moved)
    away = [np.linalg.norm(each[:, :3, 3] - T[:, :3, 3], axis=1) for each in (before, after)]
    turned = [np.linalg.norm(each[:, :3, 0] - T[:, :3, 0], axis=1) for each in (before, after)]
    assert np.median(away[1]) < 0.01 * np.median(away[0])
    assert np.median(turned[1]) < 0.01 * np.median(turned[0])


def test_the_push_is_the_slope_of_the_barrier():
    barrier = make_barrier(ARM, ROOM)
    q = np.concatenate([random_joints(900, seed=seed) for seed in (7, 10, 11)])
    sight = barrier.look(q)
    one = ((sight.distance < barrier.soft).sum(axis=1) == 1) & (sight.distance.min(axis=1) > 0.05)
    q, sight = q[one], sight.pick(np.flatnonzero(one))
    emphasis = no_emphasis(barrier, len(q))
    blocks, slope = barrier.terms(q, sight, emphasis)
    assert len(q) > 20
    frames, rows = ARM.frames(q), np.arange(len(q))
    link = sight.distance.argmin(axis=1)
    centre, joint = sight.centre[rows, link], make_body(ARM).shape.joint[link]
    local = np.linalg.solve(frames[rows, joint - 1], np.append(centre, np.ones((len(q), 1)), 1)[..., None])
    away, h = ROOM.direction(centre), 1e-6
    rise = np.empty(q.shape)
    for i in range(ARM.n):
        moved = (ARM.frames(q + h * np.eye(ARM.n)[i])[rows, joint - 1] @ local)[:, :3, 0]
        rise[:, i] = ((moved - centre) * away).sum(axis=1) / h
    depth = barrier.soft - sight.distance[rows, link]
    np.testing.assert_allclose(slope, -barrier.weight * depth[:, None] * rise, atol=2e-3)
    np.testing.assert_allclose(
        blocks, barrier.weight * rise[:, :, None] * rise[:, None], atol=1e-5 * np.abs(blocks).max()
    )


def test_a_round_of_smoothing_steps_down_the_gradient_of_its_cost():
    """With much damping the step is the gradient over it: finite differences of all that is minimised."""
    q = random_joints(40, seed=8)[:12]
    q = q[0] + 0.02 * (q - q[0])
    T = ARM.forward(q + 1e-4)
    distance = np.full(len(q), 0.2)
    distance[[0, 7]] = np.inf
    cost, damping, h = make_cost(ARM, ARM.description.path), 1e13, 1e-6

    def total(q: np.ndarray) -> float:
        miss = TASK_STIFFNESS * (compute_error(ARM, T, q).residual ** 2).sum()
        return float(point_cost(ARM, cost, q, distance, 0.1).sum() + miss)

    step = smooth_round(ARM, cost, T, q, distance, 0.1, np.full(len(q), damping)) - q
    gradient = np.empty(q.shape)
    for at in np.ndindex(q.shape):
        shift = np.zeros(q.shape)
        shift[at] = h
        gradient[at] = (total(q + shift) - total(q - shift)) / (4.0 * h)
    np.testing.assert_allclose(-step * damping * cost.metric, gradient, atol=1e-4 * np.abs(gradient).max())


def test_the_cheapest_route_is_that_of_dijkstra_where_every_leg_is_clear():
    rng = np.random.default_rng(9)
    nodes = ARM.zero_pose + rng.normal(0.0, 0.01, (25, ARM.n))
    price = rng.uniform(1.0, 9.0, (25, 25))
    price = np.where(rng.random((25, 25)) < 0.6, np.inf, price + price.T)
    price = np.minimum(price, price.T)
    model = ARM.description.clearance
    rule = freeze(
        LegRule(np.array([0.5]), np.full(ARM.n, 1e9), 0.06, model.least, model.least - 0.1, 0.0, 0.0)
    )
    route = kernel("route").search(ROOM.around(make_body(ARM)), rule, nodes, price, -1.0, 1)
    assert not len(route)  # given up after one look
    _, before = dijkstra(np.where(np.isfinite(price), price, 0.0), indices=0, return_predecessors=True)
    way = [1]
    while way[-1] != 0:
        way.append(int(before[way[-1]]))
    find = kernel("route")._find_way
    np.testing.assert_array_equal(find(price), way)
    lone = price.copy()
    lone[1], lone[:, 1] = np.inf, np.inf
    assert not len(find(lone))
    assert all(np.isfinite(price[a, b]) for a, b in pairwise(way))
