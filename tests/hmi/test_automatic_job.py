"""The automatic job on the real window and the real session: by clicks, by keys, and stop at any moment."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from ascrcp.app import Options, open_session
from ascrcp.core.flow import JointSequence
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.window import Window
from ascrcp.kinematics import load_arm
from ascrcp.planning.table import write_joints
from ascrcp.session.recorder import CAN_TOPIC, ORDER_TOPIC, decode_frames
from ascrcp.session.session import Session
from ascrcp.session.state import STEPS, Step

SMALL = Path(__file__).resolve().parents[1] / "app" / "small.yaml"
LONG_MS = 60_000
WAYS = ("button", "space", "f12")
Click = Callable[[QWidget], None]


SWAY_S = 12.0


def write_sequence(place: Path, seconds: float) -> None:
    """Write a joint sequence that sways three joints slowly, spraying, with ten planned points."""
    arm = load_arm("kc")
    t = np.arange(0.0, seconds, 0.1)
    q = np.tile(arm.zero_pose, (len(t), 1))
    swing = (1.0 - np.cos(2 * np.pi * t / SWAY_S)) / 2
    q[:, 0] += 0.10 * swing
    q[:, 2] += 0.20 * swing
    q[:, 3] += 0.05 * swing
    T = arm.forward(q)
    point = np.full(len(t), -1)
    point[:: max(1, len(t) // 10)] = np.arange(len(point[:: max(1, len(t) // 10)]))
    flow = (point >= -1) & (t < t[-1])
    write_joints(place, JointSequence(t, q, T[:, :3, 3], T[:, :3, 0], point, flow), arm.prismatic)


@pytest.fixture
def solved(tmp_path: Path) -> Iterator[Session]:
    """A session on a round that is solved already, with a sequence of some seconds."""
    folder = tmp_path / "round"
    folder.mkdir()
    write_sequence(folder / "joints.csv", SWAY_S)
    session = open_session(Options(rig=SMALL, seed=3), folder, tmp_path)
    yield session
    session.close()


@pytest.fixture
def window(solved: Session, qtbot: QtBot, screen: Screen) -> Iterator[Window]:
    shown = Window(solved, screen, Language.EN)
    with qtbot.waitActive(shown):
        shown.show()
        shown.activateWindow()
    yield shown
    shown.close()
    shown.deleteLater()


def reset(window: Window, session: Session, qtbot: QtBot, press: Callable[[], None]) -> None:
    def is_reset() -> bool:
        if window.rail.reset_button.isEnabled():
            press()
        return not session.snapshot().job.stopped

    qtbot.waitUntil(is_reset, timeout=LONG_MS)


def click(window: Window, qtbot: QtBot, step: Step) -> None:
    button = window.steps.buttons[step]
    qtbot.waitUntil(button.isEnabled, timeout=LONG_MS)
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def is_done(session: Session, step: Step) -> Callable[[], bool]:
    return lambda: step in session.snapshot().job.done


def test_whole_job_by_keys_alone(window: Window, solved: Session, qtbot: QtBot) -> None:
    """Zero, load, start, run and report without a touch; pages, language and theme by keys too."""
    qtbot.keyClick(window, Qt.Key.Key_F4)
    assert window.page.key == "alarms"
    alt = Qt.KeyboardModifier.AltModifier
    reset(window, solved, qtbot, lambda: qtbot.keyClick(window, Qt.Key.Key_R, alt))
    for number, step in enumerate(STEPS, 1):
        if step is Step.RECOGNISE:
            continue  # the round is solved
        qtbot.waitUntil(window.steps.buttons[step].isEnabled, timeout=LONG_MS)
        qtbot.keyClick(window, Qt.Key(Qt.Key.Key_0 + number), alt)
        qtbot.waitUntil(is_done(solved, step), timeout=LONG_MS)
    assert solved.round.report.exists()
    assert solved.desk.result["points"]["reached"] > 5
    qtbot.keyClick(window, Qt.Key.Key_L, alt)
    assert window.language is Language.ZH
    qtbot.keyClick(window, Qt.Key.Key_T, alt)
    assert window.screen_config.theme == "day"
    window.strip.buttons["wall"].setFocus(Qt.FocusReason.TabFocusReason)
    qtbot.keyClick(window.strip.buttons["wall"], Qt.Key.Key_Return)
    assert window.page.key == "wall"


def open_dialogs(window: Window) -> dict[str, Callable[[], None]]:
    """Return what may be in the operator's way, each by what opens it."""

    def page(key: str) -> Callable[[], None]:
        return lambda: window.show_page(key)

    def part(key: str) -> Callable[[], None]:
        def opened() -> None:
            window.show_page("setup")
            window.setup.open()
            window.setup.choose(key)

        return opened

    return {
        **{key: page(key) for key in ("automatic", "wall", "joints", "alarms", "semi", "setup")},
        **{key: part(key) for key in window.setup.parts},
        "language": lambda: window.set_language(window.language.other),
    }


