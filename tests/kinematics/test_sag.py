"""Static sag: monotonous, of the size the thesis measured, and exactly made up for."""

import numpy as np
import pytest

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import angle_between, check_transform
from ascrcp.kinematics import compensate, load_arm, sagged_forward
from ascrcp.kinematics.sag import compute_sag, sagged_lidar


def draw_joints(n: int) -> np.ndarray:
    arm = load_arm("kc")
    g = np.random.default_rng(0).uniform(arm.limit_lower, arm.limit_upper, (n, 8))
    return np.linalg.solve(arm.limit_matrix, g.T).T


@pytest.mark.parametrize("payload_kg", [0.0, 76.7, 181.0])
def test_the_compensated_target_sags_onto_the_wanted_pose(payload_kg: float):
    arm = load_arm("kc")
    q = draw_joints(300)
    sagged = sagged_forward(arm, q, payload_kg)
    check_transform(sagged)
    np.testing.assert_allclose(compensate(arm, sagged, payload_kg), arm.forward(q), atol=1e-12)


def test_the_tip_drops_and_pitches_down_and_stays_on_its_azimuth():
    arm = load_arm("kc")
    q = draw_joints(300)
    rigid, sagged = arm.forward(q), sagged_forward(arm, q, 181.0)
    assert (sagged[:, 2, 3] < rigid[:, 2, 3]).all()
    np.testing.assert_array_equal(sagged[:, :2, 3], rigid[:, :2, 3])
    level = np.zeros(8)  # everything along +x: the spray direction is level
    assert sagged_forward(arm, level)[2, 0] < 0.0
    assert angle_between(rigid[:, :3, 0], sagged[:, :3, 0]).max() < np.radians(1.5)


def test_sag_at_full_reach_is_of_the_class_of_table_2_1():
    model = load_arm("kc").description.sag
    assert model is not None
    drop, _ = compute_sag(model, np.array([6.0, 10.0, 13.0]))
    assert (np.diff(drop) > 0).all()
    assert 0.055 <= drop[2] <= 0.096
    loaded, _ = compute_sag(model, np.array([13.0]), 181.0)
    assert 0.017 <= loaded[0] - drop[2] <= 0.040  # 181 kg: 36 -> 53 mm in the mean, 80 -> 120 mm at most


@pytest.mark.parametrize("payload_kg", [-1.0, np.nan, np.inf, 1e5])
def test_bad_payloads_are_refused(payload_kg: float):
    with pytest.raises(InputError, match="payload"):
        sagged_forward(load_arm("kc"), np.zeros(8), payload_kg)


def test_an_arm_without_a_sag_model_is_rigid():
    arm = load_arm("muck")
    np.testing.assert_array_equal(sagged_forward(arm, np.ones(6), 50.0), arm.forward(np.ones(6)))


def test_a_payload_per_pose_is_the_same_as_one_by_one():
    arm = load_arm("kc")
    q, payload = draw_joints(20), np.linspace(0.0, 181.0, 20)
    one_by_one = [sagged_forward(arm, row, load) for row, load in zip(q, payload, strict=True)]
    np.testing.assert_allclose(sagged_forward(arm, q, payload), one_by_one, atol=1e-15)
    with pytest.raises(InputError, match="payload nan"):
        sagged_forward(arm, q, np.append(payload[:-1], np.nan))


def test_the_lidar_hangs_lower_than_the_rigid_arm_and_less_than_the_nozzle():
    arm = load_arm("kc")
    q = np.zeros(8)
    drop = arm.lidar(q)[2, 3] - sagged_lidar(arm, q)[2, 3]
    tip = arm.forward(q)[2, 3] - sagged_forward(arm, q)[2, 3]
    assert 0.0 < drop < tip
