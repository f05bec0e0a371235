"""bench control, whole rounds: the rig's true nozzle against the reference, unloaded, loaded, on drawn rigs.

Every machine is commissioned as a real one would be: a survey of poses gives zeros and sag
(`calibrate`), small motions over the bus give the drives (`tune`). Nothing else is changed. Drawn rigs are
driven without the survey too: with the sag of the shipped machine and sensors whose zeros nobody looked at.
"""

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.app import load_control
from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.bench_path import make_path
from ascrcp.cli.cell import Cell
from ascrcp.cli.tune import tuning_pose
from ascrcp.control.config import ControlConfig
from ascrcp.control.move import plan_move
from ascrcp.control.tracker import Tracker
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.errors import AscrcpError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.calibration import NoGainError, calibrate
from ascrcp.kinematics.calibration import load_config as load_calibration
from ascrcp.kinematics.identifiability import FULL_HOSE_KG
from ascrcp.kinematics.machine_file import encode_machine
from ascrcp.kinematics.observation import write_observations
from ascrcp.kinematics.path import solve_path
from ascrcp.planning.parameter import load_parameters as load_planning
from ascrcp.planning.timing import time_sequence
from ascrcp.session.evaluation import RunTrace, angle_error_deg, cross_track_mm, position_error_mm
from ascrcp.session.tuning import Tuner
from ascrcp.simulation.draw import draw_rig, load_range
from ascrcp.simulation.rig import RigConfig, load_rig_config
from ascrcp.simulation.survey import draw_poses, survey_rig

POINTS = 1100
"""Planned points of a whole round: 0.2 m apart."""

PART_S = 240.0
"""Of a round, driven on each of many rigs."""

SURVEY = 80
FULL_KG = 181.0
RIGS = 20
SLACK = 1.5
STEP_KG = 100.0

ASKED = {0.0: (12.0, 30.0, 0.3, 1.0), FULL_KG: (15.0, 35.0, 0.4, 1.2)}
"""Mean and largest error [mm], mean and largest angle [deg], by payload [kg]."""

PRINTED = {0.0: "thesis 36, 80 mm, 2, 5 deg", FULL_KG: "thesis 53, 120 mm, 2.7, 6 deg"}

Overlay = dict[str, Any]
Meddle = Callable[[Cell, float], None]
"""Called every cycle with the machine and the share of the round done."""


@dataclass(frozen=True)
class Commissioned:
    """A machine after its survey and tuning."""

    arm: Arm
    control: ControlConfig


@dataclass(frozen=True)
class RoundRun:
    """What a round came to.

    Attributes:
        state: Of the tracker at the end.
        reason: Why it failed.
        mm, deg: Mean and largest error, time-synchronous, while spraying.
        cross_mm: Mean and largest error across the path.
        joint: Mean and largest error of each joint by its sensor, SI, shape (2, 8).
        point_mm: Mean and largest error at planned points.
        stretch: Time taken over time planned.
        body_ms: Median and 99 % of the platform's work in one cycle [ms].
        speed: Median speed of the nozzle's reference while spraying [m/s].
    """

    state: str
    reason: str
    mm: tuple[float, float]
    deg: tuple[float, float]
    cross_mm: tuple[float, float]
    joint: np.ndarray
    point_mm: tuple[float, float]
    stretch: float
    body_ms: tuple[float, float]
    speed: float


def commission(overlay: Overlay, seed: int, machine: str = "kc", has_survey: bool = True) -> Commissioned:
    """Survey and tune a rig as it is switched on; without a survey the machine file stays as shipped."""
    arm, config = load_arm(machine), load_rig_config(overlay)
    known = _survey(config, arm, seed, machine) if has_survey else arm
    with Cell(config, arm, known, seed) as cell:
        tuned = Tuner(cell, known, load_control(arm)).tune(tuning_pose(arm), lambda _: None)
    return Commissioned(known, tuned.control)


