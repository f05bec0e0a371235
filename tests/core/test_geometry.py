"""Rotations, transforms, profile: properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.flow import Axis, JointSequence
from ascrcp.core.geometry import (
    angle_between,
    check_transform,
    inverse_transform,
    rotation,
    transform,
    unit,
    wrap_angle,
)
from ascrcp.core.profile import Arc, Profile, section_angle

ANGLE = st.floats(-10, 10)


@given(ANGLE, ANGLE, ANGLE)
def test_inverse_transform_undoes(a: float, b: float, c: float) -> None:
    T = transform(rotation("x", a) @ rotation("y", b) @ rotation("z", c), np.array([a, b, c]))
    assert np.allclose(T @ inverse_transform(T), np.eye(4), atol=1e-12)
    check_transform(T)


@given(ANGLE)
def test_wrap_angle_keeps_direction(a: float) -> None:
    w = float(wrap_angle(a))
    assert -np.pi < w <= np.pi
    assert np.isclose(np.cos(w), np.cos(a)) and np.isclose(np.sin(w), np.sin(a), atol=1e-9)


@pytest.mark.parametrize("bad", [np.eye(3), np.full((4, 4), np.nan), np.diag([1, 1, -1, 1]), 2 * np.eye(4)])
def test_check_transform_refuses(bad: np.ndarray) -> None:
    with pytest.raises(InputError):
        check_transform(bad)


def test_angle_between_is_accurate_near_zero() -> None:
    a, b = np.array([1.0, 0, 0]), unit(np.array([1.0, 1e-9, 0]))
    assert np.isclose(angle_between(a, b), 1e-9, rtol=1e-6)


THREE_CENTRE = Profile(
    name="three-centre",
    arcs=[
        Arc(centre=(3.0, 0.0), radius=8.0, start_deg=-20, end_deg=20),
        Arc(
            centre=(0.0, float(3.0 * np.tan(np.radians(20)))),
            radius=8.0 - 3.0 / np.cos(np.radians(20)),
            start_deg=20,
            end_deg=160,
        ),
        Arc(centre=(-3.0, 0.0), radius=8.0, start_deg=160, end_deg=200),
    ],
)


@given(st.floats(0.001, 0.999), st.floats(-0.5, 0.5))
def test_profile_locate_inverts_point(fraction: float, offset: float) -> None:
    along = np.array([fraction * THREE_CENTRE.length])
    found, off = THREE_CENTRE.locate(THREE_CENTRE.point(along, offset))
    assert np.allclose(found, along, atol=1e-6) and np.allclose(off, offset, atol=1e-9)


def test_profile_refuses_gaps_and_inverted_lines() -> None:
    arc = Arc(centre=(0, 0), radius=5.0, start_deg=0, end_deg=90)
    with pytest.raises(ConfigError, match="arc 1 starts"):
        Profile(name="gap", arcs=[arc, Arc(centre=(0, 0), radius=5.2, start_deg=90, end_deg=180)])
    with pytest.raises(ConfigError, match="arch_line"):
        Profile(name="lines", arcs=[arc], arch_line=0.2, overbreak_line=0.1)


def test_section_angle_runs_from_right_over_crown_to_left() -> None:
    yz = np.array([[-1.0, 0], [0, 1], [1, 0], [1, -0.5], [-1, -0.5]])
    assert np.allclose(np.degrees(section_angle(yz)), [0, 90, 180, 180 + 26.565, -26.565], atol=1e-3)


def test_tunnel_frame_is_right_handed_and_level() -> None:
    T = Axis(point=np.array([1.0, 2, 3]), direction=unit(np.array([1.0, 0.1, -0.02]))).T_base_tunnel
    check_transform(T)
    assert T[2, 1] == 0.0 and T[2, 2] > 0.99


def test_joint_sequence_refuses_bad_time_and_nan() -> None:
    good = {"t": np.array([0.0, 1]), "q": np.zeros((2, 8)), "position": np.zeros((2, 3))}
    good |= {"direction": np.zeros((2, 3)), "point": np.array([0, 1]), "spraying": np.array([True, False])}
    sequence = JointSequence(**good)
    with pytest.raises(ValueError, match="read-only"):
        sequence.q[0, 0] = 1.0
    assert sequence.flow.tolist() == [1.0, 0.0]
    for name, bad in (
        ("t", np.array([0.0, 0.0])),
        ("q", np.full((2, 8), np.nan)),
        ("q", np.zeros((3, 8))),
        ("flow", np.array([1.1, 0.0])),
        ("flow", np.array([0.5, 0.5])),
    ):
        with pytest.raises(InputError, match=r"JointSequence\."):
            JointSequence(**{**good, name: bad})
