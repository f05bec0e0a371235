"""The loop on the real rig in lockstep: scanned again after a run, stopped meanwhile, and what is kept."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ascrcp.app import Options, open_session
from ascrcp.core.errors import RefusedError
from ascrcp.core.flow import JointSequence
from ascrcp.planning.table import read_joints, write_joints
from ascrcp.planning.target import find_target
from ascrcp.planning.wall import fit_wall
from ascrcp.session import stages
from ascrcp.session.again import plan_again
from ascrcp.session.layout_store import read_layout
from ascrcp.session.report import build_report
from ascrcp.session.round import Round
from ascrcp.session.session import Session
from ascrcp.session.state import Refusal, Step
from ascrcp.session.store import read_archive, read_json, read_surface, write_archive

SMALL = Path(__file__).parents[1] / "app" / "small.yaml"
SPRAYED_S = 150.0  # of the plan at least are sprayed here: square metres, far above the noise of a scan
FIRST = ("scan.npz", "surface.npz", "path.csv", "joints.csv", "trace.npz", "features.json")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """A session that has sprayed the first part of its plan, with no further spraying to plan."""
    folder = tmp_path_factory.mktemp("loop")
    options = Options(rig=SMALL, seed=5, planner="thesis", resprays=0)
    opened = open_session(options, folder / "round", folder)
    opened.reset_and_wait(30.0)
    do(opened, Step.ZERO, Step.RECOGNISE)
    joints = opened.round.joints
    write_joints(joints, shorten(read_joints(joints), SPRAYED_S), opened.arm.prismatic)
    do(opened, Step.LOAD, Step.GO_TO_START)
    TOLD[:] = run_and_ask(opened)
    yield opened
    opened.close()


TOLD: list[tuple[float, float, float]] = []
"""Job time, time said to be left, share said to be done, while the fixture's run went on; [s]."""


def run_and_ask(session: Session) -> list[tuple[float, float, float]]:
    """Spray, and ask all the while how long it will still take; the last is when it ended."""
    told = []
    session.start(Step.RUN)
    while (now := session.snapshot()).job.active is Step.RUN:
        if now.spraying:
            told.append((now.t_s, now.remaining_s, now.progress))
        time.sleep(0.005)
    session.wait()
    assert Step.RUN in session.snapshot().job.done, session.snapshot().announcements
    return [*told, (session.snapshot().t_s, 0.0, 1.0)]


def shorten(sequence: JointSequence, spraying_s: float) -> JointSequence:
    """The first part of a sequence, ended where the arm is at rest."""
    done = np.cumsum(np.append(np.diff(sequence.t), 0.0) * sequence.spraying)
    last = int(np.argmax((done > spraying_s) & ~sequence.spraying))
    names = ("t", "q", "position", "direction", "point", "spraying", "flow")
    return replace(sequence, **{name: getattr(sequence, name)[: last + 1] for name in names})


def do(session: Session, *steps: Step) -> None:
    for step in steps:
        session.start(step)
        session.wait()
        assert step in session.snapshot().job.done, session.snapshot().announcements


def content(session: Session) -> dict[str, bytes]:
    return {name: (session.round.folder / name).read_bytes() for name in FIRST}


def test_the_time_left_and_the_share_done_are_true_to_two_percent(session: Session) -> None:
    t, left, share = np.array(TOLD).T
    assert len(t) > 100
    duration = read_joints(session.round.joints).duration
    np.testing.assert_allclose(t + left, t[-1], atol=0.02 * duration)
    np.testing.assert_allclose(share, 1.0 - left / duration, atol=0.02)
    assert session.desk.result["timing_s"]["run"] == pytest.approx(duration, rel=0.02)