def _survey(config: RigConfig, arm: Arm, seed: int, machine: str) -> Arm:
    """Calibrate zeros and sag to a survey of the rig; the file stays where that would not better it."""
    rng = np.random.default_rng([seed, 2])
    payload = np.round(rng.uniform(0.0, FULL_HOSE_KG, SURVEY))
    seen = survey_rig(config, arm, draw_poses(arm, SURVEY, rng), payload, seed, rng)
    with tempfile.TemporaryDirectory() as folder:
        survey, file = Path(folder) / "survey.csv", Path(folder) / "machine.yaml"
        write_observations(survey, arm, seen)
        try:
            found = calibrate(arm, seen, load_calibration(), ("zeros", "sag"))
        except NoGainError:
            return arm
        file.write_bytes(encode_machine(machine, survey, found))
        return load_arm(str(file))


def plan_round(arm: Arm, payload_kg: float, points: int = POINTS) -> JointSequence:
    """Plan a whole round of a circular heading for the arm as it is known."""
    path = make_path(points)
    found = solve_path(arm, path, arm.zero_pose, payload_kg=payload_kg)
    return time_sequence(arm, found.path, found.q, found.break_before, load_planning().timing)


def shorten(sequence: JointSequence, seconds: float) -> JointSequence:
    """Keep the beginning of a sequence."""
    m = int(np.searchsorted(sequence.t, seconds)) or 1
    parts = {f.name: getattr(sequence, f.name)[:m] for f in fields(sequence)}
    return JointSequence(**parts)


def run_round(
    overlay: Overlay,
    known: Commissioned,
    sequence: JointSequence,
    seed: int,
    payload_kg: float,
    meddle: Meddle | None = None,
) -> RoundRun:
    """Drive a round through tracker and gate and judge it by the rig's truth."""
    arm = known.arm
    with Cell(load_rig_config(overlay), load_arm("kc"), arm, seed, payload_kg) as cell:
        driver = _Driver(cell, Tracker(arm, known.control))
        driver.follow(plan_move(arm, driver.q, tuple(sequence.q[0]), known.control))
        return driver.follow(sequence, meddle)


class _Driver:
    """Tracker and gate on a cell, cycle by cycle."""

    def __init__(self, cell: Cell, tracker: Tracker) -> None:
        self._cell = cell
        self._tracker = tracker
        self.spent: list[float] = []
        for k in range(8):
            self._cycle(reset=k == 5)

    @property
    def q(self) -> tuple[float, ...]:
        """Joints as measured [rad, m]."""
        return self._inputs.q

    def _cycle(self, *, reset: bool = False, start: bool = False) -> None:
        cell = self._cell
        now_ns = cell.advance()
        began = time.thread_time()
        self._inputs = cell.link.receive(now_ns)
        self._out = self._tracker.update(self._inputs)
        error = self._out.error_q if self._out.state == "follow" else None
        verdict = cell.gate.check(self._inputs, self._out.command, reset=reset, start=start, error_q=error)
        cell.link.send(verdict.command)
        self.spent.append(time.thread_time() - began)
        self.causes = verdict.causes

    def follow(self, sequence: JointSequence, meddle: Meddle | None = None) -> RoundRun:
        """Follow to the end, or for twice as long as planned and a minute."""
        rows: list[tuple[Any, ...]] = []
        self._tracker.follow(sequence)
        self._cycle(start=True)
        self.spent.clear()
        judged, limit = 0, 2.0 * sequence.duration + 60.0
        while self._out.state == "follow" and len(rows) * CYCLE_S < limit:
            if meddle is not None:
                meddle(self._cell, self._out.progress)
            self._cycle()
            out, T = self._out, self._cell.rig.true_nozzle()
            passed = out.reached + out.skipped > judged
            judged = out.reached + out.skipped
            row = (
                out.position,
                out.direction,
                T[:3, 3],
                T[:3, 0],
                out.command.pump > 0.0,
                passed,
                out.error_q,
            )
            rows.append(row)
        body = np.percentile(1e3 * np.array(self.spent or [0.0]), [50.0, 99.0])
        why = self._out.reason or ", ".join(self.causes)
        return _judge(rows, sequence, self._out.state, why, (float(body[0]), float(body[1])))


