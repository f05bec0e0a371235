"""Rings inside a duct: gradient projection, collision feedback, the lever, the closed ring (duct paper 3)."""

import msgspec
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.geometry import transform
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.duct_bend import Bend, make_bend
from ascrcp.kinematics.duct_body import SphereBody
from ascrcp.kinematics.gradient_projection import LimitCost, approach, damped_inverse, pose_error, self_motion
from ascrcp.kinematics.ring import RingPlan, Scene, plan_plain, plan_ring
from ascrcp.kinematics.ring_parameter import load_ring_parameters
from ascrcp.kinematics.ring_program import RingProgram, close_ring
from ascrcp.kinematics.ring_sweep import find_acceleration, limit_acceleration
from ascrcp.kinematics.ring_target import Ring, find_lever, make_ring, spread_round, tilt_ring
from ascrcp.kinematics.ring_verdict import judge_ring

ARM = load_arm("duct")
PARAMETERS = load_ring_parameters()
P = PARAMETERS.projection
Q = np.array([0.4, 0.3, -0.2, -0.2, 0.6, 0.5, -0.8, -1.0])


@pytest.fixture(scope="module")
def scene() -> Scene:
    duct = make_bend("errata 3.3", PARAMETERS.bend)
    return Scene(ARM, SphereBody.of(ARM, PARAMETERS.body), duct, PARAMETERS)


@pytest.fixture(scope="module")
def ring(scene: Scene) -> Ring:
    at = float(np.interp(PARAMETERS.ring_z, scene.duct.centre[:, 2], scene.duct.station))
    return make_ring(scene.duct, at, PARAMETERS.count, PARAMETERS.stand_off)


@pytest.fixture(scope="module")
def clear(scene: Scene, ring: Ring) -> tuple[np.ndarray, RingPlan]:
    return plan_ring(scene, ring, np.random.default_rng(1))


@pytest.fixture(scope="module")
def closed(scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan]) -> RingPlan:
    return close_ring(scene, ring, clear[1])


def test_pose_error_is_the_step_between_poses():
    rng = np.random.default_rng(1)
    R = Rotation.random(50, random_state=1).as_matrix()
    turn = rng.uniform(-1.7, 1.7, (50, 3))
    p, step = rng.normal(size=(2, 50, 3))
    wanted = transform(Rotation.from_rotvec(turn).as_matrix() @ R, p + step)
    np.testing.assert_allclose(pose_error(transform(R, p), wanted), np.hstack([step, turn]), atol=1e-9)


def test_the_damped_inverse_is_exact_away_from_singular_poses_and_finite_in_them():
    """Errata 3.2: eq. 17 as printed misses J X = I by 3."""
    J = ARM.jacobian(Q)
    inverse, projector = damped_inverse(J, P)
    np.testing.assert_allclose(J @ inverse, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(J @ projector, 0.0, atol=1e-12)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-12)
    straight = damped_inverse(ARM.jacobian(np.zeros(8)), P)[0]
    assert np.abs(straight).max() <= 1 / (2 * P.damping) + 1e-9


def test_the_cost_rises_along_its_gradient_and_a_push_turns_the_joint_away():
    cost = LimitCost.of(ARM, P)
    for i in range(8):
        h = 1e-6 * np.eye(8)[i]
        slope = (cost.value(Q + h) - cost.value(Q - h)) / 2e-6
        assert cost.gradient(Q)[i] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    for joint in range(5):
        assert cost.push(Q, joint, True, P).gradient(Q)[joint] < 0.0  # descent raises the joint
        assert cost.push(Q, joint, False, P).gradient(Q)[joint] > 0.0
        assert cost.push(Q, joint, True, P).weight[joint] == 1.0
        assert cost.push(Q, joint, True, P).weight.min() == P.weight_floor


def test_approach_reaches_and_self_motion_holds_the_pose_and_strains_less():
    target = ARM.forward(Q + 0.1)
    cost = LimitCost.of(ARM, P)
    q = approach(ARM, Q, target, cost, P)
    np.testing.assert_allclose(ARM.forward(q), target, atol=1e-8)
    moved = self_motion(ARM, q, cost, P)
    assert cost.value(moved) < cost.value(q)
    assert np.abs(pose_error(ARM.forward(moved), target)).max() < 0.1 * P.rest_step
    far = target.copy()
    far[:3, 3] += 20.0
    with pytest.raises(UnreachableError, match="does not reach"):
        approach(ARM, Q, far, cost, P)


