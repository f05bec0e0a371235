"""The five steps of the thesis as jobs of the worker thread (thesis 6.1.2)."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ascrcp.control.steer_plan import SteerPlan
from ascrcp.core.errors import AscrcpError, InputError
from ascrcp.core.flow import JointSequence, SprayPath, Surface
from ascrcp.core.geometry import Array
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.session.evaluation import evaluate
from ascrcp.session.outcome import Loaded, Solution
from ascrcp.session.remote import Remote
from ascrcp.session.scanner import Scanner
from ascrcp.session.state import Mode, Step
from ascrcp.session.steering import SteerOrder
from ascrcp.session.store import write_json, write_scan
from ascrcp.session.trace import TraceCollector
from ascrcp.session.wording import say_chinese

if TYPE_CHECKING:
    from ascrcp.session.session import Session


class Desk:
    """What the jobs share: the loaded sequence, the place in it, times and counts."""

    def __init__(self, session: "Session") -> None:
        self.session = session
        self.sequence: JointSequence | None = None
        self.resume_s = 0.0
        self.points = 0
        self.reached = 0
        self.skipped = 0
        self.collector = TraceCollector(session.arm.n)
        self.timing: dict[str, tuple[float, float]] = {}
        self.result: dict[str, Any] = {}
        self.planned = 0
        self.steer_plan: SteerPlan | None = None
        self.steer_node = (0, 0)
        self.left_areas: frozenset[int] = frozenset()

    def nozzle(self, q: Array) -> Array:
        """Nozzle pose the measured joints mean, with the sag of the boom; (8,) -> (4, 4)."""
        setup = self.session.setup
        return sagged_forward(setup.arm, q, setup.payload_kg)

    def load(self, loaded: Loaded) -> None:
        """Keep a checked sequence, to be run from its beginning."""
        self.sequence = loaded.sequence
        self.planned = loaded.planned
        self.steer_plan = None
        self.left_areas = frozenset()
        self.points = int((loaded.sequence.point >= 0).sum())
        self.begin_again()

    def jog(self, kind: Literal["nozzle", "joint"], joint: int) -> None:
        """Make the surroundings known, then give the arm to the stick."""
        session, setup = self.session, self.session.setup
        session.stage("Jog for set-up", "点动调整")
        around = session.run_compute(
            Remote.OBSTACLES, session.round.folder, setup.machine, setup.planning, share=(0.0, 0.0)
        )
        setup.stick.kernels.set_around(around)
        session.run_steering(SteerOrder(kind, joint=joint, q=session.measured_q()))

    def begin_again(self) -> None:
        """Forget the last run: the next starts at the first point."""
        self.resume_s = 0.0
        self.reached = self.skipped = 0
        self._visited: frozenset[int] = frozenset()
        self.collector = TraceCollector(self.session.arm.n)

    def keep_reached(self) -> None:
        """Note which planned points the stick has sprayed at, each once."""
        self._visited |= self.session.setup.stick.tracker.visited
        self.reached = len(self._visited)

    def leave_area(self) -> None:
        """Let the next semi-automatic start lie in another area; once all were left, all count again."""
        plan = self.steer_plan
        if plan is None:
            self.session.announce("Go to the start first.", "请先运动至初始点。", failure=True)
            return
        left = self.left_areas | {int(plan.area[self.steer_node])}
        count = int(plan.area.max()) + 1
        self.left_areas = left if len(left) < count else frozenset()
        self.session.announce(
            f"Step 4 goes to another area ({len(left) % count + 1} of {count}).",
            f"第 4 步将前往另一区域（{len(left) % count + 1}/{count}）。",
        )

    def loaded(self) -> JointSequence:
        """Return the loaded sequence.

        Raises:
            InputError: None is loaded.
        """
        if self.sequence is None:
            raise InputError("no joint sequence is loaded")
        return self.sequence

    def pose_at(self, t_s: float) -> Array:
        """Joints of the loaded sequence at one of its instants, shape (joints,)."""
        sequence = self.loaded()
        return np.array([np.interp(t_s, sequence.t, column) for column in sequence.q.T])

    def keep_place(self) -> None:
        """Note how far the run came, to go on from there after a stop; one that never began keeps its own."""
        if self.session.setup.tracker.sequence is not self.sequence:
            return
        self.resume_s = self.session.setup.tracker.time_s
        track = self.session.track()
        self.reached += track.reached
        self.skipped += track.skipped

    @property
    def is_finished(self) -> bool:
        """Whether the loaded sequence has been run to its end."""
        return self.sequence is not None and self.resume_s >= self.sequence.duration

    @property
    def is_done(self) -> bool:
        """Whether the sequence was run to its end and enough of the planned points were reached."""
        if self.session.snapshot().job.mode is Mode.AUTOMATIC and not self.is_finished:
            return False
        return self.reached >= self.session.setup.report.sprayed_share * self.planned

    def is_exact(self, at: dict[str, Any]) -> bool:
        """Whether enough of the points reached keep the thesis's rule; the stick has none to hit."""
        if self.session.snapshot().job.mode is Mode.SEMI_AUTOMATIC:
            return True
        return int(at["within_rule"]) >= self.session.setup.report.sprayed_share * int(at["count"])

    def timing_s(self, name: str) -> float | None:
        """Time of a stage [s]: machine time where the machine worked, else computing time."""
        if name not in self.timing:
            return None
        wall, machine = self.timing[name]
        return machine if name in ("scan", "run") else wall

    @property
    def realtime_factor(self) -> float | None:
        """Machine time of the run per wall time."""
        wall, machine = self.timing.get("run", (0.0, 0.0))
        return machine / wall if wall > 0.0 else None

    def finish_run(self) -> None:
        """Judge what was collected and write it into the round."""
        session = self.session
        trace = self.collector.trace()
        session.round.write_trace(trace)
        judged = evaluate(trace)
        exact = self.is_exact(judged["at_points"])
        self.result = {
            "points": {
                "planned": self.planned,
                "reached": self.reached,
                "skipped": self.skipped,
                "left_out": self.planned - self.points,
            },
            "ok": self.is_done and exact,
            "mode": session.snapshot().job.mode.value,
            **judged,
            "timing_s": {name: self.timing_s(name) for name in ("scan", "recognise", "plan", "solve", "run")},
            "lateness_ms": asdict(session.lateness),
            "realtime_factor": self.realtime_factor,
            "commands_sha256": session.command_digest(),
            "joints": [
                {"number": j.number, "name": j.name, "kind": "prismatic" if j.prismatic else "revolute"}
                for j in session.arm.joints
            ],
        }
        write_json(session.round.result, self.result)


