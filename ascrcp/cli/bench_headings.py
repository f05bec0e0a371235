"""Whole paths on random headings: scanned, recognised, planned and solved, with what is kept clear."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.bench_clearance import find_most_clearance
from ascrcp.cli.point_rule import follow_point_by_point, peak_acceleration
from ascrcp.core.config import load
from ascrcp.core.flow import JointSequence, Scan, SprayPath, Surface
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.candidate import make_grid, solve_grid
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.path import PathSolution, solve_path
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.task import spray_pose
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.perception.project import project
from ascrcp.perception.recognise import recognise
from ascrcp.planning.parameter import load_parameters as load_planning
from ascrcp.planning.path import plan
from ascrcp.planning.timing import time_path
from ascrcp.simulation.heading import build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import TunnelConfig

PAN_STEP_DEG = 0.4
"""Coarser than the machine's sweep: a third of its points, for time."""

STAND_OFF = 1.0
"""Carries a turn of the nozzle to the wall [m], as in solving."""


LEAST_WAY = 0.05
"""Neighbouring points are taken as at least so far apart [m]."""

HEADINGS = 20


@dataclass(frozen=True)
class Case:
    """One heading, planned: the surface as scanned, its path and its surroundings."""

    surface: Surface
    path: SprayPath
    obstacles: Obstacles