def test_the_lever_carries_the_joint_and_leaves_the_gun():
    rng = np.random.default_rng(2)
    for _ in range(20):
        gun, joint = rng.normal(size=(2, 3))
        lever = gun - joint
        escape = np.cross(lever, rng.normal(size=3))
        turn = find_lever(joint, gun, escape, 0.05)
        moved = Rotation.from_rotvec(turn).apply(joint - gun) + gun
        along = (moved - joint) @ escape / np.linalg.norm(escape)
        assert along == pytest.approx(0.05, rel=0.02)
    T = np.tile(transform(np.eye(3), np.array([1.0, 2.0, 3.0])), (4, 1, 1))
    np.testing.assert_array_equal(tilt_ring(T, rng.normal(size=(4, 3)))[:, :3, 3], T[:, :3, 3])


def test_tilts_are_spread_over_the_seam_in_steps():
    step = np.radians(3.0)
    tilt = np.zeros((12, 3))
    tilt[0] = [np.radians(8.0), 0.0, 0.0]
    size = np.linalg.norm(spread_round(tilt, step), axis=1)
    np.testing.assert_allclose(np.degrees(size), [8, 5, 2, 0, 0, 0, 0, 0, 0, 0, 2, 5], atol=1e-9)


def test_ring_poses_stand_off_square_to_the_wall(scene: Scene, ring: Ring):
    place, outward = ring.T[:, :3, 3], ring.T[:, :3, 2]
    n = len(place)
    gap = scene.duct.measure(place, np.zeros(n))
    np.testing.assert_allclose(gap.clearance, ring.stand_off, atol=2e-3)
    assert ((gap.inward * -outward).sum(axis=1) > np.cos(np.radians(3.0))).all()
    assert np.abs(scene.duct.measure(place + ring.stand_off * outward, np.zeros(n)).clearance).max() < 1e-3
    np.testing.assert_allclose(np.linalg.det(ring.T[:, :3, :3]), 1.0)
    steps = np.linalg.norm(np.diff(place + ring.stand_off * outward, axis=0), axis=1)
    assert np.ptp(steps) < 0.01 * steps.mean()


def test_a_stand_off_without_room_and_a_place_outside_are_refused(scene: Scene):
    with pytest.raises(InputError, match="stand-off"):
        make_ring(scene.duct, 2.0, 36, 0.9)
    with pytest.raises(InputError, match="station"):
        make_ring(scene.duct, 9.0, 36, 0.22)


def test_gradient_projection_alone_collides_where_the_errata_say(
    scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan]
):
    before = judge_ring(scene, ring, plan_plain(scene, ring, clear[0]))
    assert before.colliding == 28
    assert before.touching["J7"] == 16
    assert before.nearest == "J5" and before.clearance.min() == pytest.approx(-0.11, abs=0.02)
    assert before.place_error < 1e-8


def test_feedback_clears_the_ring_and_tilts_little(
    scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan]
):
    after = judge_ring(scene, ring, clear[1])
    assert after.colliding == 0
    assert after.clearance.min() >= PARAMETERS.margin and after.between >= PARAMETERS.margin
    assert after.place_error < 1e-8
    assert np.degrees(after.tilt.max()) == pytest.approx(7.08, abs=0.2)  # errata; the paper says < 12
    assert ARM.within_limits(clear[1].q).all()


def test_the_same_seed_gives_the_same_bits(scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan]):
    np.testing.assert_array_equal(plan_ring(scene, ring, np.random.default_rng(1))[1].q, clear[1].q)


