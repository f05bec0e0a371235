"""Calibration: what is wrong is found within its sigma, what cannot be found is refused by name."""

import msgspec
import numpy as np
import pytest
from machine_survey import ARM, CONFIG, PARAMETERS, draw_joints, survey

from ascrcp.core.errors import InputError
from ascrcp.devices.machine_link import load_can_config
from ascrcp.devices.sensor import SensorArray
from ascrcp.kinematics import load_arm, sagged_forward
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.calibration import NoGainError, calibrate
from ascrcp.kinematics.machine_file import encode_machine
from ascrcp.kinematics.observation import Observations, read_observations, write_observations
from ascrcp.kinematics.parameter import (
    change_description,
    derive_position,
    find_independent,
    find_sensor_zero,
    list_parameters,
    zero_change,
)
from ascrcp.simulation.rig import load_rig_config
from ascrcp.simulation.survey import draw_poses, survey_rig


@pytest.mark.parametrize("name", ["kc", "muck", "duct"])
def test_derivatives_are_those_of_the_forward_model(name: str):
    arm = load_arm(name)
    parameters = list_parameters(arm, CONFIG.expected)
    rng = np.random.default_rng(1)
    q, payload = draw_joints(arm, 20, rng), rng.uniform(0.0, 181.0, 20)
    D = derive_position(arm, q, payload, parameters)
    for column, parameter in enumerate(parameters):
        step = 1e-5 * parameter.expected

        def tip(way: float, parameter=parameter, step=step):
            change = np.array([way * step])
            moved = Arm(change_description(arm.description, [parameter], change))
            return sagged_forward(moved, q + zero_change(arm, [parameter], change), payload)[:, :3, 3]

        numeric = (tip(1.0) - tip(-1.0)) / (2.0 * step)
        np.testing.assert_allclose(D[..., column], numeric, atol=1e-7, err_msg=parameter.name)


def test_parameters_that_do_the_same_are_fitted_once():
    chosen, dropped = find_independent(ARM, list_parameters(ARM, CONFIG.expected), 181.0)
    assert dropped["tool: y"] == ["joint 8 nozzle tilt: zero", "tool: x"]
    assert dropped["joint 1 slew: z"] == ["joint 2 boom pitch: z"]
    rng = np.random.default_rng(2)
    q, payload = draw_joints(ARM, 300, rng), rng.uniform(0.0, 181.0, 300)
    D = derive_position(ARM, q, payload, chosen).reshape(-1, len(chosen)) * [p.expected for p in chosen]
    assert np.linalg.matrix_rank(D) == len(chosen) == 22


def test_centimetres_and_degrees_are_found_within_their_sigma():
    scores = []
    for seed in range(6):
        truth = survey(60, seed)
        found = calibrate(ARM, truth.seen, CONFIG)
        assert not found.set_aside and {c.name for c in found.changes} == {p.name for p in PARAMETERS}
        scores += [(c.after - c.before - truth.change[c.name]) / c.sigma for c in found.changes]
        assert found.before.mean_mm > 100.0 and found.after.mean_mm < 9.0 and found.held_out.mean_mm < 10.5
        assert 0.8 < found.noise_ratio < 1.2
    size = np.abs(scores)
    assert (size < 1.0).mean() > 0.6 and (size < 2.0).mean() > 0.93 and size.max() < 4.0


def test_exact_data_give_all_but_exact_numbers():
    parameters = [p for p in PARAMETERS if p.key != "exponent"]
    truth = survey(60, 3, noise=False, parameters=parameters)
    found = calibrate(ARM, truth.seen, CONFIG, hold=["sag: exponent"])
    for change in found.changes:
        miss = change.after - change.before - truth.change[change.name]
        assert abs(miss) < 0.2 * change.sigma, "only the weight of the file's own values is left"
    assert found.after.mean_mm < 0.5


def test_blunders_are_set_aside_by_line():
    truth = survey(80, 4)
    clean = calibrate(ARM, truth.seen, CONFIG)
    position = truth.seen.position.copy()
    rng = np.random.default_rng(0)
    bad = rng.choice(80, 8, replace=False)
    position[bad] += rng.choice([-1.0, 1.0], (8, 3)) * rng.uniform(0.1, 1.0, (8, 3))
    seen = Observations(truth.seen.q, truth.seen.payload_kg, position, truth.seen.line, "survey.csv")
    found = calibrate(ARM, seen, CONFIG)
    assert sorted(line for line, _ in found.set_aside) == sorted((bad + 2).tolist())
    assert all(miss > 0.1 for _, miss in found.set_aside)
    for a, b in zip(found.changes, clean.changes, strict=True):
        assert abs(a.after - b.after) < 3.0 * b.sigma


@pytest.mark.parametrize(
    ("still", "named"),
    [
        ({1: 0.0}, "joint 1 slew moved only 0.00..0.00 of -180..90 deg"),
        ({3: 0.5}, "joint 3 boom telescope moved only 0.50..0.50 of 0..1.9 m"),
        ({5: 0.0}, "joint 5 lance yaw moved only 0.00..0.00 of -37.5..37.5 deg"),
        ({7: 1.0}, "joint 7 nozzle roll moved only 57.30..57.30 of 0..360 deg"),
        ({8: 1.0}, "joint 8 nozzle tilt moved only"),
    ],
)
def test_a_joint_that_was_not_exercised_is_named(still: dict[int, float], named: str):
    with pytest.raises(InputError, match="do not determine") as error:
        calibrate(ARM, survey(80, 5, still=still).seen, CONFIG)
    assert named in str(error.value) and "--hold" in str(error.value)


def test_one_payload_only_is_named_and_may_be_held():
    seen = survey(60, 6, payload_kg=0.0).seen
    with pytest.raises(InputError, match=r"sag: load_mm_per_kg: payload_kg was only 0..0 kg"):
        calibrate(ARM, seen, CONFIG)
    found = calibrate(ARM, seen, CONFIG, hold=["sag: load_mm_per_kg"])
    assert found.held["sag: load_mm_per_kg"] == "held as asked"
    assert found.held_out.mean_mm < 11.0


def test_data_of_another_machine_or_frame_are_refused():
    truth = survey(60, 7)
    swapped = Observations(
        truth.seen.q,
        truth.seen.payload_kg,
        truth.seen.position[:, [1, 0, 2]].copy(),
        truth.seen.line,
        "s.csv",
    )
    with pytest.raises(InputError, match=r"s.csv: .*check columns, frame and units"):
        calibrate(ARM, swapped, CONFIG)


def test_a_machine_that_is_right_already_is_left_alone():
    with pytest.raises(NoGainError, match="predicts no better"):
        calibrate(ARM, survey(60, 8, parameters=[]).seen, CONFIG)


def test_a_stiff_arm_has_its_sag_set_to_zero():
    sag = [p for p in PARAMETERS if p.name == "sag: own_mm"]
    rng = np.random.default_rng(9)
    stiff = Arm(change_description(ARM.description, sag, np.array([-72.0])))
    q = draw_joints(ARM, 40, rng)
    payload = rng.uniform(0.0, 181.0, 40)
    position = sagged_forward(stiff, q, payload)[:, :3, 3] + [0.0, 0.0, 0.02]
    seen = Observations(q, payload, position, np.arange(2, 42), "stiff.csv")
    found = calibrate(ARM, seen, CONFIG, groups=["sag"])
    assert found.description.sag is not None and found.description.sag.own_mm == 0.0
    assert "set to 0" in found.held["sag: own_mm"]


def test_unknown_names_are_refused():
    seen = survey(60).seen
    with pytest.raises(InputError, match="no parameter 'elbow'"):
        calibrate(ARM, seen, CONFIG, hold=["elbow"])
    with pytest.raises(InputError, match="no group 'springs'"):
        calibrate(ARM, seen, CONFIG, groups=["springs"])


def test_sag_of_the_rig_is_found_and_holds_on_poses_not_fitted():
    """A tip 90 mm off comes under 10 mm: true nozzle against sensors with noise and steps."""
    rig = load_rig_config({"arm": {"flexure": {"sag_mm": 205.0}}})
    rng = np.random.default_rng(10)
    fitted, fresh = (
        survey_rig(rig, ARM, draw_poses(ARM, n, rng), rng.uniform(0.0, 181.0, n), 1, rng, prism)
        for n, prism in ((40, 0.003), (30, 0.0))
    )
    found = calibrate(ARM, fitted, CONFIG, groups=["sag"])

    def miss_mm(arm: Arm):
        tip = sagged_forward(arm, fresh.q, fresh.payload_kg)[:, :3, 3]
        return 1e3 * np.linalg.norm(fresh.position - tip, axis=1)

    before, after = miss_mm(ARM), miss_mm(Arm(found.description))
    assert before.mean() > 85.0
    assert after.mean() < 10.0
    assert found.description.sag is not None
    assert found.description.sag.exponent == pytest.approx(1.6, abs=0.15)