def zero_joints(desk: Desk) -> None:
    """关节归零: move every joint to the scan pose."""
    session = desk.session
    session.stage("Moving to the scan pose", "正在运动至扫描位姿")
    _move_to(desk, session.arm.zero_pose)
    session.announce("Joints are at the scan pose.", "关节已归零（扫描位姿）。")


def recognise_and_solve(desk: Desk) -> None:
    """识别解算: scan, reconstruct, plan and solve, each announced when done."""
    session, setup, folder = desk.session, desk.session.setup, desk.session.round
    folder.forget("surface", "features", "path", "joints", "trace", "result")
    source: Path | None = setup.cloud
    if source is None:
        session.stage("Scanning the heading", "正在扫描掌子面")
        with session.stopwatch("scan"):
            scan_heading(desk)
        session.announce("Scan finished.", "扫描完成。")
    session.stage("Reconstructing and recognising", "正在三维重建与识别", 0.25)
    with session.stopwatch("recognise"):
        surface: Surface = session.run_compute(
            Remote.RECOGNISE,
            folder.folder,
            source,
            setup.machine,
            setup.profile,
            setup.perception,
            setup.payload_kg,
            share=(0.25, 0.6),
        )
    session.show(surface=surface)
    session.announce(
        f"Reconstruction finished: {len(surface.arches)} arches, {len(surface.overbreak)} overbreak regions.",
        f"三维重建完成：钢拱 {len(surface.arches)} 道，超挖 {len(surface.overbreak)} 处。",
    )
    session.stage("Planning the nozzle path", "正在规划喷涂轨迹", 0.6)
    with session.stopwatch("plan"):
        path: SprayPath = session.run_compute(Remote.PLAN, folder.folder, setup.planning, share=(0.6, 0.75))
    session.show(path=path, solved=np.zeros(len(path), bool))
    session.announce(f"Path planned: {len(path)} points.", f"轨迹规划完成：{len(path)} 个点。")
    session.stage("Solving the joints", "正在逆解关节", 0.75)
    with session.stopwatch("solve"):
        solution: Solution = session.run_compute(
            Remote.SOLVE,
            folder.folder,
            setup.machine,
            setup.planning,
            setup.payload_kg,
            share=(0.75, 1.0),
        )
    session.show(solved=solution.solved, clearance=solution.clearance)
    session.show(predicted=session.run_compute(Remote.PREDICTED_LAYER, folder.folder, share=(1.0, 1.0)))
    session.announce(
        f"Joints solved: {int(solution.solved.sum())} of {len(solution.solved)} points.",
        f"运动学解算完成：{int(solution.solved.sum())}/{len(solution.solved)} 个点。",
    )


def load_sequence(desk: Desk) -> None:
    """读取数据: read the joint sequence, check it whole (thesis 5.3), keep it for the tracker."""
    session, setup = desk.session, desk.session.setup
    session.stage("Loading the joint sequence", "正在读取关节序列")
    loaded: Loaded = session.run_compute(
        Remote.LOAD, session.round.folder, setup.machine, setup.planning, share=(0.0, 1.0)
    )
    desk.load(loaded)
    session.show(sequence=loaded.sequence)
    session.announce(
        f"Joint sequence loaded: {desk.points} points, {loaded.sequence.duration:.0f} s.",
        f"关节序列已读取：{desk.points} 个点，{loaded.sequence.duration:.0f} 秒。",
    )


