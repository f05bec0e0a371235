"""Closed-form inverses: every real solution, confirmed, the generating one always among them."""

from pathlib import Path

import numpy as np
import pytest

from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics import Arm, Solutions, choose_solution, load_arm

KC_HELD, MUCK_HELD = (5, 6), ()


def draw_joints(arm: Arm, n: int, seed: int = 0) -> np.ndarray:
    g = np.random.default_rng(seed).uniform(arm.limit_lower, arm.limit_upper, (n, arm.n))
    return np.linalg.solve(arm.limit_matrix, g.T).T


def invert(arm: Arm, q: np.ndarray, near: np.ndarray | None = None) -> tuple[np.ndarray, Solutions]:
    T = arm.forward(q)
    held = {5: q[:, 4], 6: q[:, 5]} if arm.name == "kc" else None
    return T, arm.inverse(T, held, near)


def distance_to(arm: Arm, solutions: Solutions, q: np.ndarray) -> np.ndarray:
    """Least distance of a within-limits solution from q, angles modulo a turn, shape (N,)."""
    gap = np.abs(solutions.q - q[:, None])
    turning = ~arm.prismatic
    gap[..., turning] = np.abs((gap[..., turning] + np.pi) % (2 * np.pi) - np.pi)
    return np.where(solutions.within_limits, gap.max(axis=-1), np.inf).min(axis=1)


def assert_sound(arm: Arm, T: np.ndarray, solutions: Solutions) -> None:
    """Whatever is marked valid is finite and reaches the pose."""
    i, k = np.nonzero(solutions.valid)
    reached = arm.forward(solutions.q[i, k])
    assert np.abs(reached - T[i]).max() <= 1e-10
    assert np.isnan(solutions.q[~solutions.valid]).all()
    assert not (solutions.within_limits & ~solutions.valid).any()


@pytest.mark.parametrize("name", ["kc", "muck"])
def test_generating_joints_are_always_found(name: str):
    arm = load_arm(name)
    q = draw_joints(arm, 8000)
    T, solutions = invert(arm, q)
    assert solutions.q.shape == (8000, 8, arm.n)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-8


@pytest.mark.parametrize("name", ["kc", "muck"])
def test_a_pose_has_four_or_eight_real_solutions(name: str):
    arm = load_arm(name)
    _, solutions = invert(arm, draw_joints(arm, 3000, seed=2))
    assert set(solutions.valid.sum(axis=1).tolist()) == {4, 8}


def test_muck_has_one_solution_within_its_limits():
    arm = load_arm("muck")
    _, solutions = invert(arm, draw_joints(arm, 3000, seed=3))
    assert (solutions.within_limits.sum(axis=1) == 1).all()


@pytest.mark.parametrize("name", ["kc", "muck"])
def test_joints_on_their_limits_are_found(name: str):
    arm = load_arm(name)
    rng = np.random.default_rng(4)
    g = rng.uniform(arm.limit_lower, arm.limit_upper, (4000, arm.n))
    ends = np.where(rng.random(g.shape) < 0.5, arm.limit_lower, arm.limit_upper)
    g = np.where(rng.random(g.shape) < 0.5, ends, g)
    q = np.linalg.solve(arm.limit_matrix, g.T).T
    T, solutions = invert(arm, q, near=q)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-5


@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
def test_near_the_tilt_pitch_singularity(offset: float):
    """q5 = 0 and q7 = 90 or 270 deg: the tilt axis is parallel to the pitch axes."""
    arm = load_arm("kc")
    q = draw_joints(arm, 400, seed=5)
    q[:, 4] = 0.0
    q[:, 6] = np.where(np.arange(400) % 2, np.pi / 2, 3 * np.pi / 2) + offset
    T, solutions = invert(arm, q, near=q)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-5


def test_a_singular_pose_without_a_reference_still_has_solutions():
    arm = load_arm("kc")
    q = draw_joints(arm, 400, seed=6)
    q[:, 4], q[:, 6] = 0.0, np.pi / 2
    T, solutions = invert(arm, q)
    assert_sound(arm, T, solutions)
    assert solutions.valid.any(axis=1).all()


@pytest.mark.parametrize("yaw_deg", [-37.5, -12.0, 20.0])
def test_on_the_fold_of_the_roll(yaw_deg: float):
    """q7 = 90 deg with the lance yawed: two solutions meet, none is lost."""
    arm = load_arm("kc")
    q = draw_joints(arm, 400, seed=7)
    q[:, 4], q[:, 6] = np.radians(yaw_deg), np.pi / 2
    T, solutions = invert(arm, q)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-5


