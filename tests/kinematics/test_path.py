"""Whole paths: the thesis's table, an S round a tunnel, breaks, reasons, cancelling."""

import dataclasses

import numpy as np
import pytest

from ascrcp.core.errors import CancelledError, InputError
from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import angle_between, rotation
from ascrcp.kinematics import Arm, PathSolution, load_arm, sagged_forward, solve_path, spray_pose
from ascrcp.kinematics.smooth import make_cost, smooth_chain

# thesis table 4-1: X, Y, Z [mm], theta3 [deg]; theta2 = 75 deg in every row
TABLE_4_1 = """
9175.918 -3831.831 2187.038 127.307
9175.189 -3768.656 2275.960 126.960
9174.422 -3702.175 2321.279 126.153
9173.967 -3662.730 2364.890 125.695
9173.531 -3625.044 2403.777 125.073
9172.417 -3528.524 2453.670 124.410
9171.726 -3468.579 2535.995 123.939
9170.822 -3390.332 2595.692 123.527
9169.688 -3212.954 2641.148 122.592
9168.775 -3150.233 2690.228 121.822
9168.051 -3150.233 2726.958 121.149
9167.242 -3080.187 2761.823 120.290
9166.022 -2974.496 2817.621 118.832
9165.426 -2922.825 2845.153 118.215
9164.377 -2831.943 2878.881 117.327
9163.639 -2767.940 2926.017 116.652
9162.953 -2708.594 2952.982 116.081
9161.980 -2624.305 2999.400 115.111
9161.334 -2568.261 3027.534 114.820
9160.058 -2457.674 3095.819 113.557
"""


def make_path(position: np.ndarray, theta2: np.ndarray, theta3: np.ndarray, **more: np.ndarray) -> SprayPath:
    n = len(position)
    fields = {
        "station": position[:, 0],
        "angle": np.zeros(n),
        "bay": np.zeros(n, dtype=np.int64),
        "pass_index": np.zeros(n, dtype=np.int64),
        "overbreak": np.zeros(n, dtype=bool),
    }
    return SprayPath(position=position, theta2=theta2, theta3=theta3, **{**fields, **more})


def table_path() -> SprayPath:
    rows = np.array(TABLE_4_1.split(), dtype=float).reshape(20, 4)
    return make_path(rows[:, :3] / 1000.0, np.full(20, np.radians(75.0)), np.radians(rows[:, 3]))


def round_tunnel(
    seam_deg: float = 180.0,
    spacing: float = 0.2,
    stations: np.ndarray | None = None,
    R_base_tunnel: np.ndarray | None = None,
) -> SprayPath:
    """S path 1 m off a wall of radius 5.9 m whose axis lies 1.85 m below the base, split at the seam."""
    stations = np.arange(10.2, 13.21, 0.3) if stations is None else stations
    phi = np.radians(np.linspace(-20.0, 200.0, int(np.radians(220.0) * 5.9 / spacing) + 2))
    rows = []
    for part, span in enumerate((phi[phi <= np.radians(seam_deg)], phi[phi > np.radians(seam_deg)])):
        for k, s in enumerate(stations):
            for angle in span if k % 2 == 0 else span[::-1]:
                rows.append((s, angle, part * len(stations) + k))
    s, angle, run = np.array(rows).T
    R = np.eye(3) if R_base_tunnel is None else R_base_tunnel
    local = np.stack([s, -4.9 * np.cos(angle), 4.9 * np.sin(angle)], axis=-1)
    return make_path(
        local @ R.T + [0.0, 0.0, -1.85],
        np.full(len(s), np.pi / 2),
        np.arctan2(np.sin(angle), -np.cos(angle)),
        station=s,
        angle=angle,
        pass_index=run.astype(np.int64),
        R_base_tunnel=R,
    )


