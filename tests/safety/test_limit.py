"""Limits, ranges and settings of the gate: what is refused, what is held back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from safety_machine import CONFIG_SAFETY, JOINTS, LIMITS, MIDDLE

from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import load_arm
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.gate import Gate
from ascrcp.safety.limit import LimitCheck, Limits, Range

CHECK = LimitCheck(LIMITS, CONFIG_SAFETY)
drives = st.lists(st.floats(-1, 1), min_size=JOINTS, max_size=JOINTS)


@given(drives)
def test_in_the_middle_nothing_is_held_back(drive):
    assert CHECK.hold_back(MIDDLE, drive) == (tuple(drive), False)


@given(drives, st.lists(st.floats(0, 1), min_size=JOINTS, max_size=JOINTS))
def test_holding_back_only_ever_shrinks_a_drive(drive, place):
    q = tuple(r.lower + u * (r.upper - r.lower) for r, u in zip(LIMITS.ranges, place, strict=True))
    allowed, held = CHECK.hold_back(q, drive)
    assert held == (allowed != tuple(drive)) or held
    for a, d in zip(allowed, drive, strict=True):
        assert a * d >= 0.0 and abs(a) <= abs(d)


@given(drives, st.integers(0, JOINTS - 1), st.sampled_from([1.0, -1.0]), st.floats(1e-9, 0.02))
def test_beyond_a_soft_limit_outward_is_zero_and_inward_is_free(drive, index, sign, beyond):
    r = LIMITS.ranges[index]
    slack = LIMITS.per_joint(CONFIG_SAFETY.soft_slack_deg, CONFIG_SAFETY.soft_slack_mm)[r.joints[0]]
    value = r.upper + slack + beyond if sign > 0 else r.lower - slack - beyond
    q = list(MIDDLE)
    q[r.joints[-1]] += value - r.value(q)
    allowed, _ = CHECK.hold_back(q, drive)
    for j in r.joints:
        if drive[j] * sign > 0.0:
            assert allowed[j] == 0.0
        elif index != 1 and index != 3:  # joints 2 and 4 share a range, the other end may be near
            assert allowed[j] == drive[j]


def test_hard_limit_is_a_degree_or_ten_millimetres_beyond():
    for i, r in enumerate(LIMITS.ranges):
        margin = math.radians(1.0) if LIMITS.is_revolute(r) else 0.01
        for edge, sign in ((r.upper, 1.0), (r.lower, -1.0)):
            for beyond, found in ((0.99, False), (1.01, True)):
                q = list(MIDDLE)
                q[r.joints[-1]] += edge + sign * margin * beyond - r.value(q)
                assert (i in CHECK.find_beyond(q)) == found
    assert CHECK.find_beyond((math.nan,) * JOINTS) == frozenset(range(JOINTS))


def test_limits_of_the_arm_hold_the_lance_inclination():
    arm = load_arm("kc")
    limits = Limits.of_arm(arm.joints, arm.max_speed)
    assert limits.revolute == (True, True, False, True, True, False, True, True)
    assert limits.ranges[3].joints == (1, 3)
    assert limits.ranges[3].upper == pytest.approx(math.radians(75.0))


@pytest.mark.parametrize("lower, upper", [(1.0, 1.0), (2.0, 1.0), (math.nan, 1.0), (0.0, math.inf)])
def test_ranges_must_be_finite_and_rise(lower, upper):
    with pytest.raises(ConfigError):
        Range((0,), lower, upper)


def test_limits_must_fit_the_joints():
    with pytest.raises(ConfigError):
        Limits((True,), (1.0, 1.0), ())
    with pytest.raises(ConfigError):
        Limits((True,), (1.0,), (Range((1,), 0.0, 1.0),))
    with pytest.raises(ConfigError):
        Limits((True,), (math.nan,), ())
    with pytest.raises(ConfigError):
        Gate(Limits((True,), (1.0,), ()), CONFIG_SAFETY)


@pytest.mark.parametrize(
    "change",
    [
        {"ramp": [0.1] * 7},
        {"ramp": [0.05] * 8},
        {"soft_slack_deg": 1.0},
        {"soft_slack_mm": 20.0},
        {"stale_ms": 0},
        {"drive_limit": [1.1] * 8},
        {"late_window": 65},
        {"recovery_drive": 0.0},
    ],
)
def test_settings_that_would_disarm_the_gate_are_refused(change):
    tree = read_yaml(CONFIG / "safety.yaml")
    with pytest.raises(ConfigError):
        convert({**tree, **change}, SafetyConfig, "safety.yaml")
