"""Joint sensors: wire values to SI and back, ranges of thesis table 5-7."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.config import convert
from ascrcp.core.errors import ConfigError
from ascrcp.devices.machine_link import load_can_config
from ascrcp.devices.sensor import STATUS_OK, SensorArray, SensorConfig

CONFIG = load_can_config()
SENSORS = SensorArray(CONFIG.sensors, CONFIG.range_margin)


def test_readings_become_the_joints_of_the_design():
    q = SENSORS.to_joints([-180.0, 30.0, 1900.0, -10.0, 375.0, 2200.0, 360.0, 240.0])
    degrees = [math.degrees(value) for value in q]
    assert q[2] == pytest.approx(1.9) and q[5] == pytest.approx(2.2)
    assert degrees[0] == pytest.approx(-180.0)
    assert degrees[3] == pytest.approx(-40.0)  # inclinometer 4 reads q2 + q4
    assert degrees[4] == pytest.approx(0.0, abs=1e-12)
    assert math.degrees(SENSORS.to_joints([0, 0, 0, 0, 750.0, 0, 0, 0])[4]) == pytest.approx(37.5)


@given(st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8))
def test_joints_to_readings_and_back(q):
    assert SENSORS.to_joints(SENSORS.to_readings(tuple(q))) == pytest.approx(q, abs=1e-12)


@pytest.mark.parametrize("joint", range(8))
def test_f6_range_has_two_percent_margin_and_wants_a_healthy_sensor(joint):
    c = CONFIG.sensors[joint]
    span = c.maximum - c.minimum
    for inside in (c.minimum - 0.019 * span, c.minimum, c.maximum, c.maximum + 0.019 * span):
        assert SENSORS.is_in_range(joint, inside, STATUS_OK)
        assert not SENSORS.is_in_range(joint, inside, 2.0)
    for outside in (c.minimum - 0.021 * span, c.maximum + 0.021 * span, math.nan, math.inf, 3276.7, -3276.8):
        assert not SENSORS.is_in_range(joint, outside, STATUS_OK)


@pytest.mark.parametrize(
    "change",
    [
        {"minimum": 5.0, "maximum": 5.0},
        {"kind": "cylinder", "unit": "mm"},
        {"deg_per_mm": 0.1},
        {"kind": "draw_wire", "unit": "deg"},
        {"sign": 2},
        {"colour": "red"},
    ],
)
def test_f39_a_sensor_that_contradicts_itself_is_refused(change):
    tree = {"kind": "encoder", "unit": "deg", "minimum": 0.0, "maximum": 10.0} | change
    with pytest.raises(ConfigError):
        convert(tree, SensorConfig, "test")


def test_a_sensor_cannot_contain_a_later_joint():
    tree = {"kind": "inclinometer", "unit": "deg", "minimum": 0.0, "maximum": 10.0, "relative_to": 1}
    with pytest.raises(ConfigError, match="earlier joint"):
        SensorArray([convert(tree, SensorConfig, "test")], 0.02)