def assert_on_path(arm: Arm, path: SprayPath, solution: PathSolution, payload_kg: float = 0.0) -> None:
    """Solved points keep every limit and the sagged arm meets the planned pose."""
    ok = solution.solved
    assert arm.within_limits(solution.q[ok]).all()
    reached = sagged_forward(arm, solution.q[ok], payload_kg)
    assert np.abs(reached[:, :3, 3] - path.position[ok]).max() < 2e-6
    assert angle_between(reached[:, :3, 0], path.direction[ok]).max() < 5e-6
    planned = spray_pose(path, solution.theta1)[ok]
    assert np.abs(reached[:, :3, 1] - planned[:, :3, 1]).max() < 1e-3
    assert np.isnan(solution.q[~ok]).all()
    assert all((reason is None) == bool(good) for reason, good in zip(solution.reasons, ok, strict=True))


def joint_rates(arm: Arm, path: SprayPath, solution: PathSolution, speed: float = 0.3) -> np.ndarray:
    """Joint speed over greatest speed on every sprayed step at a nozzle speed, shape (steps, joints)."""
    steps = solution.solved[1:] & solution.solved[:-1] & ~solution.break_before[1:]
    time = np.linalg.norm(np.diff(path.position, axis=0), axis=1) / speed
    return (np.abs(np.diff(solution.q, axis=0)) / time[:, None] / arm.max_speed)[steps]


@pytest.mark.parametrize("payload_kg", [0.0, 181.0])
def test_table_4_1_is_one_smooth_path_within_limits(payload_kg: float):
    arm, path = load_arm("kc"), table_path()
    solution = solve_path(arm, path, arm.zero_pose, payload_kg)
    assert solution.solved.all()
    assert solution.break_before.tolist() == [True] + [False] * 19
    assert_on_path(arm, path, solution, payload_kg)
    step = np.abs(np.diff(solution.q, axis=0)).max(axis=0)
    assert (step[arm.prismatic] < 0.1).all()
    assert (step[~arm.prismatic] < np.radians(5.0)).all()


def test_an_s_path_round_the_tunnel_is_smooth_and_solved_wherever_the_arm_reaches():
    arm, path = load_arm("kc"), round_tunnel()
    solution = solve_path(arm, path, arm.zero_pose)
    assert_on_path(arm, path, solution)
    assert solution.solved.mean() > 0.985
    lost = ~solution.solved
    assert path.station[lost].min() > 13.1  # only feet of the farthest pass lie beyond full extension
    assert all("out of reach" in reason for reason in solution.reasons if reason)
    assert (joint_rates(arm, path, solution) < 1.0).all()
    # first point, the left feet, and where lost feet leave a gap
    assert solution.break_before.sum() <= 6


def test_the_reroll_is_found_where_the_planner_does_not_split_the_passes():
    arm = load_arm("kc")
    path = round_tunnel(seam_deg=400.0, stations=np.arange(10.2, 11.2, 0.3))
    solution = solve_path(arm, path, arm.zero_pose)
    assert solution.solved.all()
    assert_on_path(arm, path, solution)
    assert (joint_rates(arm, path, solution) < 1.0).all()
    rolled = np.flatnonzero(np.abs(np.diff(solution.q[:, 6])) > np.pi)
    assert rolled.size and solution.break_before[rolled + 1].all()


def test_a_yawed_and_graded_tunnel_with_tilted_rows():
    arm = load_arm("kc")
    R = rotation("z", np.radians(5.0)) @ rotation("y", np.radians(-2.0))
    path = round_tunnel(stations=np.arange(10.2, 11.8, 0.3), R_base_tunnel=R)
    theta2 = np.radians(np.choose(path.pass_index % 3, [75.0, 90.0, 105.0]))
    path = dataclasses.replace(path, theta2=theta2)
    solution = solve_path(arm, path, arm.zero_pose, 90.0)
    assert_on_path(arm, path, solution, 90.0)
    assert solution.solved.mean() > 0.99
    assert np.percentile(joint_rates(arm, path, solution), 99) < 1.0


def test_unreachable_points_say_which_limit_and_by_how_much():
    arm, path = load_arm("kc"), table_path()
    position = path.position.copy()
    position[7, 0] += 8.0
    position[8] = [1.0, 0.0, 0.2]
    solution = solve_path(arm, dataclasses.replace(path, position=position), arm.zero_pose)
    assert np.flatnonzero(~solution.solved).tolist() == [7, 8]
    assert "telescope" in str(solution.reasons[7]) and "beyond" in str(solution.reasons[7])
    assert "allowed" in str(solution.reasons[8])
    assert (joint_rates(arm, path, solution) < 1.0).all()


