"""One joint: characteristic, PID, segments, pulses; accuracy of thesis tables 5-8 and 5-9."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plant import RESOLUTION, Plant, PlantSettings
from run import CONTROL

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.choice import CONTROLLERS, make_controller
from ascrcp.control.config import ControlConfig, JointConfig
from ascrcp.control.joint import Observer, Want
from ascrcp.control.pid import Gains, Pid
from ascrcp.control.segmented import SegmentedControl
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.machine_io import Command
from ascrcp.core.paths import CONFIG

D = math.radians(1.0)
NOMINAL = Characteristic(full_up=5 * D, full_down=4 * D, dead_up=0.05, dead_down=0.06)
speeds = st.floats(-3.9 * D, 3.9 * D)


def wish(error: float, measured: float, speed: float) -> Want:
    """A wish of a joint whose sensor is not late."""
    return Want(measured + error, speed, speed, measured, error)


@given(speeds)
def test_characteristic_inverts_beyond_the_softened_dead_band(speed):
    drive = NOMINAL.drive(speed)
    assert abs(drive) <= 1.0
    assert math.copysign(1.0, drive) == math.copysign(1.0, speed) or drive == 0.0
    if abs(speed) > 0.06 * D:
        assert NOMINAL.speed(drive) == pytest.approx(speed, rel=1e-9)


@given(speeds, speeds)
def test_characteristic_rises(a, b):
    assert NOMINAL.drive(min(a, b)) <= NOMINAL.drive(max(a, b))


@pytest.mark.parametrize("speed", [math.nan, math.inf, -math.inf])
def test_f15_speed_that_is_no_number_never_becomes_full_drive(speed):
    assert math.isnan(NOMINAL.drive(speed))
    for name in CONTROLLERS:
        joint = make_controller(msgspec.structs.replace(CONTROL.joints[6], controller=name))
        assert math.isnan(joint.drive(wish(math.nan, 0.0, 0.1)))
        assert abs(joint.drive(wish(0.001, 0.0, 0.1))) <= CONTROL.joints[6].ramp


def test_pid_is_equation_5_1():
    pid, gains = Pid(integral_max=10.0), Gains(kp=2.0, ti=0.5, td=0.1)
    errors = [0.3, 0.2, -0.1]
    total = 0.0
    for i, e in enumerate(errors):
        total += e * CYCLE_S
        rate = (e - errors[i - 1]) / CYCLE_S if i else 0.0
        assert pid.update(e, gains) == pytest.approx(2.0 * (e + total / 0.5 + 0.1 * rate))


def test_pid_integral_is_bounded_and_does_not_wind_up():
    pid, gains = Pid(integral_max=0.1), Gains(kp=2.0, ti=0.5)
    for _ in range(1000):
        assert pid.update(0.5, gains) <= 2.0 * 0.5 + 0.1 + 1e-12
    pid.clear()
    for _ in range(100):
        pid.update(0.5, gains, saturated=True)
    assert pid.update(0.0, gains) == 0.0
    pid.update(0.5, gains)
    before = pid.update(0.0, gains)
    pid.update(-0.1, gains, saturated=True)  # unwinding is allowed
    assert pid.update(0.0, gains) < before


@given(
    st.integers(0, 7), st.lists(st.tuples(st.floats(-3, 3), st.floats(-0.5, 0.5)), min_size=1, max_size=60)
)
def test_drive_never_exceeds_its_limit_or_its_ramp(number, steps):
    config = CONTROL.joints[number]
    for name in CONTROLLERS:
        if name == "pulsed" and config.pulse is None:
            continue
        joint = make_controller(msgspec.structs.replace(config, controller=name))
        last = 0.0
        for error, speed in steps:
            drive = joint.drive(wish(error, 0.5, speed))
            assert abs(drive) <= 1.0
            if name not in ("stick_slip", "pulsed"):
                assert abs(drive - last) <= config.ramp + 1e-12
            last = drive


def drive_to(plant: Plant, number: int, target: float, seconds: float, name: str) -> None:
    """Position control of one joint by set-point alone: thesis 5.1.3."""
    config = msgspec.structs.replace(CONTROL.joints[number], controller=name, rides_on=0)
    joint = make_controller(config)
    observer = Observer(1.0 - math.exp(-CYCLE_S / config.lag_s) if config.lag_s else 1.0)
    for _ in range(int(seconds / CYCLE_S)):
        q = plant.inputs().q
        error = observer.update(target, q[number])
        drive = joint.drive(Want(target, 0.0, 0.0, q[number], error))
        plant.step(Command(drive=tuple(drive if j == number else 0.0 for j in range(8)), enable=True))


SETTINGS = {
    "nominal": PlantSettings(),
    "fast": PlantSettings(gain=1.3, lag_s=0.15, dead_band=(0.03,) * 8),
    "slow": PlantSettings(gain=0.7, dead_band=(0.08,) * 8, frequency_hz=(4.0,) * 8, stiction=0.05),
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
@pytest.mark.parametrize("number", range(8))
@pytest.mark.parametrize("own", [True, False], ids=["own", "segmented"])
def test_joint_reaches_tables_5_8_and_5_9(number, settings, own):
    """0.1 deg or 1 mm as the sensor shows it, 0.2 deg for the pulsed joints, from both sides."""
    step = 0.3 if number not in (2, 5) else 0.15
    allowed = RESOLUTION[number] * (2.0 if number >= 6 else 1.0)
    for sign in (1.0, -1.0):
        start = (0.0, 0.3, 1.0, -0.1, 0.0, 1.0, 3.0, 2.0)
        plant = Plant(start, settings)
        target = start[number] + sign * step
        drive_to(plant, number, target, 16.0, CONTROL.joints[number].controller if own else "segmented")
        shown = plant.inputs().q[number]
        assert abs(shown - target) <= allowed + 0.51 * RESOLUTION[number]
        assert plant.speed[number] == 0.0


def test_segments_choose_gains_by_range_and_by_error():
    band = {"below": 1.0, "kp": 1.0}
    tree = {
        "name": "x", "unit": "deg", "full_speed": [10.0, 10.0], "dead_band": [0.0, 0.0], "lag_s": 0.0,
        "ramp": 1.0, "resolution": 0.001, "settle": 0.1, "slow": 1.0, "integral_max": 0.1,
        "segments": [
            {"to": 0.0, "bands": [band, {"below": 90.0, "kp": 2.0}]},
            {"to": 90.0, "bands": [{"below": 90.0, "kp": 3.0}], "offset": 0.01},
        ],
    }  # fmt: skip
    config = convert(tree, JointConfig, "test")
    for measured, error, kp, offset in ((-5, 0.5, 1.0, 0), (-5, 2.0, 2.0, 0), (5, 0.5, 3.0, 0.01)):
        drive = SegmentedControl(config).drive(wish(error * D, measured * D, 0.0))
        assert drive == pytest.approx(kp * error / 10.0 + offset)


@pytest.mark.parametrize(
    "change",
    [
        {"segments": []},
        {"segments": [{"to": 5.0, "bands": [{"below": 1.0, "kp": 1.0}]}] * 2},
        {"segments": [{"to": 5.0, "bands": []}]},
        {"full_speed": [0.0, 1.0]},
        {"dead_band": [0.5, 0.0]},
        {"ramp": 0.0},
        {"unit": "rad"},
        {"surprise": 1},
    ],
)
def test_bad_settings_are_refused(change):
    tree = read_yaml(CONFIG / "control" / "kc.yaml")
    tree["joints"][0] = {**tree["joints"][0], **change}
    with pytest.raises(ConfigError):
        convert(tree, ControlConfig, "kc.yaml")