def test_the_loop_on_the_rig(session: Session) -> None:
    """One story, for each part of it costs seconds: refusals, a stop in the scan, the scan, what it found."""
    before = content(session)
    assert session.refusal(Step.RESCAN) is Refusal.NEEDS_ZERO
    with pytest.raises(RefusedError):
        session.start(Step.RESCAN)
    do(session, Step.ZERO)

    # stopped in the middle of the scan: latched, nothing kept of it, and the scan may be repeated
    session.start(Step.RESCAN)
    session.stop()
    session.wait()
    job = session.snapshot().job
    assert job.stopped and job.active is None and Step.RESCAN not in job.done
    assert session.refusal(Step.RESCAN) is Refusal.STOPPED
    assert session.round.rescans() == [] and session.scene().achieved is None
    assert list((session.round.folder / "rescan-1").iterdir()) == []
    session.reset_and_wait(30.0)
    do(session, Step.ZERO, Step.RESCAN)

    (found,) = session.round.rescans()
    assert found.folder.name == "rescan-1"
    for place in (found.scan, found.surface, found.achieved, found.finish, found.cloud):
        assert place.exists()
    assert not found.look.exists(), "the face of so short a heading is too near to draw the lance out"
    assert content(session) == before, "the first spraying's files stay as they were"
    assert not found.path.exists(), "no further spraying was asked for"

    truth = session.setup.concrete()
    assert truth["pumped_m3"] > 0.02
    layer = session.scene().achieved
    assert layer is not None and layer.figures["too_thin"] > 0.3, "most of the wall waits"
    on_wall = truth["on_rock_m3"] + truth["on_arches_m3"]
    laid = layer.figures["laid_m3"]
    assert laid == pytest.approx(on_wall, rel=0.15), "what lies before the part to spray is not counted"
    assert session.desk.result["achieved"][0]["folder"] == found.folder.name
    assert "Finish" in session.round.report.read_text()

    # asked again it goes into a folder of its own
    assert session.refusal(Step.RESCAN) is None
    do(session, Step.RESCAN)
    assert len(session.round.rescans()) == 2
    assert session.setup.concrete() == truth, "scanning lays nothing"


def test_what_is_too_thin_is_planned_beside_the_first_plan(session: Session, tmp_path: Path) -> None:
    """After the story above: most of the wall still waits."""
    found, before = session.round.rescans()[0], content(session)
    place, planning = copy_scan(found, tmp_path / "again"), session.setup.planning
    path = plan_again(place.folder, session.round.folder, None, planning)
    assert path is not None and len(path) > 50
    assert content(session) == before
    predicted, achieved = read_json(place.prediction), read_json(place.finish)
    assert predicted["again"]
    assert predicted["planned"]["within_tolerance"] > achieved["within_tolerance"] + 0.2, "it mends"

    again = plan_again(place.folder, session.round.folder, session.round.folder, planning)
    surface = read_surface(session.round.surface)
    believed = planning.process.rebound
    assert again is not None and read_layout(place.plan, surface)[0].rebound == believed
    assert predicted["rebound"]["wall"] == believed.wall, "the thesis's plan does not tell what it was to lay"

    # the report tells what was believed and what was learned
    (first, learned) = (session.round.prediction, found.prediction)
    for file, wall in ((first, 0.2), (learned, 0.234)):
        assert not file.exists()
        file.write_text(json.dumps({**predicted, "rebound": {**predicted["rebound"], "wall": wall}}))
    report = build_report(session.round.folder).read_text()
    assert "<td>20</td>" in report and "<td>23</td>" in report and "learned from spraying 1" in report
    first.unlink()
    learned.unlink()

    # the second spraying does: as if its joints were driven, and nothing came of them but what the scan found
    second = copy_scan(found, tmp_path / "taught")
    timed = stages.solve(place.folder, session.setup.machine, planning, 0.0)
    assert timed.solved.any()
    assert plan_again(second.folder, session.round.folder, place.folder, planning) is not None
    learned = read_layout(second.plan, surface)[0].rebound
    assert learned == believed, "what took nothing was not sprayed"

    names = ("station", "along", "after", "layer", "finish")
    _, arrays = read_archive(place.achieved, "achieved", names)
    target = find_target(surface, fit_wall(surface, planning.path), planning.process, planning.path.bridge_m)
    done = {**arrays, "after": np.where(np.isfinite(arrays["after"]), target.wanted, np.nan)}
    write_archive(place.achieved, "achieved", {}, done)
    nothing = plan_again(place.folder, session.round.folder, None, planning)
    assert nothing is None, "a wall as wanted needs nothing"
    assert not place.path.exists(), "and keeps no plan"


def copy_scan(found: Round, folder: Path) -> Round:
    folder.mkdir()
    place = Round(folder)
    for name in ("surface", "achieved", "finish"):
        getattr(place, name).write_bytes(getattr(found, name).read_bytes())
    return place