def _judge(
    rows: list[tuple[Any, ...]],
    sequence: JointSequence,
    state: str,
    reason: str,
    body_ms: tuple[float, float],
) -> RoundRun:
    column: list[Array] = [np.array([row[i] for row in rows]) for i in range(7)]
    reference, nozzle = np.hstack(column[0:2]), np.hstack(column[2:4])
    sprays = column[4].astype(bool)
    points = np.where(column[5], 0, -1)
    t: Array = CYCLE_S * np.arange(float(len(rows)))
    trace = RunTrace(t, reference, nozzle, nozzle, sprays, points, column[6], True)
    nothing = (math.nan, math.nan)
    if not sprays.any():
        return RoundRun(
            state, reason, nothing, nothing, nothing, np.full((2, 8), math.nan), nothing, 1.0, body_ms, 0.0
        )
    mm, deg = position_error_mm(trace), angle_error_deg(trace)
    joint = np.abs(column[6][sprays])
    step = np.linalg.norm(np.diff(reference[:, :3], axis=0), axis=1)[sprays[1:]] / CYCLE_S
    return RoundRun(
        state,
        reason,
        _pair(mm[sprays]),
        _pair(deg[sprays]),
        _pair(cross_track_mm(trace)[sprays]),
        np.array([joint.mean(axis=0), joint.max(axis=0)]),
        _pair(mm[column[5].astype(bool)]),
        len(rows) * CYCLE_S / sequence.duration,
        body_ms,
        float(np.median(step)),
    )


def _pair(values: np.ndarray) -> tuple[float, float]:
    return (float(values.mean()), float(values.max())) if len(values) else (math.nan, math.nan)


def measure_rounds(seed: int, say: Say) -> list[Figure]:
    """Measure whole rounds, unloaded and loaded; table 5-10, figures 6-12, 6-13, 6-16, 6-17."""
    say("survey and tuning of the rig as shipped")
    known = commission({}, seed)
    figures = []
    for payload, asked in ASKED.items():
        say(f"whole round with {payload:g} kg")
        run = run_round({}, known, plan_round(known.arm, payload), seed, payload)
        figures += _round_figures(f"{payload:g} kg", run, asked, PRINTED[payload])
        figures += _table_5_10(run) if payload else _body(run)
    return figures


def _body(run: RoundRun) -> list[Figure]:
    return [
        Figure(
            "work in one cycle, median",
            run.body_ms[0],
            "ms",
            note="receive, track, gate, send; processor time",
        ),
        Figure("work in one cycle, 99 %", run.body_ms[1], "ms", 1.0),
    ]


def _round_figures(title: str, run: RoundRun, asked: tuple[float, ...], printed: str) -> list[Figure]:
    how = f"every 20 ms; {printed}; {run.state}, nozzle at {run.speed:.2f} m/s"
    return [
        Figure(f"{title}: nozzle, mean", run.mm[0], "mm", asked[0], note=how),
        Figure(f"{title}: nozzle, largest", run.mm[1], "mm", asked[1]),
        Figure(f"{title}: direction, mean", run.deg[0], "deg", asked[2]),
        Figure(f"{title}: direction, largest", run.deg[1], "deg", asked[3]),
        Figure(f"{title}: across the path, mean", run.cross_mm[0], "mm"),
        Figure(f"{title}: across the path, largest", run.cross_mm[1], "mm"),
        Figure(f"{title}: at planned points, mean", run.point_mm[0], "mm"),
        Figure(f"{title}: at planned points, largest", run.point_mm[1], "mm"),
    ]


TABLE_5_10 = (
    (0.51, 0.29),
    (0.49, 0.32),
    (8.83, 5.89),
    (0.56, 0.24),
    (9.45, 5.23),
    (7.52, 4.38),
    (0.89, 0.43),
    (0.98, 0.48),
)


