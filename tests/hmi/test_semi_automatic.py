"""The semi-automatic mode by clicks and keys: the pad as a stick, and the whole job on the rig."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot
from rehearsal import Rehearsal

from ascrcp.app import Options, open_session
from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.config import load
from ascrcp.core.paths import CONFIG
from ascrcp.devices.joystick import REST, JoystickConfig, StickState
from ascrcp.hmi.stick_pad import StickPad
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.window import Window
from ascrcp.session.recorder import CAN_TOPIC, ORDER_TOPIC, decode_frames
from ascrcp.session.session import Session
from ascrcp.session.state import STEPS, JobState, Mode, Step

SMALL = Path(__file__).resolve().parents[1] / "app" / "small.yaml"
LONG_MS = 120_000
Opener = Callable[..., Window]


@pytest.fixture
def page(open_window: Opener) -> tuple[Window, Rehearsal]:
    """The page in front, steered."""
    session = Rehearsal(ticks=9999)
    session.reset()
    session.job = JobState(
        mode=Mode.SEMI_AUTOMATIC, stopped=False, done=frozenset(STEPS[:4]), has_joystick=True
    )
    window = open_window(session)
    window.show_page("semi")
    window.refresh()
    return window, session


def place(pad: StickPad, x: float, y: float) -> QPoint:
    """Return where on the pad a share of its radius lies."""
    radius = pad._radius
    return QPoint(round(pad.width() / 2 + x * radius), round(pad.height() / 2 - y * radius))


def test_a_finger_from_the_middle_is_the_enable_key_and_its_way_the_deflection(
    page: tuple[Window, Rehearsal], qtbot: QtBot
) -> None:
    window, session = page
    pad = window.semi.pad
    qtbot.mousePress(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.0, 0.0))
    window.refresh()
    assert session.stick.deadman and session.stick.is_neutral
    qtbot.mouseMove(pad, place(pad, 0.5, 0.25))
    window.refresh()
    assert session.stick.along == pytest.approx(-0.5, abs=0.02)
    assert session.stick.across == pytest.approx(0.25, abs=0.02)
    qtbot.mouseRelease(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.5, 0.25))
    window.refresh()
    assert not session.stick.deadman and session.stick.along == 0.0


def test_a_finger_from_the_edge_enables_nothing(page: tuple[Window, Rehearsal], qtbot: QtBot) -> None:
    """F24: a press far from the middle would begin with a deflection."""
    window, session = page
    pad = window.semi.pad
    qtbot.mousePress(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.8, 0.0))
    qtbot.mouseMove(pad, place(pad, 0.0, 0.0))
    window.refresh()
    assert not session.stick.deadman and session.stick.along == 0.0


def test_keyboard_alone_steers(page: tuple[Window, Rehearsal], qtbot: QtBot) -> None:
    window, session = page
    pad = window.semi.pad
    pad.setFocus()
    qtbot.keyPress(pad, Qt.Key.Key_E)
    window.refresh()
    assert session.stick.deadman and session.stick.is_neutral
    qtbot.keyPress(pad, Qt.Key.Key_Left)
    window.refresh()
    assert session.stick.along > 0.3
    qtbot.keyRelease(pad, Qt.Key.Key_Left)
    qtbot.keyRelease(pad, Qt.Key.Key_E)
    window.refresh()
    assert not session.stick.deadman and session.stick.along == 0.0
    qtbot.keyClick(pad, Qt.Key.Key_PageUp)
    window.refresh()
    assert session.stick.lever == pytest.approx(0.1)


def test_arrow_keys_without_the_hold_key_deflect_nothing(
    page: tuple[Window, Rehearsal], qtbot: QtBot
) -> None:
    window, session = page
    window.semi.pad.setFocus()
    qtbot.keyPress(window.semi.pad, Qt.Key.Key_Up)
    window.refresh()
    assert session.stick.across == 0.0 and not session.stick.deadman


def test_another_page_lets_go_of_the_stick(page: tuple[Window, Rehearsal], qtbot: QtBot) -> None:
    window, session = page
    pad = window.semi.pad
    qtbot.mousePress(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.0, 0.0))
    window.refresh()
    assert session.stick.deadman
    window.show_page("alarms")
    assert not session.stick.deadman
    window.refresh()
    assert not session.stick.deadman and not session.stick.lost


def test_the_stick_is_sent_without_a_picture_and_no_more_from_a_hung_screen(
    page: tuple[Window, Rehearsal], qtbot: QtBot, screen: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    """F29: the pad's own timer, not the refresh, keeps the stick; what a busy screen may miss is one beat."""
    window, session = page
    stale = load(CONFIG / "devices" / "joystick.yaml", JoystickConfig).stale_ms.screen
    assert 2 * screen.stick_ms < stale < 3 * CYCLE_NS / 1e6
    sent: list[StickState] = []
    monkeypatch.setattr(session, "put_stick", sent.append)
    qtbot.mousePress(window.semi.pad, Qt.MouseButton.LeftButton, pos=place(window.semi.pad, 0.0, 0.0))
    qtbot.waitUntil(lambda: len(sent) >= 3)
    assert all(state.deadman and not state.lost for state in sent[-2:])
    window.show_page("alarms")
    assert sent[-1] == REST
    sent.clear()
    for _ in range(3):
        window._keep_stick()
    assert sent == []


