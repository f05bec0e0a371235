"""Arms from their files: forward, Jacobian, frames, lidar mount, refusals."""

from pathlib import Path

import numpy as np
import pytest

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.geometry import check_transform, rotation, transform
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics import Arm, list_machines, load_arm

ARMS = ("kc", "muck", "duct")


def draw_joints(arm: Arm, n: int, seed: int = 0) -> np.ndarray:
    """Draw joint vectors within every range, the sums too."""
    g = np.random.default_rng(seed).uniform(arm.limit_lower, arm.limit_upper, (n, arm.n))
    return np.linalg.solve(arm.limit_matrix, g.T).T


def test_the_three_machines_are_known():
    assert set(ARMS) <= set(list_machines())


def test_kc_forward_is_the_product_of_its_steps():
    arm = load_arm("kc")
    for q in draw_joints(arm, 50):
        steps = [
            transform(rotation("z", q[0])),
            transform(rotation("y", -q[1]), np.array([0.35, 0.0, 0.60])),
            transform(None, np.array([4.50 + q[2], 0.0, 0.0])),
            transform(rotation("y", -q[3]), np.array([0.0, 0.0, -0.30])),
            transform(rotation("z", q[4]), np.array([0.40, 0.0, 0.0])),
            transform(None, np.array([4.50 + q[5], -0.20, 0.0])),
            transform(rotation("x", q[6])),
            transform(rotation("z", q[7]), np.array([0.35, 0.0, 0.0])),
            transform(None, np.array([0.80, 0.10, 0.15])),
        ]
        T = np.linalg.multi_dot(steps)
        np.testing.assert_allclose(arm.forward(q), T, atol=1e-12)
        np.testing.assert_allclose(arm.frames(q)[-1], T, atol=1e-12)
        np.testing.assert_allclose(arm.frames(q)[5], np.linalg.multi_dot(steps[:6]), atol=1e-12)


def test_muck_forward_is_the_papers_equation_2():
    arm = load_arm("muck")
    q = draw_joints(arm, 500)
    t1, t2, t3, d4, t5, t6 = q.T
    k1, k2, k3, k4, k5 = 0.58, 1.038, 1.0819, 0.107, 0.6666
    c1, s1, c2, s2, c3, s3 = np.cos(t1), np.sin(t1), np.cos(t2), np.sin(t2), np.cos(t3), np.sin(t3)
    c5, s5, c6, s6 = np.cos(t5), np.sin(t5), np.cos(t6), np.sin(t6)
    c23, s23, c56 = np.cos(t2 + t3), np.sin(t2 + t3), np.cos(t5 + t6)
    T = arm.forward(q)
    nx = c6 * (s1 * s5 - c5 * (c1 * s2 * s3 - c1 * c2 * c3)) + s6 * (c1 * c2 * s3 + c1 * c3 * s2)
    oy = s6 * (c1 * s5 + c5 * (s1 * s2 * s3 - c2 * c3 * s1)) + c6 * (c2 * s1 * s3 + c3 * s1 * s2)
    ax = -c5 * s1 - s5 * (c1 * s2 * s3 - c1 * c2 * c3)
    px = k2 * c1 + k3 * c1 * c2 + d4 * s23 * c1 + k5 * s6 * s23 * c1 + k4 * s23 * c1
    px = px + k5 * c6 * (s1 * s5 - c5 * (c1 * s2 * s3 - c1 * c2 * c3))
    pz = k3 * s2 - k4 * c23 + k5 * (c5 * c6 + s5 * s6) * s23 / 2 - d4 * c23
    pz = pz + k5 * c56 * s23 / 2 - k5 * c23 * s6 + k1
    for printed, ours in (
        (nx, T[:, 0, 0]),
        (oy, T[:, 1, 1]),
        (ax, T[:, 0, 2]),
        (px, T[:, 0, 3]),
        (pz, T[:, 2, 3]),
    ):
        np.testing.assert_allclose(ours, printed, atol=1e-12)
    np.testing.assert_allclose(T[:, 2, 0], c5 * c6 * s23 - s6 * c23, atol=1e-12)
    np.testing.assert_allclose(T[:, 2, 1], -c6 * c23 - c5 * s6 * s23, atol=1e-12)
    np.testing.assert_allclose(T[:, 2, 2], s5 * s23, atol=1e-12)


def test_muck_reaches_its_exact_depth():
    arm = load_arm("muck")
    q = np.array([0.0, np.pi / 2, np.pi / 2, 1.415, 0.0, np.pi / 2])
    assert arm.forward(q)[2, 3] == pytest.approx(3.8505, abs=1e-9)