def _table_5_10(run: RoundRun) -> list[Figure]:
    rows = []
    for i, (largest, mean) in enumerate(TABLE_5_10):
        slides = i in (2, 4, 5)  # joint 5 in millimetres of its cylinder, 0.1 deg each
        scale = math.degrees(10.0) if i == 4 else 1e3 if slides else math.degrees(1.0)
        unit, note = "mm" if slides else "deg", "by its sensor, in motion, loaded"
        rows.append(
            Figure(f"table 5-10, joint {i + 1}, mean", float(run.joint[0, i] * scale), unit, mean, note=note)
        )
        rows.append(
            Figure(f"table 5-10, joint {i + 1}, largest", float(run.joint[1, i] * scale), unit, largest)
        )
    return rows


def measure_rigs(seed: int, say: Say, rigs: Sequence[int] = tuple(range(RIGS))) -> list[Figure]:
    """Measure rigs drawn at random, unloaded and loaded by turns, each tuned, and each surveyed and tuned."""
    base, ranges = load_rig_config().arm, load_range()
    figures = []
    for number in rigs:
        overlay = draw_rig(base, ranges, np.random.default_rng([seed, 9, number]))
        payload = FULL_KG if number % 2 else 0.0
        title = f"drawn rig {number + 1}, {payload:g} kg, oil {overlay['arm']['oil']['start_c']:.0f} deg C"
        for how, has_survey in (("tuned", False), ("surveyed, tuned", True)):
            say(f"{title}, {how}")
            figures += measure_rig(f"{title}, {how}", overlay, seed + number, payload, has_survey)
    return figures


def measure_rig(
    title: str, overlay: Overlay, seed: int, payload: float, has_survey: bool = True
) -> list[Figure]:
    """Commission one rig, drive part of a round, set it beside 1.5 times what is asked of the shipped one."""
    asked = tuple(SLACK * value for value in ASKED[payload])
    try:
        known = commission(overlay, seed, has_survey=has_survey)
        sequence = shorten(plan_round(known.arm, payload), PART_S)
        run = run_round(overlay, known, sequence, seed, payload)
    except AscrcpError as error:
        return [Figure(f"{title}: finished", 0.0, "", 1.0, True, str(error))]
    done = Figure(f"{title}: finished", float(run.state == "finished"), "", 1.0, True, run.reason)
    return [done, *_round_figures(title, run, asked, "1.5 x the above")[:4]]


def measure_trouble(seed: int, say: Say) -> list[Figure]:
    """Measure what may go wrong on the shipped rig once commissioned: oil, payload step, a weak joint."""
    known = commission({}, seed)
    sequence = shorten(plan_round(known.arm, 0.0), PART_S)
    asked = tuple(SLACK * value for value in ASKED[0.0])
    figures = []
    for oil_c in (15.0, 65.0):
        overlay: Overlay = {"arm": {"oil": {"start_c": oil_c}}}
        say(f"oil at {oil_c:g} deg C")
        run = run_round(overlay, known, sequence, seed, 0.0)
        figures += _round_figures(f"oil {oil_c:g} deg C", run, asked, "1.5 x unloaded")[:4]

    def load_more(cell: Cell, progress: float) -> None:
        cell.rig.set_load(STEP_KG if progress > 0.3 else 0.0)

    say(f"payload step of {STEP_KG:g} kg")
    run = run_round({}, known, sequence, seed, 0.0, load_more)
    figures += _finished(f"payload step of {STEP_KG:g} kg", run)
    for number, joint in enumerate(load_rig_config().arm.joints.rows, start=1):
        say(f"joint {number} at half its gain")
        overlay = {"arm": {"joints": {f"j{number}": {"speed": [0.5 * v for v in joint.speed]}}}}
        figures += _finished(
            f"joint {number} at half its gain", run_round(overlay, known, sequence, seed, 0.0)
        )
    return figures


def _finished(title: str, run: RoundRun) -> list[Figure]:
    how = f"{run.state} {run.reason}; mean {run.mm[0]:.1f} mm, {run.stretch:.2f} x the planned time"
    return [Figure(f"{title}: largest error", run.mm[1], "mm", 100.0, note=how)]