def test_a_path_wholly_out_of_reach_is_reported_not_raised():
    arm, path = load_arm("kc"), table_path()
    far = dataclasses.replace(path, position=path.position + np.array([30.0, 0.0, 0.0]))
    solution = solve_path(arm, far, arm.zero_pose)
    assert not solution.solved.any() and not solution.break_before.any()
    assert all(reason for reason in solution.reasons)


def test_passes_far_apart_are_a_break():
    arm, path = load_arm("kc"), table_path()
    position = path.position.copy()
    position[10:, 0] += 1.5
    solution = solve_path(arm, dataclasses.replace(path, position=position), arm.zero_pose)
    assert np.flatnonzero(solution.break_before).tolist() == [0, 10]


def test_one_point_and_repeated_points():
    arm, path = load_arm("kc"), table_path()
    rows = np.zeros(3, dtype=int)
    same = make_path(path.position[rows], path.theta2[rows], path.theta3[rows])
    solution = solve_path(arm, same, arm.zero_pose)
    assert solution.solved.all()
    assert np.abs(np.diff(solution.q, axis=0)).max() < 1e-6
    one = make_path(path.position[:1], path.theta2[:1], path.theta3[:1])
    assert solve_path(arm, one, arm.zero_pose).solved.all()


def test_the_same_path_gives_the_same_bits():
    arm, path = load_arm("kc"), table_path()
    first, second = (solve_path(arm, path, arm.zero_pose) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)


def test_progress_rises_and_may_cancel():
    arm, path = load_arm("kc"), table_path()
    seen: list[float] = []
    solve_path(arm, path, arm.zero_pose, progress=seen.append)
    assert seen[0] == 0.0 and seen[-1] == 1.0 and seen == sorted(seen)

    def cancel(fraction: float) -> None:
        if fraction > 0.4:
            raise CancelledError("stopped")

    with pytest.raises(CancelledError):
        solve_path(arm, path, arm.zero_pose, progress=cancel)


def test_bad_calls_are_refused():
    arm, path = load_arm("kc"), table_path()
    with pytest.raises(InputError, match="start_q"):
        solve_path(arm, path, np.full(8, np.nan))
    with pytest.raises(InputError, match="start_q"):
        solve_path(arm, path, np.zeros(6))
    with pytest.raises(InputError, match="path model"):
        solve_path(load_arm("muck"), path, np.zeros(6))
    with pytest.raises(InputError, match="no point"):
        solve_path(arm, make_path(np.zeros((0, 3)), np.zeros(0), np.zeros(0)), arm.zero_pose)
    with pytest.raises(InputError, match="payload"):
        solve_path(arm, path, arm.zero_pose, -5.0)


def test_pieces_between_cuts_are_smoothed_as_if_each_were_alone() -> None:
    """Damping, acceptance and the end of the rounds belong to a piece, whatever else is smoothed with it."""
    arm = load_arm("kc")
    path = round_tunnel(stations=np.array([11.0]))
    model = arm.description.path
    assert model is not None
    cost, T = make_cost(arm, model), spray_pose(path)
    q = solve_path(arm, path, arm.zero_pose).q
    rough = q.copy()
    rough[::2, 4] += 0.05  # what smoothing takes out again
    distance = np.append(np.inf, np.linalg.norm(np.diff(path.position, axis=0), axis=1))
    cut = len(q) // 3
    distance[cut] = np.inf

    def smooth(rows: slice) -> np.ndarray:
        gaps = distance[rows].copy()
        weight = model.curvature_weight
        return smooth_chain(arm, cost, T[rows], rough[rows], gaps, weight, 12, lambda done: None)

    whole = smooth(slice(None))
    alone = np.concatenate([smooth(slice(0, cut)), smooth(slice(cut, None))])
    np.testing.assert_allclose(whole, alone, atol=1e-9)
    travel = [np.abs(np.diff(each[:cut, 4])).sum() for each in (rough, whole)]
    assert travel[1] < 0.2 * travel[0]
    reached = arm.forward(whole)
    assert np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1).max() < 1e-4