def make_case(arm: Arm, seed: int, bodies: bool = False) -> Case:
    """Draw, scan, recognise and plan one heading.

    Args:
        arm: The arm that scans it.
        seed: Of the heading and of the scan's noise.
        bodies: Whether vehicles and people in it stay; without, the site is taken as cleared.
    """
    heading = build_heading(
        load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig), np.random.default_rng(seed)
    )
    config = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)
    lidar, rng = LidarModel(config, heading), np.random.default_rng(seed)
    mount = arm.lidar(arm.zero_pose)
    pan = np.radians(np.arange(-90.0, 90.0, PAN_STEP_DEG))
    ranges = np.array([lidar.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
    cloud = project(Scan(ranges, config.beam, pan, arm.zero_pose), mount)
    surface = recognise(cloud, heading.truth.profile, load_perception())
    return Case(
        surface, plan(surface, load_planning().path), Obstacles.from_surface(surface, arm, bodies=bodies)
    )


def measure_headings(machine: str, seed: int, say: Say) -> list[Figure]:
    """Hold the solver to its promises on random headings; no figure but the times hangs on the computer.

    Args:
        machine: Name of the arm.
        seed: Of the first heading; the others follow it.
        say: Takes progress.
    """
    description = load_arm(machine).description
    if description.path is None or description.clearance is None or description.lidar is None:
        return [
            Figure("random headings", None, "", note=f"machine {machine} does not spray by a lidar's scan")
        ]
    say(f"bench: {HEADINGS} random headings")
    all_ = bench_headings(machine, HEADINGS, seed)
    points = f"{all_['solved']} of {all_['points']} points solved on {HEADINGS} headings"
    ratio, least = all_["acceleration_ratio_median"], description.clearance.least
    stops = all_["rule_stops_mean"]
    return [
        Figure("reachable points missed", all_["missed"], "", 0.0, note=f"{points}; beside a finer search"),
        Figure("joint speed, share of its limit", all_["joint_speed_share_max"], "", 1.0, note="largest"),
        Figure(
            "peak acceleration, paper's rule over ours, headings",
            all_["acceleration_ratio_min"],
            "x",
            3.0,
            more_is_better=True,
            note=f"least of the headings, median {ratio:.2g}; the rule stops {stops:.0f} times a heading",
        ),
        Figure(
            "clearance while spraying",
            all_["clearance_min_m"],
            "m",
            least,
            more_is_better=True,
            note="least of all solved points",
        ),
        Figure(
            f"points below {description.clearance.wanted:g} m that need not be",
            all_["below_needlessly"],
            "",
            0.0,
            note=f"of {all_['below_wanted']}: a dense search over spare joints and leans keeps more",
        ),
        Figure(
            "moves between strokes that come too near",
            all_["moves_below_least"],
            "",
            0.0,
            note=f"below {least:g} m; nearest {all_['move_clearance_min_m']:.2g} m",
        ),
        Figure("solved points left out because no move leads there", all_["left_out_by_moves"], "", 0.0),
        Figure("points tilted", all_["tilted"], "", note=f"by at most {all_['tilt_max_deg']:.3g} deg"),
        Figure(
            "breaks a heading",
            all_["breaks_mean"],
            "",
            note=f"mean; {all_['breaks_mean_without_feedback']:.3g} without obstacles",
        ),
        Figure(
            "solving a heading",
            all_["solve_s"],
            "s",
            note=f"mean, processor time; {all_['solve_without_obstacles_s']:.2g} s without obstacles",
        ),
    ]


def bench_headings(
    machine: str = "kc", count: int = HEADINGS, seed: int = 0, bodies: bool = False
) -> dict[str, Any]:
    """Solve the paths of random headings and judge them.

    Args:
        machine: Name of the arm.
        count: Number of headings.
        seed: Of the first; the others follow it.
        bodies: Whether vehicles and people in the scan are obstacles.

    Returns:
        `headings`: figures of each; and over all of them points, solved, missed (a finer search finds
        a posture for), least and fifth-percentile clearance [m], points below 0.25 m, tilted points,
        largest tilt [deg], breaks, joint speed over its limit at the timed speed, ratio of the paper's
        rule's peak acceleration to ours (least and median heading), clearance of moves [m], seconds.
    """
    arm = load_arm(machine)
    figures = [_judge(arm, make_case(arm, seed + i, bodies)) for i in range(count)]
    ratios = [f["acceleration_ratio"] for f in figures]
    return {
        "headings": figures,
        "points": sum(f["points"] for f in figures),
        "solved": sum(f["solved"] for f in figures),
        "missed": sum(f["missed"] for f in figures),
        "clearance_min_m": min(f["clearance_min_m"] for f in figures),
        "below_wanted": sum(f["below_wanted"] for f in figures),
        "below_needlessly": sum(f["below_needlessly"] for f in figures),
        "left_out_by_moves": sum(f["left_out_by_moves"] for f in figures),
        "tilted": sum(f["tilted"] for f in figures),
        "tilt_max_deg": max(f["tilt_max_deg"] for f in figures),
        "breaks_mean": float(np.mean([f["breaks"] for f in figures])),
        "breaks_mean_without_feedback": float(np.mean([f["breaks_without"] for f in figures])),
        "joint_speed_share_max": max(f["joint_speed_share"] for f in figures),
        "acceleration_ratio_min": min(ratios),
        "acceleration_ratio_median": float(np.median(ratios)),
        "rule_stops_mean": float(np.mean([f["rule_stops"] for f in figures])),
        "move_clearance_min_m": min(f["move_clearance_m"] for f in figures),
        "moves_below_least": sum(f["moves_below_least"] for f in figures),
        "solve_s": float(np.mean([f["solve_s"] for f in figures])),
        "solve_without_obstacles_s": float(np.mean([f["solve_without_s"] for f in figures])),
    }


def _judge(arm: Arm, case: Case) -> dict[str, Any]:
    model = arm.description.clearance
    assert model is not None
    begin = time.process_time()
    plain = solve_path(arm, case.path, arm.zero_pose)
    middle = time.process_time()
    found = solve_path(arm, case.path, arm.zero_pose, obstacles=case.obstacles)
    end = time.process_time()
    config = load_planning().timing
    timed = time_path(arm, found.path, found.q, found.break_before, config, case.obstacles)
    sequence = timed.sequence
    speed = np.abs(np.diff(sequence.q, axis=0)) / np.diff(sequence.t)[:, None] / arm.max_speed
    free, moves, blocked = _moves(arm, sequence, case.obstacles, model.least)
    by_rule = follow_point_by_point(arm, compensate(arm, spray_pose(case.path)), arm.zero_pose)
    speed_m_s = config.nozzle_speed_m_s
    ours_gap = find_gaps(arm, found.path, found.q, speed_m_s)
    ours_gap[found.break_before] = np.inf
    ours = float(peak_acceleration(arm, found.q, ours_gap).max())
    rule_gap = find_gaps(arm, case.path, by_rule, speed_m_s)
    paper = float(peak_acceleration(arm, by_rule, rule_gap).max())
    kept = found.clearance[found.solved]
    enough = model.wanted - model.cell / 10
    low = np.flatnonzero(found.solved & ~(found.clearance >= enough))
    avoidable = find_most_clearance(arm, case.path, low, case.obstacles) >= enough
    return {
        "points": len(case.path),
        "solved": int(found.solved.sum()),
        "missed": count_missed(arm, case.path, found, case.obstacles, model.least),
        "clearance_min_m": float(kept.min()),
        "clearance_p5_m": float(np.percentile(kept, 5)),
        "below_wanted": len(low),
        "below_needlessly": int(avoidable.sum()),
        "left_out_by_moves": sum(reason is not None for reason in timed.reasons),
        "tilted": int((found.tilt > 0.0).sum()),
        "tilt_max_deg": float(np.degrees(found.tilt.max())),
        "breaks": int(found.break_before.sum()),
        "breaks_without": int(plain.break_before.sum()),
        "joint_speed_share": float(speed.max()),
        "acceleration_ratio": paper / ours,
        "rule_stops": int(np.isinf(rule_gap).sum()),
        "moves": moves,
        "move_clearance_m": free,
        "moves_below_least": blocked,
        "solve_s": end - middle,
        "solve_without_s": middle - begin,
    }


def find_gaps(arm: Arm, path: SprayPath, q: Array, speed: float) -> Array:
    """Return the time from the point before at a constant speed over the wall [s], shape (n,).

    Infinite between passes and where a joint needs so much longer than spraying that the arm stops for
    it (as solving marks breaks: `reroll_s` of the machine file), for whichever rule chose the joints. The
    shorter that time, the more of the paper's rule's throws are stops and leave its peak: the comparison
    takes the machine file's, which is kind to the rule, and says how often the rule stops.

    Args:
        arm: For the limits.
        path: n points.
        q: Joints at them, NaN where there are none, shape (n, joints).
        speed: Of the nozzle or of the sprayed point, whichever is faster [m/s].
    """
    model = arm.description.path
    assert model is not None
    wall = path.position + STAND_OFF * path.direction
    way = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (path.position, wall)]
    dt = np.maximum(np.maximum(*way), LEAST_WAY) / speed
    runs_on = (np.abs(np.diff(q, axis=0)) / arm.max_speed).max(axis=1) <= dt + model.reroll_s
    runs_on &= np.diff(path.pass_index) == 0
    return np.concatenate([[np.inf], np.where(runs_on, dt, np.inf)])


def count_missed(
    arm: Arm, planned: SprayPath, found: PathSolution, obstacles: Obstacles, least: float
) -> int:
    """Count unsolved points that a finer search reaches, planned or tilted, within limits and clear."""
    model = arm.description.path
    assert model is not None
    lost = np.flatnonzero(~found.solved)
    poses = np.stack([compensate(arm, spray_pose(path))[lost] for path in (planned, found.path)], axis=1)
    grid, missed = make_grid(arm, model, 2), 0
    for pose in poses:
        q = solve_grid(arm, pose, grid).reshape(-1, arm.n)
        q = q[arm.within_limits(q)]
        missed += bool(len(q) and (least_distance(arm, q, obstacles) >= least).any())
    return missed


def _moves(arm: Arm, sequence: JointSequence, obstacles: Obstacles, least: float) -> tuple[float, int, int]:
    """Clearance of the rows between strokes: least of all [m], number of moves, moves below least."""
    between = _runs(~(sequence.spraying | (sequence.point >= 0)))
    lowest = [float(least_distance(arm, sequence.q[run], obstacles).min()) for run in between]
    return min(lowest, default=np.inf), len(lowest), sum(value < least for value in lowest)


def _runs(mask: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    rows = np.flatnonzero(mask)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []
