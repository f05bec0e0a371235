import dataclasses

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ascrcp.core.errors import ConfigError, InputError, RefusedError, UnreachableError
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import Array, angle_between, rotation, transform
from ascrcp.kinematics import load_arm
from ascrcp.planning.dryrun import check_sequence
from ascrcp.planning.move import DIP_M, plan_move
from ascrcp.planning.parameter import load_parameters
from ascrcp.planning.timing import find_strokes, time_sequence

ARM = load_arm("kc")
PARAMETERS = load_parameters()
TIMING = PARAMETERS.timing


def solved_path(spacing: float = 0.2, passes: int = 3, roll: float = 0.0) -> tuple[SprayPath, Array]:
    """Build an S on the right side of a 5.9 m tunnel and joints for it: theta1, q5 and q6 held."""
    arc = np.radians(np.arange(20.0, 80.0, np.degrees(spacing / 5.9)))
    angle = np.concatenate([arc if k % 2 == 0 else arc[::-1] for k in range(passes)])
    index = np.repeat(np.arange(passes), len(arc))
    theta3 = np.pi - angle
    theta2 = np.radians(np.array([105.0, 90.0, 75.0])[index])
    s2 = np.sin(theta2)
    d = np.column_stack([np.cos(theta2), s2 * np.cos(theta3), s2 * np.sin(theta3)])
    wall = np.column_stack([11.0 + 0.3 * index, -5.9 * np.cos(angle), 5.9 * np.sin(angle) - 1.8])
    path = SprayPath(
        position=wall - d,
        theta2=theta2,
        theta3=theta3,
        station=wall[:, 0],
        angle=angle,
        bay=np.zeros(len(angle), dtype=np.int64),
        pass_index=index,
        overbreak=np.zeros(len(angle), dtype=bool),
    )
    R = rotation("x", theta3) @ rotation("z", theta2) @ rotation("x", np.full(len(angle), roll))
    found = ARM.inverse(transform(R, path.position), held={5: 0.0, 6: 0.5})
    q = np.full((len(angle), ARM.n), np.nan)
    for i in range(len(angle)):
        options = found.q[i][found.within_limits[i]]
        if len(options):
            before = q[i - 1] if i and np.isfinite(q[i - 1]).all() else options[0]
            q[i] = options[np.argmin(np.abs(options - before).max(axis=1))]
    return path, q


PATH, Q = solved_path()
NO_BREAK = np.zeros(len(PATH), dtype=bool)
SEQUENCE = time_sequence(ARM, PATH, Q, NO_BREAK, TIMING)


def test_the_tests_path_is_solved() -> None:
    assert np.isfinite(Q).all() and len(PATH) > 90


def test_rows_at_points_are_exactly_the_plan() -> None:
    rows = np.flatnonzero(SEQUENCE.point >= 0)
    np.testing.assert_array_equal(SEQUENCE.point[rows], np.arange(len(PATH)))
    np.testing.assert_array_equal(SEQUENCE.q[rows], Q)
    np.testing.assert_array_equal(SEQUENCE.position[rows], PATH.position)
    np.testing.assert_allclose(SEQUENCE.direction[rows], PATH.direction, atol=1e-15)


def test_joints_between_points_keep_the_pose() -> None:
    T = ARM.forward(SEQUENCE.q)
    assert np.linalg.norm(T[:, :3, 3] - SEQUENCE.position, axis=1).max() < 1e-4
    assert np.degrees(angle_between(T[:, :3, 0], SEQUENCE.direction)).max() < 0.01


def test_what_the_solver_adds_against_sag_is_kept() -> None:
    lifted = Q.copy()
    lifted[:, 1] += 0.008  # about 80 mm at the tip
    sequence = time_sequence(ARM, PATH, lifted, NO_BREAK, TIMING)
    lift = ARM.forward(sequence.q)[:, 2, 3] - sequence.position[:, 2]
    assert sequence.spraying[:-1].all() and lift.min() > 0.05 and np.ptp(lift) < 0.03
    rows = np.flatnonzero(sequence.point >= 0)
    np.testing.assert_array_equal(sequence.position[rows], PATH.position)