def test_muck_with_the_wrist_straight_follows_the_reference():
    arm = load_arm("muck")
    q = draw_joints(arm, 400, seed=8)
    q[:, 4] = 0.0
    T, solutions = invert(arm, q, near=q)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-6


def test_unreachable_poses_have_no_solution_and_no_nan_is_valid():
    arm = load_arm("kc")
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, 3] = [[40.0, 0.0, 0.0], [0.0, 0.0, 0.0], [10.0, 0.0, 30.0]]
    solutions = arm.inverse(T, {5: 0.0, 6: 1.0})
    assert_sound(arm, T, solutions)
    assert not solutions.within_limits.any()


@pytest.mark.parametrize("name", ["kc", "muck"])
def test_poses_read_from_text_are_taken_as_the_nearest_rotation(name: str):
    arm = load_arm(name)
    q = draw_joints(arm, 500, seed=12)
    exact = arm.forward(q)
    T = np.round(exact, 7)
    solutions = arm.inverse(T, {5: q[:, 4], 6: q[:, 5]} if name == "kc" else None)
    i, k = np.nonzero(solutions.valid)
    reached = arm.forward(solutions.q[i, k])
    assert np.abs(reached - T[i]).max() < 2e-7
    np.testing.assert_allclose(reached[:, :3, 3], T[i, :3, 3], atol=1e-10)
    # rounding may only lose a solution where two of them meet
    assert (solutions.within_limits.any(axis=1)).mean() > 0.99


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda T: T[..., :3, :], "shape"),
        (lambda T: T[None], "shape"),
        (lambda T: T * np.nan, "finite"),
        (lambda T: np.where(np.eye(4)[3], np.inf, T), "finite"),
        (lambda T: T @ np.diag([1.0, 1.0, -1.0, 1.0]), "determinant"),
        (lambda T: T @ np.diag([1.01, 1.0, 1.0, 1.0]), "rotation"),
        (lambda T: np.concatenate([T[:, :3], T[:, 3:] + 0.5], axis=1), "last row"),
    ],
)
def test_what_is_no_pose_is_refused_in_one_line(change, message: str):
    arm = load_arm("kc")
    T = np.repeat(arm.forward(np.zeros((1, 8))), 3, axis=0)
    bad = change(T)
    if bad.shape == T.shape:
        bad[0] = T[0]  # one bad pose is enough
    with pytest.raises(InputError, match=message) as caught:
        arm.inverse(bad, {5: 0.0, 6: 0.0})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("near", [np.zeros(7), np.zeros((2, 8)), np.full(8, np.nan)])
def test_a_bad_reference_is_refused(near: np.ndarray):
    arm = load_arm("kc")
    with pytest.raises(InputError):
        arm.inverse(arm.forward(np.zeros((3, 8))), {5: 0.0, 6: 0.0}, near)


def test_no_poses_give_no_solutions():
    found = load_arm("kc").inverse(np.zeros((0, 4, 4)), {5: 0.0, 6: 0.0})
    assert found.q.shape == (0, 8, 8) and found.valid.shape == (0, 8)


def test_held_joints_are_kept_and_may_differ_by_pose():
    arm = load_arm("kc")
    q = draw_joints(arm, 20, seed=9)
    T, solutions = invert(arm, q)
    for i in range(20):
        one = arm.inverse(T[i], {5: float(q[i, 4]), 6: float(q[i, 5])})
        np.testing.assert_allclose(one.q[0], solutions.q[i], atol=1e-9)
    kept = solutions.q[solutions.valid]
    which = np.nonzero(solutions.valid)[0]
    np.testing.assert_array_equal(kept[:, 4:6], q[which, 4:6])