def press_stop(window: Window, qtbot: QtBot, way: str) -> None:
    if way == "button":
        qtbot.mousePress(window.rail.stop_button, Qt.MouseButton.LeftButton)
        qtbot.mouseRelease(window.rail.stop_button, Qt.MouseButton.LeftButton)
    else:
        qtbot.keyPress(
            QApplication.focusWidget() or window, Qt.Key.Key_Space if way == "space" else Qt.Key.Key_F12
        )


def cycles_to_zero(log: Path) -> list[int]:
    """Return for each stop order how many cycles' command frames still held a drive or the enable bit."""
    late: list[int] = []
    is_stopped = False
    with log.open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.topic == ORDER_TOPIC:
                if b"stop" in message.data:
                    late.append(0)
                    is_stopped = True
                elif b"reset" in message.data:
                    is_stopped = False
            elif channel.topic == CAN_TOPIC and is_stopped:
                sent = decode_frames(message.data)[1][:2]
                late[-1] += any(any(data[2:]) for _, data in sent)
    return late


def test_stop_in_every_state_and_dialog_zeroes_the_wire(
    window: Window, solved: Session, qtbot: QtBot, tmp_path: Path
) -> None:
    """40 ms are two cycles; the frames of the very cycle that takes the order are zero already."""
    # lockstep is a hundred times as fast as the clock: long enough not to end between two looks at it
    write_sequence(tmp_path / "round" / "joints.csv", 200 * SWAY_S)
    presses = 0

    def stop(way: str) -> None:
        nonlocal presses
        press_stop(window, qtbot, way)
        presses += 1
        qtbot.waitUntil(lambda: solved.snapshot().job.stopped, timeout=LONG_MS)
        solved.wait()
        reset(window, solved, qtbot, window.rail.reset_button.click)

    reset(window, solved, qtbot, window.rail.reset_button.click)
    stop("button")  # at rest
    for way, step in zip(("space", "f12", "button"), (Step.ZERO, Step.LOAD, Step.ZERO), strict=True):
        click(window, qtbot, step)
        stop(way)
    click(window, qtbot, Step.LOAD)
    qtbot.waitUntil(is_done(solved, Step.LOAD), timeout=LONG_MS)
    for number, opened in enumerate(open_dialogs(window).values()):
        click(window, qtbot, Step.GO_TO_START)
        if number == 0:
            stop("space")
            click(window, qtbot, Step.GO_TO_START)
        qtbot.waitUntil(is_done(solved, Step.GO_TO_START), timeout=LONG_MS)
        click(window, qtbot, Step.RUN)
        qtbot.waitUntil(lambda: any(solved.snapshot().drive), timeout=LONG_MS)
        opened()
        stop(WAYS[number % len(WAYS)])
        assert solved.snapshot().causes == ()
    window.close()
    late = cycles_to_zero(tmp_path / "round" / "run.mcap")
    assert len(late) >= presses > 15
    assert max(late) == 0, late


def test_window_is_usable_soon(qtbot: QtBot, screen: Screen, solved: Session) -> None:
    """Three seconds from the session to a window that answers; processor time, as the computer is shared."""
    began = time.process_time()
    window = Window(solved, screen, Language.ZH)
    qtbot.addWidget(window)
    window.show()
    window.refresh()
    qtbot.mouseClick(window.strip.buttons["joints"], Qt.MouseButton.LeftButton)
    assert window.page.key == "joints"
    assert time.process_time() - began < 3.0
    window.close()