def go_to_start(desk: Desk) -> None:
    """运动至初始点: the start at the right bottom, or in semi-automatic mode the nearest planned point."""
    session = desk.session
    desk.loaded()
    session.stage("Moving to the start", "正在运动至初始点")
    if session.snapshot().job.mode is Mode.SEMI_AUTOMATIC:
        _move_to(desk, _nearest_pose(desk))
        session.announce(
            "The nozzle is at the nearest planned point; the stick may take over.",
            "喷头已到达最近的规划点，可用摇杆操纵。",
        )
        return
    if desk.is_finished:
        desk.begin_again()
    _move_to(desk, desk.pose_at(desk.resume_s))
    session.announce("The nozzle is at the start.", "喷头已到达初始点。")


def _nearest_pose(desk: Desk) -> Array:
    """Mesh the plan for the stick, and find the joints of its node nearest to the nozzle."""
    session, setup = desk.session, desk.session.setup
    if desk.steer_plan is None:
        desk.steer_plan = session.run_compute(
            Remote.STEER_PLAN,
            session.round.folder,
            setup.machine,
            setup.planning,
            setup.steer,
            setup.payload_kg,
            share=(0.0, 0.0),
        )
    plan = desk.steer_plan
    tip = desk.nozzle(np.array(session.measured_q()))[:3, 3]
    desk.steer_node = plan.nearest(tip, desk.left_areas)
    return np.array(plan.q[desk.steer_node])


def steer_nozzle(desk: Desk) -> None:
    """开始运动, semi-automatic: the stick moves the nozzle on the plan until the operator has finished."""
    session = desk.session
    assert desk.steer_plan is not None
    session.stage("The joystick moves the nozzle on the plan", "摇杆沿规划面移动喷头")
    row, column = desk.steer_node
    try:
        with session.stopwatch("run"):
            session.run_steering(SteerOrder("plan", desk.steer_plan, row, column), desk.collector)
    finally:
        desk.keep_reached()
        _judge(desk)
    session.announce(
        f"Joystick run finished: {desk.reached} of {desk.planned} planned points sprayed at.",
        f"摇杆作业结束：{desk.planned} 个规划点中已喷 {desk.reached} 个。",
    )
    _write_report(desk)


def _judge(desk: Desk) -> None:
    """Write what the run came to; a disk that refuses must not hide why the run ended (fault F38)."""
    try:
        desk.finish_run()
    except AscrcpError as error:
        desk.session.announce(
            f"The run's record could not be written: {error}", f"作业记录写入失败：{say_chinese(error)}", True
        )


def _write_report(desk: Desk) -> None:
    session = desk.session
    session.stage("Writing the report", "正在生成报告", 0.99)
    session.run_compute(Remote.REPORT, session.round.folder, share=(0.99, 1.0))
    session.announce("Report written.", "报告已生成。")


def run_sequence(desk: Desk) -> None:
    """开始运动: spray along the plan, judge the run, write the report."""
    session = desk.session
    if session.snapshot().job.mode is Mode.SEMI_AUTOMATIC:
        steer_nozzle(desk)
        return
    sequence = desk.loaded()
    session.stage("Spraying along the plan", "正在按轨迹喷射")
    try:
        with session.stopwatch("run"):
            session.run_motion(sequence, desk.resume_s, collector=desk.collector)
    finally:
        desk.keep_place()
        _judge(desk)
    left_out = desk.planned - desk.points
    session.announce(
        f"Spraying finished: {desk.reached} points reached, {desk.skipped} skipped, {left_out} left out.",
        f"喷射完成：到达 {desk.reached} 点，跳过 {desk.skipped} 点，未规划解 {left_out} 点。",
    )
    at = desk.result.get("at_points", {})
    if at and not desk.is_exact(at):
        session.announce(
            f"Only {at['within_rule']} of {at['count']} points keep 100 mm and 5 deg: survey and calibrate.",
            f"仅 {at['within_rule']}/{at['count']} 个点在 100 mm、5° 以内：请测量并标定机械臂。",
            failure=True,
        )
    _write_report(desk)


def _move_to(desk: Desk, target: Array) -> None:
    """Move to a pose at rest, planned in the compute process: clear of what the round's scan saw."""
    session, setup = desk.session, desk.session.setup
    sequence: JointSequence = session.run_compute(
        Remote.APPROACH,
        session.round.folder,
        setup.machine,
        setup.planning,
        setup.control,
        setup.payload_kg,
        session.measured_q(),
        target.tolist(),
        share=(0.0, 0.0),
    )
    session.run_motion(sequence)


def scan_heading(desk: Desk) -> None:
    """Sweep the lidar over the heading and keep the raw scan in the round."""
    session, setup = desk.session, desk.session.setup
    setup.lidar.open()
    try:
        scanner = Scanner(setup.lidar, setup.sweep, session.cycle)
        session.run_scan(scanner)
    finally:
        setup.lidar.close()
    write_scan(session.round.scan, scanner.scan())


JOBS: dict[Step, Callable[[Desk], None]] = {
    Step.ZERO: zero_joints,
    Step.RECOGNISE: recognise_and_solve,
    Step.LOAD: load_sequence,
    Step.GO_TO_START: go_to_start,
    Step.RUN: run_sequence,
}