def test_another_machine_of_the_same_structure_is_derived_from_its_file(tmp_path: Path):
    text = (CONFIG / "machines" / "kc.yaml").read_text(encoding="utf-8")
    changed = {
        "translate: [0.0, 0.0, 0.0], axis: z": "translate: [0.1, -0.2, 0.3], axis: z",
        "translate: [0.35, 0.0, 0.60]": "translate: [0.45, 0.05, 0.70]",
        "translate: [4.50, 0.0, 0.0]": "translate: [3.90, 0.07, 0.11]",
        "translate: [0.0, 0.0, -0.30]": "translate: [0.20, -0.04, -0.35]",
        "translate: [0.40, 0.0, 0.0]": "translate: [0.33, 0.02, 0.06]",
        "translate: [4.50, -0.20, 0.0]": "translate: [4.10, -0.15, 0.09]",
        "translate: [0.0, 0.0, 0.0], axis: x": "translate: [0.12, 0.03, -0.05], axis: x",
        "tool: [0.80, 0.10, 0.15]": "tool: [0.70, -0.12, 0.08]",
    }
    for old, new in changed.items():
        assert old in text
        text = text.replace(old, new, 1)
    file = tmp_path / "kd.yaml"
    file.write_text(text, encoding="utf-8")
    arm = load_arm(file)
    q = draw_joints(arm, 2000, seed=10)
    T, solutions = invert(arm, q)
    assert_sound(arm, T, solutions)
    assert distance_to(arm, solutions, q).max() < 1e-8


def test_an_arm_without_closed_form_says_so(tmp_path: Path):
    duct = load_arm("duct")
    with pytest.raises(InputError, match="closed-form"):
        duct.inverse(duct.forward(np.zeros(8)))
    text = (CONFIG / "machines" / "kc.yaml").read_text(encoding="utf-8")
    file = tmp_path / "offset.yaml"
    file.write_text(
        text.replace("translate: [0.35, 0.0, 0.0], axis: z", "translate: [0.35, 0.1, 0.0], axis: z")
    )
    arm = load_arm(file)
    with pytest.raises(InputError, match="closed-form"):
        arm.inverse(arm.forward(np.zeros(8)), {5: 0.0, 6: 1.0})


@pytest.mark.parametrize(
    "held", [None, {}, {5: 0.0}, {5: 0.0, 7: 0.0}, {5: np.nan, 6: 1.0}, {5: [0.0, 1.0], 6: 1.0}]
)
def test_wrong_held_joints_are_refused(held):
    arm = load_arm("kc")
    with pytest.raises(InputError, match="held"):
        arm.inverse(arm.forward(np.zeros((3, 8))), held)


def test_bad_poses_are_refused():
    arm = load_arm("kc")
    good = arm.forward(np.zeros(8))
    mirror, shear, nan = good.copy(), good.copy(), good.copy()
    mirror[:3, 0] *= -1.0
    shear[0, 1] += 0.01
    nan[0, 3] = np.nan
    for bad in (mirror, shear, nan, np.eye(3), np.zeros((2, 2, 4, 4)), np.zeros((4, 4))):
        with pytest.raises(InputError):
            arm.inverse(bad, {5: 0.0, 6: 1.0})


def test_a_pose_rounded_as_text_is_solved():
    arm = load_arm("kc")
    q = draw_joints(arm, 300, seed=11)
    T = np.round(arm.forward(q), 7)
    solutions = arm.inverse(T, {5: q[:, 4], 6: q[:, 5]})
    assert distance_to(arm, solutions, q).max() < 1e-2
    assert np.median(distance_to(arm, solutions, q)) < 1e-6


def test_choice_takes_the_least_weighted_travel_and_keeps_directions():
    arm = load_arm("kc")
    q = draw_joints(arm, 500, seed=12)
    _, solutions = invert(arm, q)
    for i in range(0, 500, 25):
        row = Solutions(*(getattr(solutions, f)[i : i + 1] for f in ("q", "valid", "within_limits")))
        np.testing.assert_allclose(np.sin(choose_solution(arm, row, q[i])[0]), np.sin(q[i]), atol=1e-6)
    # two postures as far from the previous one: the one that goes on in the same direction wins
    before, step = np.zeros(8), np.zeros(8)
    step[7] = 0.1
    pair = np.stack([before - step, before + step])[None]
    flags = np.ones((1, 2), dtype=bool)
    chosen = choose_solution(arm, Solutions(pair, flags, flags), before, step)
    np.testing.assert_array_equal(chosen[0], before + step)
    with pytest.raises(UnreachableError):
        choose_solution(arm, Solutions(pair, flags, ~flags), before)


def test_choice_moves_the_small_joint_rather_than_the_large_one():
    arm = load_arm("kc")
    base, nozzle = np.zeros(8), np.zeros(8)
    base[0], nozzle[7] = 0.1, 0.1
    pair = np.stack([base, nozzle])[None]
    flags = np.ones((1, 2), dtype=bool)
    np.testing.assert_array_equal(choose_solution(arm, Solutions(pair, flags, flags), np.zeros(8))[0], nozzle)
