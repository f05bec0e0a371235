"""Whole paths: time, memory and growth of the solver, joint accelerations beside the paper's rule."""

import multiprocessing
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.point_rule import follow_point_by_point, peak_acceleration
from ascrcp.core.flow import SprayPath
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.path import solve_path
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.task import spray_pose

POINTS = 2000
LAYERS = 10
"""Layers of the long path: the same points so many times over, as a thick layer is sprayed."""

# A heading of the class of thesis 6.1: clear radius 5.9 m, its axis 1.85 m below the base.
RADIUS = 5.9
STAND_OFF = 1.0
AXIS_BELOW = 1.85
STATIONS = (9.6, 12.6)
SPAN_DEG = (-20.0, 200.0)
PASS = 0.3
"""Distance between passes [m]: the default spray radius."""

Measured = tuple[float, float, int]
"""Seconds, megabytes above the start (NaN where the system does not tell), points solved."""


def make_path(points: int, layers: int = 1) -> SprayPath:
    """Build an S path round a circular heading, bay sides from right to left and back.

    Args:
        points: About how many points one layer has.
        layers: How often it is sprayed over.
    """
    stations = np.arange(STATIONS[0], STATIONS[1] + PASS / 2, PASS)
    span = np.radians(np.linspace(*SPAN_DEG, max(2, points // len(stations))))
    angle = np.concatenate([span[:: 1 - 2 * (k % 2)] for k in range(len(stations))])
    station = np.repeat(stations, len(span))
    run = np.repeat(np.arange(len(stations)), len(span))
    # the next layer goes back the way this one came
    order = [slice(None, None, 1 - 2 * (layer % 2)) for layer in range(layers)]
    angle, station = (np.concatenate([values[o] for o in order]) for values in (angle, station))
    run = np.concatenate([run + layer * len(stations) for layer in range(layers)])
    reach = RADIUS - STAND_OFF
    return SprayPath(
        position=np.stack([station, -reach * np.cos(angle), reach * np.sin(angle) - AXIS_BELOW], axis=-1),
        theta2=np.full(len(angle), np.pi / 2),
        theta3=np.arctan2(np.sin(angle), -np.cos(angle)),
        station=station,
        angle=angle,
        bay=np.zeros(len(angle), dtype=np.int64),
        pass_index=run.astype(np.int64),
        overbreak=np.zeros(len(angle), dtype=bool),
    )


def measure_paths(machine: str, say: Say) -> list[Figure]:
    """Measure short and long path, each in a process of its own, and the accelerations."""
    arm = load_arm(machine)
    if arm.description.path is None:
        return [Figure("whole path", None, "s", note=f"machine {arm.name} has no path model")]
    say(f"bench: paths of {POINTS} and {LAYERS * POINTS} points")
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        short, long = pool.starmap(
            _solve, [(machine, POINTS, 1, 3), (machine, POINTS, LAYERS, 1)], chunksize=1
        )
    n, n_long = len(make_path(POINTS)), len(make_path(POINTS, LAYERS))
    say("bench: the paper's rule, point by point")
    rules = compare_rules(machine)
    return [
        Figure(f"path of {n} points", short[0], "s", 1.0, note=f"{short[2]} solved, best of 3, wall time"),
        Figure("its memory above the start", _known(short[1]), "MB", 100.0),
        Figure(f"path of {n_long} points", long[0], "s", note=f"{long[2]} solved"),
        Figure("its memory above the start", _known(long[1]), "MB"),
        Figure("time a point, long over short", long[0] / n_long * n / short[0], "x", 1.5, note="1: linear"),
        Figure(
            "peak acceleration, paper's rule over ours",
            rules.rule / rules.ours,
            "x",
            3.0,
            more_is_better=True,
            note=f"worst joint, of what it is allowed: {rules.rule:.2g}, ours {rules.ours:.2g}",
        ),
        Figure(
            "the same between the rule's jumps",
            rules.rule_between / rules.ours_between,
            "x",
            note=f"{rules.rule_between:.2g}, ours {rules.ours_between:.2g}; it jumps {rules.jumps} times",
        ),
    ]


@dataclass(frozen=True)
class Rules:
    """Peak accelerations of the worst joint over what it is allowed, at the planned nozzle speed.

    Attributes:
        ours, rule: Where our course is unbroken.
        ours_between, rule_between: Where the rule's steps, too, are within the joints' speeds.
        jumps: Steps of the rule that are not.
    """

    ours: float
    rule: float
    ours_between: float
    rule_between: float
    jumps: int


def compare_rules(machine: str) -> Rules:
    """Solve the short path as a whole and point by point."""
    arm = load_arm(machine)
    model = arm.description.path
    assert model is not None
    path = make_path(POINTS)
    solution = solve_path(arm, path, arm.zero_pose)
    T = compensate(arm, spray_pose(path), 0.0)
    by_rule = follow_point_by_point(arm, T, arm.zero_pose)
    # the nozzle's way or that of the point it sprays at, whichever is longer
    places = (path.position, path.position + STAND_OFF * T[:, :3, 0])
    way = np.max([np.linalg.norm(np.diff(p, axis=0, prepend=p[:1]), axis=1) for p in places], axis=0)
    gap = np.where(solution.break_before, np.inf, way / model.nozzle_speed)
    needed = (np.abs(np.diff(by_rule, axis=0, prepend=by_rule[:1])) / arm.max_speed).max(axis=1)
    jumps = (needed > gap) & np.isfinite(gap)
    between = np.where(jumps, np.inf, gap)
    peaks = [
        float(peak_acceleration(arm, q, g).max())
        for q, g in ((solution.q, gap), (by_rule, gap), (solution.q, between), (by_rule, between))
    ]
    return Rules(peaks[0], peaks[1], peaks[2], peaks[3], int(jumps.sum()))


def _solve(machine: str, points: int, layers: int, repeats: int) -> Measured:
    """Solve in a fresh process and look at its peak memory."""
    arm, path = load_arm(machine), make_path(points, layers)
    start = _reset_peak()
    times, solved = [], 0
    for _ in range(repeats):
        begin = time.perf_counter()
        solved = int(solve_path(arm, path, arm.zero_pose).solved.sum())
        times.append(time.perf_counter() - begin)
    return min(times), _status("VmHWM") - start, solved


def _reset_peak() -> float:
    """Set the process's recorded peak memory to what it holds now, and return that [MB]."""
    place = Path("/proc/self/clear_refs")
    if place.exists():
        place.write_text("5")
    return _status("VmRSS")


def _status(key: str) -> float:
    """Read a size from the process's status [MB]; NaN where the system keeps none."""
    place = Path("/proc/self/status")
    if not place.exists():
        return float("nan")
    line = next(line for line in place.read_text().splitlines() if line.startswith(key))
    return float(line.split()[1]) / 1024.0


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