def nozzle_speed(sequence: JointSequence) -> Array:
    return np.linalg.norm(np.diff(sequence.position, axis=0), axis=1) / np.diff(sequence.t)


def test_nozzle_speed_is_constant_where_the_arm_allows_it() -> None:
    slow = msgspec.structs.replace(TIMING, nozzle_speed_m_s=0.05)
    path, q = solved_path(passes=1)
    v = nozzle_speed(time_sequence(ARM, path, q, np.zeros(len(path), dtype=bool), slow))
    assert v.max() < 0.0505
    assert np.median(v) == pytest.approx(0.05, rel=0.01)
    assert v[0] < 0.05 and v[-1] < 0.05  # starts and ends at rest
    assert nozzle_speed(SEQUENCE).max() < TIMING.nozzle_speed_m_s * 1.02


@given(st.floats(0.05, 2.0), st.floats(0.2, 1.0), st.sampled_from([0.1, 0.2, 0.4]))
@settings(max_examples=15, deadline=None)
def test_joint_limits_hold_at_any_speed(speed: float, fraction: float, spacing: float) -> None:
    p = msgspec.structs.replace(TIMING, nozzle_speed_m_s=speed, speed_fraction=fraction)
    path, q = solved_path(spacing)
    sequence = time_sequence(ARM, path, q, np.zeros(len(path), dtype=bool), p)
    rate = np.diff(sequence.q, axis=0) / np.diff(sequence.t)[:, None]
    assert (np.abs(rate) <= ARM.max_speed * fraction * 1.05).all()
    middle = (sequence.t[1:] + sequence.t[:-1]) / 2
    acceleration = np.diff(rate, axis=0) / np.diff(middle)[:, None]
    assert (np.abs(acceleration) <= ARM.max_acceleration).all()
    assert np.diff(sequence.t).max() <= p.row_s + 1e-9
    assert check_sequence(ARM, sequence, PARAMETERS.check).ok


def test_breaks_become_moves_without_spray() -> None:
    breaks = NO_BREAK.copy()
    breaks[40] = True
    q = Q.copy()
    q[60:70] = np.nan  # unsolved: 11 spacings, too far to spray across
    q[80] = np.nan  # one point: sprayed across
    sequence = time_sequence(ARM, PATH, q, breaks, TIMING)
    at = {point: row for row, point in enumerate(sequence.point) if point >= 0}
    assert set(at) == set(range(len(PATH))) - set(range(60, 70)) - {80}
    for before, after in ((39, 40), (59, 70)):
        assert not sequence.spraying[at[before] : at[after]].any() and sequence.spraying[at[after]]
        move = slice(at[before] + 1, at[after])
        T = ARM.forward(sequence.q[move])
        np.testing.assert_allclose(sequence.position[move], T[:, :3, 3], atol=1e-12)
        np.testing.assert_allclose(sequence.direction[move], T[:, :3, 0], atol=1e-12)
    assert sequence.spraying[at[79] : at[81]].all()
    assert not sequence.spraying[-1]
    assert check_sequence(ARM, sequence, PARAMETERS.check).ok


def test_moves_are_jerk_limited_and_end_at_rest() -> None:
    breaks = NO_BREAK.copy()
    breaks[1:] = True
    sequence = time_sequence(ARM, PATH, Q, breaks, TIMING)
    assert not sequence.spraying.any() and (np.sort(sequence.point)[-len(PATH) :] >= 0).all()
    assert check_sequence(ARM, sequence, PARAMETERS.check).ok


def test_strokes_do_not_join_bays_or_overbreak() -> None:
    bay = (np.arange(len(PATH)) >= 50).astype(np.int64)
    path = dataclasses.replace(PATH, bay=bay, overbreak=np.arange(len(PATH)) < 10)
    strokes = find_strokes(path, Q, NO_BREAK, 0.75)
    assert [int(s[0]) for s in strokes] == [0, 10, 50]


