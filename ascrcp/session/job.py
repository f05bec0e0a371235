"""The five steps of the thesis as jobs of the worker thread (thesis 6.1.2)."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ascrcp.core.errors import AscrcpError
from ascrcp.core.flow import JointSequence, SprayPath, Surface
from ascrcp.core.geometry import Array
from ascrcp.session.desk import Desk
from ascrcp.session.outcome import Loaded, Solution
from ascrcp.session.remote import Remote
from ascrcp.session.scanner import Scanner
from ascrcp.session.state import Mode
from ascrcp.session.steering import SteerOrder
from ascrcp.session.store import write_scan
from ascrcp.session.wording import say_chinese

if TYPE_CHECKING:
    from ascrcp.session.session import Session


def zero_joints(desk: Desk) -> None:
    """关节归零: move every joint to the scan pose."""
    session = desk.session
    session.stage("Moving to the scan pose", "正在运动至扫描位姿")
    move_to(desk, session.arm.zero_pose)
    session.announce("Joints are at the scan pose.", "关节已归零（扫描位姿）。")


def recognise_and_solve(desk: Desk) -> None:
    """识别解算: scan, reconstruct, plan and solve, each announced when done."""
    session, setup, folder = desk.session, desk.session.setup, desk.session.round
    folder.forget("surface", "now", "features", "path", "plan", "prediction", "joints", "trace", "result")
    folder.leave_rescans()
    desk.begin_heading()
    source: Path | None = setup.cloud
    if source is None:
        session.stage("Scanning the heading", "正在扫描掌子面")
        with session.stopwatch("scan"):
            scan_heading(session, folder.scan)
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
    solve_path(desk, path)


def solve_path(desk: Desk, path: SprayPath) -> None:
    """Solve the joints of the present plan."""
    session, setup, folder = desk.session, desk.session.setup, desk.round.folder
    session.show(path=path, solved=np.zeros(len(path), bool))
    session.announce(f"Path planned: {len(path)} points.", f"轨迹规划完成：{len(path)} 个点。")
    session.stage("Solving the joints", "正在逆解关节", 0.75)
    with session.stopwatch("solve"):
        solution: Solution = session.run_compute(
            Remote.SOLVE, folder, setup.machine, setup.planning, setup.payload_kg, share=(0.75, 1.0)
        )
    session.show(solved=solution.solved, clearance=solution.clearance)
    session.show(predicted=session.run_compute(Remote.PREDICTED_LAYER, folder, share=(1.0, 1.0)))
    session.announce(
        f"Joints solved: {int(solution.solved.sum())} of {len(solution.solved)} points.",
        f"运动学解算完成：{int(solution.solved.sum())}/{len(solution.solved)} 个点。",
    )


def load_sequence(desk: Desk) -> None:
    """读取数据: read the joint sequence, check it whole (thesis 5.3), keep it for the tracker."""
    session, setup = desk.session, desk.session.setup
    session.stage("Loading the joint sequence", "正在读取关节序列")
    loaded: Loaded = session.run_compute(
        Remote.LOAD, desk.round.folder, setup.machine, setup.planning, share=(0.0, 1.0)
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
        move_to(desk, _nearest_pose(desk))
        session.announce(
            "The nozzle is at the nearest planned point; the stick may take over.",
            "喷头已到达最近的规划点，可用摇杆操纵。",
        )
        return
    if desk.is_finished:
        desk.begin_again()
    move_to(desk, desk.pose_at(desk.resume_s))
    session.announce("The nozzle is at the start.", "喷头已到达初始点。")


def _nearest_pose(desk: Desk) -> Array:
    """Mesh the plan for the stick, and find the joints of its node nearest to the nozzle."""
    session, setup = desk.session, desk.session.setup
    if desk.steer_plan is None:
        desk.steer_plan = session.run_compute(
            Remote.STEER_PLAN,
            desk.round.folder,
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
    write_report(desk)


def _judge(desk: Desk) -> None:
    """Write what the run came to; a disk that refuses must not hide why the run ended (fault F38)."""
    try:
        desk.finish_run()
    except AscrcpError as error:
        desk.session.announce(
            f"The run's record could not be written: {error}", f"作业记录写入失败：{say_chinese(error)}", True
        )


def write_report(desk: Desk) -> None:
    """Write the round's page anew."""
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
    write_report(desk)


def move_to(desk: Desk, target: Array) -> None:
    """Move to a pose at rest, planned in the compute process: clear of what the round's scan saw."""
    session, setup = desk.session, desk.session.setup
    sequence: JointSequence = session.run_compute(
        Remote.APPROACH,
        desk.around.folder,
        setup.machine,
        setup.planning,
        setup.control,
        setup.payload_kg,
        session.measured_q(),
        target.tolist(),
        share=(0.0, 0.0),
    )
    session.run_motion(sequence)


def scan_heading(session: "Session", file: Path) -> None:
    """Sweep the lidar over the heading from where the arm stands and keep the raw scan in a file."""
    setup = session.setup
    setup.lidar.open()
    try:
        scanner = Scanner(setup.lidar, setup.sweep, session.cycle)
        session.run_scan(scanner)
    finally:
        setup.lidar.close()
    write_scan(file, scanner.scan())
