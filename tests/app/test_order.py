"""Orders in awkward order: stop before the motion it stops, reset pressed twice, end in the middle."""

import threading
from collections.abc import Iterator
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader

from ascrcp.app import Options, open_session
from ascrcp.control.move import plan_move
from ascrcp.core.errors import CancelledError, DefectError, InputError, RefusedError
from ascrcp.core.flow import JointSequence
from ascrcp.session import session as session_module
from ascrcp.session.cycle import CycleOutput
from ascrcp.session.session import Session
from ascrcp.session.state import Refusal, Step

SMALL = Path(__file__).with_name("small.yaml")
CLOUD = Path(__file__)  # never read: these sessions do not recognise, and so need no lidar


def open_here(folder: Path) -> Session:
    return open_session(Options(rig=SMALL, seed=5, planner="thesis", cloud=CLOUD), folder, folder.parent)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    opened = open_here(tmp_path / "round")
    yield opened
    opened.close()


def move_home(session: Session) -> JointSequence:
    return plan_move(session.arm, session.measured_q(), session.arm.zero_pose.tolist(), session.setup.control)


def test_motion_planned_before_a_stop_does_not_begin_after_the_reset(session: Session) -> None:
    session.reset_and_wait(10)
    sequence, before = move_home(session), session.measured_q()
    session.stop()
    while not session.snapshot().job.stopped:
        threading.Event().wait(0.002)
    session.reset_and_wait(10)
    with pytest.raises(CancelledError):
        session.run_motion(sequence)
    assert session.measured_q() == pytest.approx(before, abs=0.01)
    assert not any(session.snapshot().drive)


def test_next_step_waits_for_the_worker_of_the_stopped_one(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    end, begun = threading.Event(), threading.Event()

    def linger(desk: object) -> None:
        begun.set()
        end.wait()

    monkeypatch.setitem(session_module.JOBS, Step.ZERO, linger)
    session.reset_and_wait(10)
    session.start(Step.ZERO)
    begun.wait()
    session.stop()
    while not session.snapshot().job.stopped:
        threading.Event().wait(0.002)
    session.reset_and_wait(10)
    assert session.refusal(Step.ZERO) is Refusal.BUSY
    with pytest.raises(RefusedError):
        session.start(Step.ZERO)
    end.set()
    session.wait()
    assert session.refusal(Step.ZERO) is None
    assert Step.ZERO not in session.snapshot().job.done, "the stop took it back"


def test_reset_pressed_three_times_is_as_long_as_once(tmp_path: Path) -> None:
    """Lockstep: how often an impatient hand presses must not move time, or runs would differ."""
    instants = []
    for presses in (1, 3):
        session = open_here(tmp_path / str(presses))
        session.measured_q()  # at rest
        for _ in range(presses):
            session.reset()
        session.reset_and_wait(10)
        if presses > 1:
            session.reset()  # too late: nothing is latched
        session.measured_q()
        instants.append((session.t_ns, session.command_digest()))
        session.close()
    assert instants[0] == instants[1]


def test_error_in_the_control_thread_reaches_whoever_waits(session: Session) -> None:
    session.reset_and_wait(10)
    sequence = move_home(session)
    with pytest.raises(DefectError, match="control cycle"):
        session.run_motion(sequence, from_s=-1.0)
    shown = session.snapshot()
    assert shown.job.stopped and "control cycle" in shown.announcements[-1].text[0]
    with pytest.raises(RefusedError):
        session.start(Step.ZERO)
    with pytest.raises(DefectError):
        session.reset_and_wait(10)


def test_run_that_never_began_keeps_its_place(session: Session) -> None:
    """Else the length of the move to the start would pass for a part of the path already sprayed."""
    session.reset_and_wait(10)
    home = move_home(session)
    session.desk.sequence, session.desk.resume_s = home, 0.25
    other = move_home(session)
    session.run_motion(other)
    session.desk.keep_place()
    assert session.desk.resume_s == 0.25
    session.run_motion(home, home.duration)
    session.desk.keep_place()
    assert session.desk.resume_s == home.duration


@pytest.mark.parametrize("cycles", [0, 1, 2, 20])
def test_cancel_ends_a_motion_whenever_it_comes(session: Session, cycles: int) -> None:
    session.reset_and_wait(10)
    sequence = move_home(session)
    seen = 0

    def watch(output: CycleOutput) -> bool:
        nonlocal seen
        seen += output.motion > 0
        if seen == cycles:
            session.cancel()
        return on_cycle(output)

    on_cycle, session._operation.on_cycle = session._operation.on_cycle, watch  # type: ignore[method-assign]
    with pytest.raises(CancelledError):
        if cycles == 0:
            session.cancel()
        session.run_motion(sequence)
    session.measured_q()
    assert not any(session.snapshot().drive) and session.track().state == "hold"


def test_close_stops_on_the_wire_leaves_nothing_behind_and_may_be_repeated(tmp_path: Path) -> None:
    folder = tmp_path / "round"
    session = open_here(folder)
    session.reset_and_wait(10)
    session.close()
    session.close()
    assert not [t.name for t in threading.enumerate() if t.name.startswith("ascrcp")]
    assert not active_children()
    with (folder / "run.mcap").open("rb") as file:
        orders = [m.data for _, c, m in NonSeekingReader(file).iter_messages() if c.topic == "/order"]
    assert b"stop" in orders[-1]
    open_here(folder).close()
    assert {p.name for p in folder.glob("run*.mcap")} == {"run.mcap", "run-1.mcap"}, "both logs are kept"


def test_f43_second_session_on_one_round_is_refused(session: Session, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="another ascrcp"):
        open_here(tmp_path / "round")
    assert np.isfinite(session.measured_q()).all(), "the first goes on"