def test_zeros_of_the_rig_are_found_and_correct_its_sensors():
    """The rig's sensors read one degree wrong; with what was found they read right."""
    wrong = {"j1": 1.0, "j2": -0.8, "j4": 1.2, "j7": 0.9, "j8": -1.1}
    rig = load_rig_config(
        {"arm": {"joints": {name: {"sensor": {"zero": -zero}} for name, zero in wrong.items()}}}
    )
    rng = np.random.default_rng(11)
    poses = draw_poses(ARM, 60, rng)
    seen = survey_rig(rig, ARM, poses, rng.uniform(0.0, 181.0, 60), 1, rng)
    found = calibrate(ARM, seen, CONFIG)
    for change in found.changes:
        if change.unit == "deg":
            true = wrong.get(f"j{change.name.split()[1]}", 0.0)
            assert abs(change.after - true) < 3.5 * change.sigma, change
    zero = np.where(ARM.prismatic, found.sensor_zero, np.radians(found.sensor_zero))
    can = load_can_config()
    corrected = [
        msgspec.structs.replace(sensor, zero=sensor.zero - z / sensor.si_per_unit)
        for sensor, z in zip(can.sensors, zero, strict=True)
    ]
    plain, right = SensorArray(can.sensors, 0.02), SensorArray(corrected, 0.02)
    q = np.array([right.to_joints(plain.to_readings(tuple(row))) for row in seen.q])
    before, after = np.degrees(np.abs(seen.q - poses)), np.degrees(np.abs(q - poses))
    turning = ~ARM.prismatic
    assert before[:, turning].max() > 1.9 and after[:, turning].mean() < 0.1 and after[:, turning].max() < 0.5


def test_the_new_machine_file_is_the_old_one_with_the_changes(tmp_path):
    truth = survey(60, 12)
    data, new = tmp_path / "survey.csv", tmp_path / "new.yaml"
    write_observations(data, ARM, truth.seen)
    found = calibrate(ARM, read_observations(data, ARM), CONFIG)
    new.write_bytes(encode_machine("kc", data, found))
    arm = load_arm(new)
    q = draw_joints(ARM, 50, np.random.default_rng(0))
    np.testing.assert_allclose(arm.forward(q), Arm(found.description).forward(q), atol=1e-5)
    np.testing.assert_allclose(np.degrees(find_sensor_zero(arm))[~arm.prismatic].max(), 1.0, atol=0.3)
    assert arm.description.calibration is not None and arm.description.calibration.rows == 60
    assert arm.held == (5, 6), "still inverts in closed form"
    same = ("name", "lidar", "zero_pose", "path")
    assert all(getattr(arm.description, k) == getattr(ARM.description, k) for k in same)
    np.testing.assert_array_equal(find_sensor_zero(ARM), 0.0)


def test_a_second_calibration_adds_to_the_first(tmp_path):
    seen = survey(80, 13).seen
    data, new = tmp_path / "survey.csv", tmp_path / "new.yaml"
    write_observations(data, ARM, seen)
    first = calibrate(ARM, seen, CONFIG)
    new.write_bytes(encode_machine("kc", data, first))
    arm = load_arm(new)
    # the platform now shows corrected joints; meanwhile the slew's encoder slipped by half a degree
    shown = seen.q + np.linalg.solve(arm.limit_matrix, find_sensor_zero(arm))
    shown[:, 0] -= np.radians(0.5)
    again = Observations(shown, seen.payload_kg, seen.position, seen.line, "again.csv")
    second = calibrate(arm, again, CONFIG)
    assert second.before.mean_mm > 60.0
    assert second.after.mean_mm == pytest.approx(first.after.mean_mm, abs=0.1)
    np.testing.assert_allclose(second.sensor_zero - first.sensor_zero, [0.5, *[0.0] * 7], atol=0.02)


def test_dh_machines_can_be_calibrated_too():
    arm = load_arm("muck")
    parameters = find_independent(arm, list_parameters(arm, CONFIG.expected), 181.0)[0]
    truth = survey(40, 14, parameters=parameters, arm=arm)
    found = calibrate(arm, truth.seen, CONFIG)
    score = [(c.after - c.before - truth.change[c.name]) / c.sigma for c in found.changes]
    assert np.abs(score).max() < 4.0