def test_no_solution_and_wrong_shapes_are_refused() -> None:
    with pytest.raises(UnreachableError, match="none of the"):
        time_sequence(ARM, PATH, np.full_like(Q, np.nan), NO_BREAK, TIMING)
    with pytest.raises(InputError, match="shape"):
        time_sequence(ARM, PATH, Q[:-1], NO_BREAK, TIMING)
    with pytest.raises(ConfigError, match="nozzle_speed_m_s"):
        time_sequence(ARM, PATH, Q, NO_BREAK, msgspec.structs.replace(TIMING, nozzle_speed_m_s=0.0))


def test_one_point_alone_is_a_sequence() -> None:
    q = np.full_like(Q, np.nan)
    q[7] = Q[7]
    sequence = time_sequence(ARM, PATH, q, NO_BREAK, TIMING)
    assert len(sequence.t) == 1 and sequence.point[0] == 7


def test_dry_run_finds_and_names_what_is_wrong() -> None:
    assert check_sequence(ARM, SEQUENCE, PARAMETERS.check).ok
    check_sequence(ARM, SEQUENCE, PARAMETERS.check).require()
    q = SEQUENCE.q.copy()
    q[30, 2] = 2.5
    q[50:, 6] -= 0.2
    run = check_sequence(ARM, dataclasses.replace(SEQUENCE, q=q), PARAMETERS.check)
    assert {(f.rule, f.joint) for f in run.findings} >= {("limit", 3), ("speed", 3), ("step", 3), ("step", 7)}
    limit = next(f for f in run.findings if f.rule == "limit")
    assert limit.row == 30 and limit.rows == 1 and "2500.0 mm" in limit.text and "1900.0 mm" in limit.text
    with pytest.raises(RefusedError, match="joint 3"):
        run.require()


def test_dry_run_watches_the_lance_inclination() -> None:
    q = SEQUENCE.q.copy()
    q[10, 1], q[10, 3] = np.radians(60.0), np.radians(30.0)  # each in its own range, the sum is not
    run = check_sequence(ARM, dataclasses.replace(SEQUENCE, q=q), PARAMETERS.check)
    assert ("limit", 4) in {(f.rule, f.joint) for f in run.findings}


def test_dry_run_refuses_another_arms_sequence() -> None:
    run = check_sequence(
        load_arm("duct"), dataclasses.replace(SEQUENCE, q=SEQUENCE.q[:, :6]), PARAMETERS.check
    )
    assert not run.ok and "6 joints" in run.findings[0].text


def test_same_input_same_sequence() -> None:
    again = time_sequence(ARM, PATH, Q, NO_BREAK, TIMING)
    assert again.t.tobytes() == SEQUENCE.t.tobytes() and again.q.tobytes() == SEQUENCE.q.tobytes()


def test_a_move_does_not_dip_toward_the_floor() -> None:
    # the roll turns half round at the same height: straight in joint space the nozzle would swing under
    start = np.radians([20.0, 5.0, 0.0, -5.0, 0.0, 0.0, 30.0, 100.0])
    end = np.radians([20.0, 5.0, 0.0, -5.0, 0.0, 0.0, 330.0, 100.0])
    start[[2, 5]] = end[[2, 5]] = 1.0, 0.5
    height = ARM.forward(np.linspace(start, end, 50))[:, 2, 3]
    ends = min(height[0], height[-1])
    assert height.min() < ends - 0.3
    duration, t, q = plan_move(ARM, start, end, TIMING)
    z = ARM.forward(q)[:, 2, 3]
    assert z.min() > ends - DIP_M
    assert (np.diff(t) > 0).all() and t[0] > 0 and t[-1] < duration
    assert ARM.within_limits(q, 1e-6).all()
    rate = np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None]
    assert (rate <= ARM.max_speed * TIMING.move_fraction * 1.001).all()
