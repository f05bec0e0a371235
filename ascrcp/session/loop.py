"""Closing the loop: scan the sprayed wall again, measure the layer, plan what is still too thin."""

from collections.abc import Callable
from pathlib import Path

from ascrcp.core.errors import AscrcpError, UnreachableError
from ascrcp.core.flow import SprayPath
from ascrcp.session import job
from ascrcp.session.desk import Desk
from ascrcp.session.outcome import Measured
from ascrcp.session.remote import Remote
from ascrcp.session.round import Round
from ascrcp.session.state import Finding, Step
from ascrcp.session.wording import say_chinese


def scan_again(desk: Desk) -> None:
    """再次扫描: what has been laid, and the plan of a second spraying where it is too thin.

    Everything goes into a folder of its own; what stands in the round stays as it is.
    """
    session = desk.session
    desk.finding = Finding.MEASURED
    place = session.round.begin_rescan()
    session.stage("Scanning the sprayed wall", "正在扫描已喷壁面")
    with session.stopwatch("rescan"):
        job.scan_heading(session, place.scan)
        _look_behind(desk, place)
    session.announce("Scan finished.", "扫描完成。")
    _measure(desk, place)
    if desk.achieved[-1]["within_tolerance"] >= session.setup.report.covered_share:
        desk.finding = Finding.COVERED
    elif session.setup.resprays is None or len(desk.runs) <= session.setup.resprays:
        desk.finding = _plan_again(desk, place)
    if desk.finding is Finding.COVERED:
        session.announce("Nothing is left to spray again.", "已无需补喷。")
    job.write_report(desk)


def _look_behind(desk: Desk, place: Round) -> None:
    """Scan once more from further in, where the lidar sees what arches and rims hid, if the way is clear.

    Of what is in the way the sweep just made tells, not the scan before the spraying.
    """
    session, setup = desk.session, desk.session.setup
    _lay_on(desk, place)
    desk.around = place
    pose = session.run_compute(
        Remote.LOOK_POSE, place.folder, setup.machine, setup.planning, share=(0.0, 0.0)
    )
    if pose is None:
        session.announce("Scanned from the scan pose alone.", "仅从扫描位姿扫描。")
        return
    session.stage("Scanning behind the arches", "正在扫描拱架背侧")
    try:
        job.move_to(desk, pose)
    except UnreachableError as error:
        session.announce(
            f"Scanned from the scan pose alone: {error}", f"仅从扫描位姿扫描：{say_chinese(error)}"
        )
        return
    job.scan_heading(session, place.look)
    job.move_to(desk, session.arm.zero_pose)


def _lay_on(desk: Desk, place: Round, share: tuple[float, float] = (0.0, 0.0)) -> Measured:
    """Measure what the sweeps so far show, and keep the wall as it is now in their folder."""
    session, setup = desk.session, desk.session.setup
    found: Measured = session.run_compute(
        Remote.MEASURE,
        place.folder,
        session.round.folder,
        _driven(desk),
        setup.machine,
        setup.planning,
        setup.perception,
        setup.payload_kg,
        share=share,
    )
    return found


def _measure(desk: Desk, place: Round) -> None:
    """Measure the layer achieved so far."""
    session = desk.session
    session.stage("Measuring the layer", "正在测量喷层厚度", 0.25)
    with session.stopwatch("measure"):
        found = _lay_on(desk, place, (0.25, 0.5))
    session.round.keep_rescan(place)
    session.show(surface=found.surface, achieved=found.layer)
    figures = dict(found.layer.figures)
    desk.achieved = [*desk.achieved, {"folder": place.folder.name, **figures}]
    desk.sum_up()
    share, thin = 100.0 * figures["within_tolerance"], figures["thinnest_mm"]
    session.announce(
        f"Within tolerance: {share:.1f} % of the wall; thinnest place lacks {thin:.0f} mm.",
        f"达标面积：{share:.1f} %；最薄处欠厚 {thin:.0f} mm。",
    )


def _driven(desk: Desk) -> Path | None:
    """Return the folder of the plan that was driven to its end since the scan before."""
    return desk.round.folder if desk.is_finished else None


def _plan_again(desk: Desk, place: Round) -> Finding:
    """Plan and solve what is too thin; the plan before gives way to it."""
    session, setup = desk.session, desk.session.setup
    session.stage("Planning the second spraying", "正在规划补喷", 0.5)
    with session.stopwatch("plan"):
        path: SprayPath | None = session.run_compute(
            Remote.PLAN_AGAIN,
            place.folder,
            session.round.folder,
            _driven(desk),
            setup.planning,
            share=(0.5, 0.75),
        )
    if path is None:
        return Finding.COVERED
    before, desk.round = desk.round, place
    try:
        job.solve_path(desk, path)
    except UnreachableError as error:
        desk.round = before
        session.announce(f"What is too thin stays so: {error}", f"欠厚处无法补喷：{say_chinese(error)}", True)
        return Finding.COVERED
    except AscrcpError:
        desk.round = before
        raise
    return Finding.PLANNED


JOBS: dict[Step, Callable[[Desk], None]] = {
    Step.ZERO: job.zero_joints,
    Step.RECOGNISE: job.recognise_and_solve,
    Step.LOAD: job.load_sequence,
    Step.GO_TO_START: job.go_to_start,
    Step.RUN: job.run_sequence,
    Step.RESCAN: scan_again,
}
"""What the worker does in each step."""