def test_a_finger_on_a_window_that_goes_away_holds_nothing(
    page: tuple[Window, Rehearsal], qtbot: QtBot
) -> None:
    window, _ = page
    pad = window.semi.pad
    qtbot.mousePress(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.0, 0.0))
    assert pad.is_held
    window.hide()
    assert not pad.is_held


def test_spray_buttons_dose_within_their_range(page: tuple[Window, Rehearsal], qtbot: QtBot) -> None:
    window, session = page
    for _ in range(12):
        qtbot.mouseClick(window.semi.buttons["semi_spray_more"], Qt.MouseButton.LeftButton)
    window.refresh()
    assert session.stick.lever == 1.0 and "100 %" in window.semi.lever.text()
    qtbot.mouseClick(window.semi.buttons["semi_spray_none"], Qt.MouseButton.LeftButton)
    window.refresh()
    assert session.stick.lever == 0.0


def test_free_jog_lifts_by_the_pad_once_its_axis_is_turned(
    page: tuple[Window, Rehearsal], qtbot: QtBot
) -> None:
    window, session = page
    qtbot.mouseClick(window.semi.buttons["semi_jog"], Qt.MouseButton.LeftButton)
    window.refresh()
    assert session.job.jogging
    qtbot.mouseClick(window.semi.buttons["semi_axis"], Qt.MouseButton.LeftButton)
    pad = window.semi.pad
    qtbot.mousePress(pad, Qt.MouseButton.LeftButton, pos=place(pad, 0.0, 0.0))
    qtbot.mouseMove(pad, place(pad, 0.0, 0.7))
    window.refresh()
    assert session.stick.lift == pytest.approx(0.7, abs=0.02) and session.stick.across == 0.0
    qtbot.mouseClick(window.semi.buttons["semi_jog"], Qt.MouseButton.LeftButton)
    window.refresh()
    assert not session.job.jogging


