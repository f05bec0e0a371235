"""Commissioning: the PIN, the editor that keeps comments, zeros, the jog, planted faults."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PySide6.QtCore import QCoreApplication, Qt
from pytestqt.qtbot import QtBot
from rehearsal import Rehearsal

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.devices.machine_link import load_can_config
from ascrcp.hmi.config_text import add_number, change, find_numbers, save_checked
from ascrcp.hmi.editor_part import EditedFile, EditorPart
from ascrcp.hmi.setup_page import TRIES
from ascrcp.hmi.window import Window
from ascrcp.hmi.zero_part import ZeroPart, shifted_zero
from ascrcp.kinematics import load_arm
from ascrcp.session.state import Step

Opener = Callable[..., Window]
FILES = [
    CONFIG / "machines" / "kc.yaml",
    CONFIG / "devices" / "can.yaml",
    CONFIG / "profiles" / "circle-5.9.yaml",
]
PIN = "1234"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_changing_a_number_changes_nothing_else(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    numbers = find_numbers(text)
    assert len(numbers) > 3
    for number in numbers:
        assert text[number.start : number.end] == number.text
        changed = change(text, {number.key: "7.125"})
        assert changed == text[: number.start] + "7.125" + text[number.end :]
    assert change(text, {}) == text


@given(st.floats(-1e6, 1e6))
def test_a_fraction_stays_one(value: float) -> None:
    text = "a: 1.5  # metres\nb: [1, {c: 2.0}]\n"
    shown = f"{value:.0f}"
    assert change(text, {("b", 1, "c"): shown}) == text.replace("2.0", shown + ".0")


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match="no number at"):
        change("a: 1\n", {("b",): "2"})
    for value in ("nan", "inf", "x", ""):
        with pytest.raises(ConfigError, match="not a number"):
            change("a: 1\n", {("a",): value})
    assert (
        add_number("s:\n  - {a: 1}  # one\n", ("s", 0), "zero", "2.5") == "s:\n  - {a: 1, zero: 2.5}  # one\n"
    )
    with pytest.raises(ConfigError):
        add_number("s:\n  a: 1\n", ("s",), "zero", "2.5")


def test_a_refused_file_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "profile.yaml"
    text = FILES[2].read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    broken = change(text, {("arcs", 0, "radius"): "900"})
    with pytest.raises(InputError, match=r"profile\.yaml.*design line"):
        save_checked(path, broken, load_profile)
    assert path.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [path]
    save_checked(path, change(text, {("arch_line",): "-0.30"}), load_profile)
    assert load_profile(path).arch_line == -0.30


def test_editor_checks_before_it_saves(qtbot: QtBot, tmp_path: Path) -> None:
    path = tmp_path / "profile.yaml"
    path.write_text(FILES[2].read_text(encoding="utf-8"), encoding="utf-8")
    part = EditorPart((EditedFile(path, load_profile),))
    qtbot.addWidget(part)
    part.show()
    row = next(i for i, number in enumerate(part._numbers) if number.name == "overbreak_line")
    for value, is_good in (("-0.5", False), ("0.20", True)):
        part.choose(row)
        part.pad.show_text(value)
        part.pad.enter.click()
        part.save_button.click()
        assert (load_profile(path).overbreak_line == 0.20) == is_good
        assert ("overbreak_line" in part.status.text()) != is_good
    assert not part.save_button.isEnabled()


@given(st.integers(0, 7), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_shifted_zero_makes_the_joint_read_what_it_is(index: int, shown: float, really: float) -> None:
    sensor = load_can_config().sensors[index]
    raw = sensor.zero + shown / sensor.si_per_unit
    new = shifted_zero(sensor, shown, really)
    assert abs((raw - new) * sensor.si_per_unit - really) < 1e-9


@pytest.mark.parametrize("joint", [1, 5])
def test_zero_is_written_and_read_back(qtbot: QtBot, tmp_path: Path, joint: int) -> None:
    path = tmp_path / "can.yaml"
    path.write_text(FILES[1].read_text(encoding="utf-8"), encoding="utf-8")
    before = load_can_config(path).sensors[joint - 1]
    arm = load_arm("kc")
    part = ZeroPart(arm.joints)
    qtbot.addWidget(part)
    part.path = path
    session = Rehearsal()
    session.reset()
    part.show_snapshot(session.snapshot())
    part.buttons[joint].click()
    for key in "12.5":
        part.pad.press(key)
    part.show_snapshot(session.snapshot())
    assert part.save_button.isEnabled()
    shown = session.snapshot().q[joint - 1]
    part.save_button.click()
    after = load_can_config(path).sensors[joint - 1]
    moved = (after.zero - before.zero) * before.si_per_unit
    assert abs(moved - (shown - 12.5 * 0.017453292519943295)) < 1e-4
    session.start(Step.ZERO)
    part.show_snapshot(session.snapshot())
    assert not part.save_button.isEnabled()


def enter(window: Window, pin: str) -> None:
    for digit in pin:
        window.setup.pad.keys[digit].click()
    window.setup.pad.enter.click()


def test_pin_guards_and_wrong_ones_cost_time(open_window: Opener) -> None:
    window = open_window(Rehearsal())
    window.show_page("setup")
    for _ in range(TRIES):
        assert window.setup.outer.currentIndex() == 0
        enter(window, "1111")
    assert not window.setup.pad.enter.isEnabled()
    window.setup._enter(PIN)  # even the right one has to wait
    assert window.setup.outer.currentIndex() == 0
    while not window.setup.pad.enter.isEnabled():
        window.refresh()
    enter(window, PIN)
    assert window.setup.outer.currentIndex() == 1
    window.setup.lock_button.click()
    assert window.setup.outer.currentIndex() == 0
    assert window.setup.pad.entry.text().strip() == ""


def test_commissioning_locks_itself(open_window: Opener) -> None:
    window = open_window(Rehearsal())
    window.show_page("setup")
    enter(window, PIN)
    for _ in range(int(window.screen_config.lock_s * 1000 / window.screen_config.refresh_ms) + 2):
        window.setup.show_snapshot(window._session.snapshot())
    assert window.setup.outer.currentIndex() == 0


def test_a_joint_moves_only_while_a_button_is_held(open_window: Opener, qtbot: QtBot) -> None:
    session = Rehearsal()
    session.reset()
    window = open_window(session)
    window.show_page("setup")
    enter(window, PIN)
    window.setup.choose("setup_move")
    part = window.setup.mover
    for _ in range(3):
        window.refresh()
    part.buttons[3].click()
    qtbot.mouseClick(part.begin_button, Qt.MouseButton.LeftButton)
    window.refresh()
    assert session.job.jogging
    assert session.stick.along == 0.0 and not session.stick.deadman
    qtbot.mousePress(part.plus, Qt.MouseButton.LeftButton)
    for _ in range(2):  # the enable key is held with the stick centred first
        window.refresh()
    assert session.stick.along > 0.0 and session.stick.deadman
    qtbot.mouseRelease(part.plus, Qt.MouseButton.LeftButton)
    window.refresh()
    assert session.stick.along == 0.0 and not session.stick.deadman
    window.show_page("alarms")
    assert not session.job.jogging and session.stick.lost


def test_planted_faults_are_told_and_healed(open_window: Opener) -> None:
    session = Rehearsal()
    window = open_window(session)
    window.show_page("setup")
    enter(window, PIN)
    window.setup.choose("setup_rig")
    part = window.setup.parts["setup_rig"]
    part.buttons["drop"].click()
    assert session.faults == {"JointPosition1": "drop"}
    part.buttons["estop"].click()
    assert session.estop
    part.buttons["heal"].click()
    assert session.faults == {} and not session.estop
    QCoreApplication.processEvents()
