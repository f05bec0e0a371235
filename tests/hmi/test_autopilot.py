"""The autopilot presses the real buttons through the whole job, and says why when it cannot."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from PySide6.QtGui import QImage
from rehearsal import Rehearsal

from ascrcp.core.ending import Ending
from ascrcp.core.errors import InputError
from ascrcp.core.paths import CONFIG
from ascrcp.hmi.application import choose_language, run
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen
from ascrcp.session.state import STEPS, Finding, Step

PICTURES = ["00_ready", "01_zero", "02_recognise", "03_load", "04_go_to_start", "05_run", "05_run_middle"]


@pytest.fixture
def quick(screen: Screen) -> Screen:
    """Return the configuration with a faster screen and less patience."""
    return msgspec.structs.replace(
        screen,
        refresh_ms=20,
        autopilot=msgspec.structs.replace(screen.autopilot, patience_s=1.0, reset_every_s=0.1),
    )


def test_whole_job(qapp: object, quick: Screen, tmp_path: Path) -> None:
    session, lines = Rehearsal(ticks=6), []
    assert (
        run(session, offscreen=True, pictures=tmp_path / "p", auto=True, tell=lines.append, screen=quick) == 0
    )
    assert [message.text[0] for message in session.messages] == [f"{step.value} done" for step in STEPS]
    assert Step.RUN in session.job.done
    assert session.closed == 1
    assert session.stops == 0
    assert sorted(path.stem for path in (tmp_path / "p").iterdir()) == PICTURES
    for path in (tmp_path / "p").iterdir():
        image = QImage(str(path))
        assert (image.width(), image.height()) == (quick.size.width, quick.size.height)
    said = "\n".join(lines)
    assert "5/5 Run" in said
    assert "job finished" in said


@pytest.mark.parametrize("step", STEPS)
def test_a_failed_step_ends_with_its_reason(qapp: object, quick: Screen, tmp_path: Path, step: Step) -> None:
    session, lines = Rehearsal(ticks=2, fail=step), []
    assert run(session, offscreen=True, pictures=tmp_path, auto=True, tell=lines.append, screen=quick) == 1
    assert "failed: No tunnel in the cloud" in lines[-1]
    assert session.closed == 1
    assert (tmp_path / "failed.png").is_file()


def steps_of(session: Rehearsal) -> list[str]:
    return [message.text[0].removesuffix(" done") for message in session.messages]


def rehearse(session: Rehearsal, screen: Screen, resprays: int, lines: list[str] | None = None) -> int:
    said = [] if lines is None else lines
    return run(
        session,
        offscreen=True,
        pictures=None,
        auto=True,
        tell=said.append,
        screen=screen,
        resprays=resprays,
    )


SCANNED = [*(step.value for step in STEPS), "zero", "rescan"]


def test_after_the_run_the_wall_is_scanned_again(qapp: object, quick: Screen) -> None:
    session = Rehearsal(ticks=2)
    assert rehearse(session, quick, 0) == 0
    assert steps_of(session) == SCANNED


def test_it_sprays_again_while_the_scan_leads_to_a_plan(qapp: object, quick: Screen) -> None:
    session = Rehearsal(ticks=2)
    session.findings = [Finding.PLANNED, Finding.PLANNED, Finding.COVERED]
    assert rehearse(session, quick, 5) == 0
    assert steps_of(session) == SCANNED + 2 * ["load", "go_to_start", "run", "zero", "rescan"]


def test_a_cloud_in_place_of_the_wall_is_not_scanned_again(qapp: object, quick: Screen) -> None:
    session = Rehearsal(ticks=2)
    session.job = replace(session.job, has_lidar=False)
    assert rehearse(session, quick, 3) == 0
    assert steps_of(session) == SCANNED[:5]


@pytest.mark.parametrize(("resprays", "code"), [(0, 0), (1, 1)])
def test_a_second_scan_that_fails_spoils_only_what_builds_on_it(
    qapp: object, quick: Screen, resprays: int, code: int
) -> None:
    session, lines = Rehearsal(ticks=2, fail=Step.RESCAN), []
    assert rehearse(session, quick, resprays, lines) == code
    assert any("Scan again failed: No tunnel in the cloud" in line for line in lines)
    assert Step.RUN.value in steps_of(session)


def test_an_estop_that_stays_pressed_ends_the_wait(qapp: object, quick: Screen) -> None:
    session, lines = Rehearsal(), []
    session.estop = True
    assert run(session, offscreen=True, pictures=None, auto=True, tell=lines.append, screen=quick) == 1
    assert "nothing changed" in lines[-1]


def test_a_stop_during_a_step_ends_the_job(qapp: object, quick: Screen) -> None:
    class Stopped(Rehearsal):
        def _work(self) -> None:
            if self.job.active is Step.RUN and self.left == 3:
                self.causes = ("joint_stale",)
                self.stop()
            super()._work()

    lines: list[str] = []
    assert run(Stopped(), offscreen=True, pictures=None, auto=True, tell=lines.append, screen=quick) == 1
    assert "sends no new valid value" in lines[-1]


def test_an_exception_in_the_session_ends_the_screen(tmp_path: Path) -> None:
    """In a process of its own: the test runner has its own hook for exceptions in slots."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from rehearsal import Rehearsal\n"
        "from ascrcp.hmi.application import run\n"
        "class Broken(Rehearsal):\n"
        "    def scene(self): raise OSError('disk gone')\n"
        "s = Broken()\n"
        "code = run(s, offscreen=True, pictures=None, auto=True)\n"
        "sys.exit(code + 10 * s.closed)\n"
    )
    here = Path(__file__).parent
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    result = subprocess.run(
        [sys.executable, "-c", code, str(here)],
        check=False,
        cwd=CONFIG.parent,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert result.returncode == 11, result.stderr
    assert "the screen failed: OSError disk gone" in result.stderr


def test_language_falls_back_where_chinese_cannot_be_shown(screen: Screen) -> None:
    chinese = msgspec.structs.replace(screen, language="zh")
    assert choose_language(chinese, True) is Language.ZH
    assert choose_language(chinese, False) is Language.EN
    assert choose_language(msgspec.structs.replace(screen, language="en"), True) is Language.EN


def test_a_signal_stops_the_motion_and_closes(qapp: object, quick: Screen) -> None:
    session = Rehearsal(ticks=9999)

    class AsSoonAsItMoves(Ending):
        @property
        def is_asked(self) -> bool:
            return session.job.active is not None

    ending = AsSoonAsItMoves()
    lines: list[str] = []
    assert (
        run(session, offscreen=True, pictures=None, auto=True, tell=lines.append, screen=quick, ending=ending)
        == 1
    )
    assert session.stops == 1 and session.closed == 1


def test_a_folder_that_cannot_be_made_is_one_error(qapp: object, quick: Screen, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    session = Rehearsal()
    with pytest.raises(InputError, match="no folder for pictures"):
        run(session, offscreen=True, pictures=tmp_path / "file" / "p", auto=True, screen=quick)
    assert session.closed == 1
