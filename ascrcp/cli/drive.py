"""The commands that open a session: the arm driven on the rig, recorded inputs run again."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from ascrcp.app import Options as AppOptions
from ascrcp.app import open_replay
from ascrcp.app import open_session as open_app_session
from ascrcp.cli.output import FAILED, OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import result_table
from ascrcp.core.errors import AscrcpError
from ascrcp.planning.table import read_joints
from ascrcp.session.job import scan_heading
from ascrcp.session.replay import replay as replay_round
from ascrcp.session.round import Round
from ascrcp.session.session import Session
from ascrcp.session.state import Step

ROUNDS = Path("rounds")
RESET_WAIT_S = 10.0


def app_options(options: Options, lockstep: bool, resprays: int | None = None) -> AppOptions:
    """Pick what the composition root needs from the command line."""
    return AppOptions(
        machine=options.machine,
        rig=options.rig,
        seed=options.seed,
        load_kg=options.load_kg,
        cloud=options.cloud,
        profile=options.profile,
        planner=options.planner,
        control=options.control,
        lockstep=lockstep,
        resprays=resprays,
    )


def open_session(options: Options, lockstep: bool, resprays: int | None = None) -> Session:
    """Open a session on the rig with its round folder.

    Args:
        options: The command line.
        lockstep: Virtual time, unless the command line asks for real time.
        resprays: So many further sprayings at most; None for as many as the operator asks for.
    """
    lockstep = lockstep and not getattr(options, "realtime", False)
    return open_app_session(app_options(options, lockstep, resprays), options.round, ROUNDS)


@contextlib.contextmanager
def _session(options: Options, output: Output) -> Iterator[Session]:
    session = open_session(options, lockstep=True)
    try:
        with output.progress(session):
            yield session
    finally:
        session.close()


def _do(session: Session, step: Step) -> None:
    """Run one step to its end.

    Raises:
        AscrcpError: It did not succeed; the message says why.
    """
    session.start(step)
    session.wait()
    if step not in session.snapshot().job.done:
        raise AscrcpError(session.failure or f"{step.value} was stopped")


def scan(options: Options, output: Output) -> int:
    """Zero the joints and scan the heading."""
    with _session(options, output) as session:
        session.reset_and_wait(RESET_WAIT_S)
        _do(session, Step.ZERO)
        with session.stopwatch("scan"):
            scan_heading(session, session.round.scan)
        place = session.round.scan
        timing = session.desk.timing_s("scan")
    output.result(
        {"ok": True, "round": str(place.parent), "scan": str(place), "timing_s": {"scan": timing}},
        f"scan: {place} ({timing:.1f} s of machine time)",
    )
    return OK


def run(options: Options, output: Output) -> int:
    """Drive a solved round on the rig."""
    read_joints(
        Round(options.round).need("joints", "solve")
    )  # a damaged one is refused before the rig is opened
    with _session(options, output) as session:
        session.reset_and_wait(RESET_WAIT_S)
        for step in (Step.LOAD, Step.GO_TO_START, Step.RUN):
            _do(session, step)
        result = job_result(session)
    output.result(result, result_table(result))
    return OK if result["ok"] else FAILED


def finish_job(session: Session, output: Output, code: int) -> int:
    """Print what the application's headless job came to."""
    if not session.desk.result:
        raise AscrcpError(session.failure or "the job ended before the run")
    result = job_result(session)
    output.result(result, result_table(result))
    return OK if code == OK and result["ok"] else FAILED


def job_result(session: Session) -> dict[str, Any]:
    """Summary of a run with its places (design.md section 9)."""
    return {
        **session.desk.result,
        "round": str(session.round.folder),
        "report": str(session.round.report),
        "pictures": [str(p) for p in sorted(session.round.pictures.glob("*.png"))],
    }


def replay(options: Options, output: Output) -> int:
    """Feed the recorded inputs to a fresh cycle and compare every command."""
    round_ = Round(options.round)
    found = replay_round(options.round, lambda bus: open_replay(round_, bus))
    same = found.differing == 0
    output.result(
        {"ok": same, **msgspec.to_builtins(found)},
        f"{found.cycles} cycles replayed, {found.commands} command frames, {found.differing} differ",
    )
    return OK if same else FAILED