def test_a_program_is_solved_to_its_optimum_and_contradictions_are_said():
    rng = np.random.default_rng(5)
    for _ in range(20):
        A, b = rng.normal(size=(9, 5)), rng.normal(size=9)
        G, inside = rng.normal(size=(8, 5)), rng.normal(size=5)
        h = G @ inside - rng.uniform(0.0, 0.5, 8)
        z = RingProgram(np.eye(5)[None], A, b, G, h).solve()[0]
        assert (G @ z >= h - 1e-8).all()
        peer = minimize(
            lambda x, A=A, b=b: float(((A @ x + b) ** 2).sum()),
            inside,
            constraints={"type": "ineq", "fun": lambda x, G=G, h=h: G @ x - h},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert ((A @ z + b) ** 2).sum() <= peer.fun * (1 + 1e-4) + 1e-9
    both = np.array([[1.0, 0, 0, 0, 0], [-1.0, 0, 0, 0, 0]])
    with pytest.raises(UnreachableError, match="contradict"):
        RingProgram(np.eye(5)[None], A, b, both, np.ones(2)).solve()


def test_the_closed_ring_closes_and_is_gentle(
    scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan], closed: RingPlan
):
    after, end = judge_ring(scene, ring, clear[1]), judge_ring(scene, ring, closed)
    assert end.open_end < 1e-12
    np.testing.assert_allclose(closed.q[-1] - closed.q[0], [0] * 7 + [2 * np.pi], atol=1e-12)
    assert end.clearance.min() >= PARAMETERS.margin and end.between >= PARAMETERS.margin
    assert end.place_error < 1e-9
    assert np.degrees(end.tilt.max()) < 12.0
    assert ARM.within_limits(closed.q).all()
    peak, before = np.abs(end.acceleration).max(axis=0), np.abs(after.acceleration).max(axis=0)
    assert (peak < before).all()
    assert peak[0] < 0.13 and peak[1:].max() < 0.48  # what the errata reach
    seam = np.vstack([closed.q[-2:] - (closed.q[-1] - closed.q[0]), closed.q[1:2]])
    assert np.abs(find_acceleration(seam, PARAMETERS.dt)).max() < 0.48


def test_a_cloud_of_the_wall_agrees_that_nothing_touches(scene: Scene, closed: RingPlan):
    """The judge here is another one: true distances to half a million points of the wall."""
    bend = PARAMETERS.bend
    fine = Bend(
        width=bend.width, height=bend.height, aside=bend.aside, bend=bend.bend, span=bend.span,
        contours=700, points=700,
    )  # fmt: skip
    wall = cKDTree(make_bend("fine", fine).contour.reshape(-1, 3))
    inside = scene.body.place(ARM, closed.q)
    inside = np.where(inside[..., 2:] > bend.span[0], inside, np.nan)
    distance = wall.query(np.nan_to_num(inside, nan=1e6))[0] - scene.body.radius
    assert 0.004 < distance.min() < 0.012


def test_sweeps_lower_the_paper_s_function_and_keep_poses_and_clearances(
    scene: Scene, ring: Ring, clear: tuple[np.ndarray, RingPlan]
):
    def cost(plan: RingPlan) -> float:
        acceleration = find_acceleration(plan.q, PARAMETERS.dt)
        over = np.abs(acceleration) - PARAMETERS.sweep.alpha * ARM.max_acceleration
        return float((np.maximum(over, 0.0) ** 2).sum())

    few = msgspec.structs.replace(PARAMETERS, sweep=msgspec.structs.replace(PARAMETERS.sweep, sweeps=30))
    gentle = limit_acceleration(Scene(scene.arm, scene.body, scene.duct, few), clear[1])
    assert cost(gentle) < 0.3 * cost(clear[1])
    np.testing.assert_allclose(ARM.forward(gentle.q[:-1]), clear[1].T, atol=1e-8)
    assert judge_ring(scene, ring, gentle).clearance.min() >= PARAMETERS.margin


def test_a_ring_that_nothing_clears_says_so(scene: Scene, ring: Ring):
    thick = msgspec.structs.replace(
        PARAMETERS,
        starts=1,
        ring_rounds=2,
        pose_rounds=3,
        body=msgspec.structs.replace(PARAMETERS.body, joint_radius=0.4),
    )
    crowded = Scene(ARM, SphereBody.of(ARM, thick.body), scene.duct, thick)
    with pytest.raises(UnreachableError, match=r"stay nearer to the wall|more than 30 deg"):
        plan_ring(crowded, ring, np.random.default_rng(1))