class Operator:
    """A stick in job time: key down with the stick centred, then along the pass, spraying."""

    name = "operator"
    is_present = True

    def __init__(self) -> None:
        self.began_ns = -1
        self.is_ready = False

    def read(self, now_ns: int) -> StickState:
        """Return what the hands do now."""
        if not self.is_ready:
            return StickState(lost=False, reason="")
        if self.began_ns < 0:
            self.began_ns = now_ns
        t = (now_ns - self.began_ns) * 1e-9
        return StickState(
            along=(1.0 if t % 20.0 < 10.0 else -1.0) if t > 1.0 else 0.0,
            lever=0.6,
            deadman=t > 0.4,
            lost=False,
            reason="",
        )

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture(scope="module")
def round_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One round for all jobs here: the first solves it, the others load it."""
    return tmp_path_factory.mktemp("semi") / "round"


@pytest.fixture
def steered(round_folder: Path) -> Iterator[tuple[Session, Operator]]:
    operator = Operator()
    options = Options(rig=SMALL, seed=5, planner="thesis", joystick=operator)
    session = open_session(options, round_folder, round_folder.parent)
    yield session, operator
    session.close()


def click(qtbot: QtBot, button: QWidget) -> None:
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def to_the_run(window: Window, session: Session, qtbot: QtBot) -> None:
    """Reset, mode, steps 1 to 4 and the beginning of 5, by clicks."""
    qtbot.waitUntil(window.rail.reset_button.isEnabled, timeout=LONG_MS)

    def is_reset() -> bool:
        click(qtbot, window.rail.reset_button)
        return not session.snapshot().job.stopped

    qtbot.waitUntil(is_reset, timeout=LONG_MS)
    click(qtbot, window.status.modes[Mode.SEMI_AUTOMATIC])
    click(qtbot, window.strip.buttons["semi"])
    is_solved = Step.RECOGNISE in session.snapshot().job.done
    for step in STEPS[2:4] if is_solved else STEPS[:4]:
        button = window.steps.buttons[step]
        qtbot.waitUntil(button.isEnabled, timeout=LONG_MS)
        click(qtbot, button)
        qtbot.waitUntil(lambda step=step: step in session.snapshot().job.done, timeout=LONG_MS)
    button = window.steps.buttons[Step.RUN]
    qtbot.waitUntil(button.isEnabled, timeout=LONG_MS)
    click(qtbot, button)
    qtbot.waitUntil(lambda: session.snapshot().steer is not None, timeout=LONG_MS)


def test_whole_semi_automatic_job_by_clicks(
    steered: tuple[Session, Operator], qtbot: QtBot, screen: Screen
) -> None:
    session, operator = steered
    window = Window(session, screen, Language.EN)
    qtbot.addWidget(window)
    window.show()
    to_the_run(window, session, qtbot)
    before = session.snapshot().tip
    operator.is_ready = True

    def has_moved() -> bool:
        way = sum(abs(a - b) for a, b in zip(session.snapshot().tip, before, strict=True))
        return session.snapshot().reached > 3 and way > 0.1

    qtbot.waitUntil(has_moved, timeout=LONG_MS)
    assert session.snapshot().spraying and session.snapshot().armed
    assert window.semi.buttons["semi_finish"].isEnabled()
    click(qtbot, window.semi.buttons["semi_finish"])
    qtbot.waitUntil(lambda: Step.RUN in session.snapshot().job.done, timeout=LONG_MS)
    assert session.desk.result["mode"] == "semi_automatic"
    assert session.desk.result["points"]["reached"] > 3
    assert session.desk.result["nozzle_error_mm"]["max"] < 100.0
    assert session.round.report.exists()
    window.close()


def test_stop_while_the_stick_has_the_arm_zeroes_the_wire(
    steered: tuple[Session, Operator], qtbot: QtBot, screen: Screen, round_folder: Path
) -> None:
    """In the very cycle of the stop order, so within 20 ms; latched after."""
    session, operator = steered
    window = Window(session, screen, Language.ZH)
    qtbot.addWidget(window)
    window.show()
    to_the_run(window, session, qtbot)
    operator.is_ready = True
    qtbot.waitUntil(lambda: any(session.snapshot().drive), timeout=LONG_MS)
    qtbot.keyPress(window, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: session.snapshot().job.stopped, timeout=LONG_MS)
    session.wait()
    window.close()
    stopped, frames = False, 0
    with (round_folder / "run.mcap").open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.topic == ORDER_TOPIC:
                stopped = stopped or b"stop" in message.data
            elif channel.topic == CAN_TOPIC and stopped:
                for number, data in decode_frames(message.data)[1][:2]:
                    frames += 1
                    assert not any(data[2:]), f"{number:03x} {data.hex()}"
    assert frames > 0