def test_duct_is_straight_at_zero():
    arm = load_arm("duct")
    frames = arm.frames(np.zeros(8))
    np.testing.assert_allclose(
        frames[:8, 2, 3], [2.79, 3.13, 4.33, 4.522, 5.542, 5.68, 5.68, 6.64], atol=1e-12
    )
    np.testing.assert_allclose(frames[-1, :2, 3], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_jacobian_against_finite_differences(name: str):
    arm = load_arm(name)
    q = draw_joints(arm, 200, seed=1)
    J, h = arm.jacobian(q), 1e-6
    T = arm.forward(q)
    for i in range(arm.n):
        step = np.zeros(arm.n)
        step[i] = h
        ahead, behind = arm.forward(q + step), arm.forward(q - step)
        np.testing.assert_allclose(J[:, :3, i], (ahead - behind)[:, :3, 3] / (2 * h), atol=1e-7)
        W = (ahead - behind)[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2) / (2 * h)
        spin = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(J[:, 3:, i], spin, atol=1e-7)


@pytest.mark.parametrize("name", ARMS)
def test_one_pose_and_a_batch_agree(name: str):
    arm = load_arm(name)
    q = draw_joints(arm, 12).reshape(3, 4, arm.n)
    T, J, F = arm.forward(q), arm.jacobian(q), arm.frames(q)
    assert T.shape == (3, 4, 4, 4) and J.shape == (3, 4, 6, arm.n) and F.shape == (3, 4, arm.n + 1, 4, 4)
    check_transform(F)
    np.testing.assert_allclose(arm.forward(q[1, 2]), T[1, 2], atol=1e-14)
    np.testing.assert_allclose(arm.jacobian(q[1, 2]), J[1, 2], atol=1e-14)
    np.testing.assert_allclose(arm.frames(q[1, 2]), F[1, 2], atol=1e-14)


def test_kc_limits_the_lances_inclination_not_joint_4():
    arm = load_arm("kc")
    q = np.zeros(8)
    q[1], q[3] = np.radians(70.0), np.radians(-90.0)
    assert arm.within_limits(q)
    q[3] = np.radians(-96.0)
    assert not arm.within_limits(q)
    q[1], q[3] = np.radians(50.0), np.radians(26.0)
    assert not arm.within_limits(q)
    assert arm.lower[3] == pytest.approx(np.radians(-100.0))
    assert not arm.within_limits(np.full(8, np.nan))


def test_lidar_looks_from_the_end_of_joint_6():
    arm = load_arm("kc")
    q = draw_joints(arm, 5)
    moved = q.copy()
    moved[:, 6:] += 0.3
    np.testing.assert_array_equal(arm.lidar(q), arm.lidar(moved))
    offset = np.linalg.inv(arm.frames(q)[:, 5]) @ arm.lidar(q)
    np.testing.assert_allclose(offset, np.broadcast_to(offset[0], offset.shape), atol=1e-12)
    with pytest.raises(InputError, match="no lidar"):
        load_arm("muck").lidar(np.zeros(6))


def test_metadata_is_si():
    arm = load_arm("kc")
    assert arm.joints[0].number == 1 and arm.joints[0].name_zh
    assert arm.max_speed[0] == pytest.approx(np.radians(8.0)) and arm.max_speed[2] == 0.25
    assert arm.prismatic.tolist() == [False, False, True, False, False, True, False, False]
    assert arm.within_limits(arm.zero_pose)


@pytest.mark.parametrize("bad", [np.zeros(7), np.zeros((2, 9)), 0.0, [np.nan] * 8, [[0.0] * 7 + [np.inf]]])
def test_bad_joint_vectors_are_refused(bad):
    arm = load_arm("kc")
    for call in (arm.forward, arm.jacobian, arm.frames, arm.lidar):
        with pytest.raises(InputError):
            call(bad)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("travel_weight: 4.0", "travel_weight: -4.0", "travel_weight"),
        ("axis: z", "axis: w", "axis"),
        ("tool: [0.80, 0.10, 0.15]", "tool: [0.80, .nan, 0.15]", "finite"),
        ("kind: prismatic", "kind: screw", "screw"),
        ("range_deg: [-180.0, 90.0]", "range_deg: [90.0, -180.0]", "rise"),
        ("limit_sum: [2, 4]", "limit_sum: [5, 4]", "limit_sum"),
        ("name: kc", "name: kc\nspare: 1", "spare"),
        ("zero_pose: [0.0,", "zero_pose: [200.0,", "zero_pose"),
        ("translate: [0.0, 0.0, 0.0], axis: z", "axis: z", "translate"),
        ("range_deg: [-180.0, 90.0], ", "", "range_deg"),
        ("max_speed_deg_s: 8.0, ", "", "max_speed_deg_s"),
        ("range_deg: [-180.0, 90.0]", "range_deg: [-180.0, .inf]", "finite"),
        ("range_deg: [-180.0, 90.0]", "range_deg: [-180.0]", "range_deg"),
        ("axis: z", "axis: [0.0, 0.0, 2.0]", "axis"),
        ("axis: z", "axis: zz", "axis"),
        ("max_speed_deg_s: 8.0", "max_speed_deg_s: fast", "max_speed_deg_s"),
        ("joints:", "joints: []\nlinks:", "links|joints"),
    ],
)
def test_bad_machine_files_name_the_key(tmp_path: Path, old: str, new: str, message: str):
    text = (CONFIG / "machines" / "kc.yaml").read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "bad.yaml"
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_arm(file)
    said = str(caught.value)
    assert "\n" not in said and ("bad.yaml" in said or "machine kc" in said)


def test_unknown_machine_lists_the_known():
    with pytest.raises(ConfigError, match="kc"):
        load_arm("kd")
    with pytest.raises(ConfigError):
        load_arm("nowhere/arm.yaml")
