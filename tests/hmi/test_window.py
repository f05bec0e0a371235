"""The real window, off screen, on the real state machine."""

import time
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QObject, QPoint, Qt, QTimer
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QAbstractButton, QApplication, QLabel, QWidget
from pytestqt.qtbot import QtBot
from rehearsal import Rehearsal, make_scene

from ascrcp.core.event import EVENTS, Reaction
from ascrcp.hmi.status_panel import platform_state
from ascrcp.hmi.text import STEP_NAME, Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.window import Window
from ascrcp.session.state import STEPS, JobState, Mode, Refusal, Step

Opener = Callable[..., Window]


def ready(
    done: int = 0, *, ticks: int = 4, active: Step | None = None, mode: Mode = Mode.AUTOMATIC
) -> Rehearsal:
    """Return a session after reset with the first steps done, perhaps in the middle of one."""
    session = Rehearsal(ticks)
    session.reset()
    session.job = JobState(mode=mode, stopped=False, done=frozenset(STEPS[:done]))
    if active is not None:
        session.start(active)
    return session


def refresh(window: Window, times: int = 1) -> None:
    for _ in range(times):
        window.refresh()
    QCoreApplication.processEvents()


def pixels(window: Window) -> np.ndarray:
    image = window.grab().toImage().convertToFormat(QImage.Format.Format_RGB32)
    return np.array(image.constBits(), np.uint8).reshape(image.height(), image.width(), 4)[..., :3]


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("active", [None, *STEPS])
def test_buttons_follow_the_state_machine(open_window: Opener, active: Step | None, mode: Mode) -> None:
    session = ready(ticks=9999)
    window = open_window(session)
    for done, stopped in product(range(6), [True, False] if active is None else [False]):
        session.job = JobState(mode, active, frozenset(STEPS[:done]) - {active}, stopped)
        session.left = 9999
        for _ in range(2):  # the stick on the screen shows itself at the first
            window.refresh()
        for step in STEPS:
            check_button(window, session, step)


def check_button(window: Window, session: Rehearsal, step: Step) -> None:
    button, reason = window.steps.buttons[step], window.steps.reasons[step].text()
    refusal = session.refusal(step)
    assert button.isEnabled() == (refusal is None)
    assert STEP_NAME[step][0] in button.text()
    is_active = step is session.job.active
    state = "active" if is_active else "done" if step in session.job.done else "todo"
    assert say(state, Language.EN) in button.text()
    assert reason == ("" if refusal is None or is_active else refusal.value[0])


def test_whole_job_by_hand(open_window: Opener, qtbot: QtBot) -> None:
    session = Rehearsal(ticks=3)
    window = open_window(session)
    assert window.steps.reasons[Step.ZERO].text() == Refusal.STOPPED.value[0]
    qtbot.mouseClick(window.rail.reset_button, Qt.MouseButton.LeftButton)
    refresh(window)
    for number, step in enumerate(STEPS, 1):
        qtbot.mouseClick(window.steps.buttons[step], Qt.MouseButton.LeftButton)
        assert session.job.active is step
        refresh(window, 4)
        assert step in session.job.done
        assert f"{step.value} done" in window.alarm.messages.text()
        assert len(session.messages) == number
    assert window.status.state.text() == say("finished", Language.EN)
    assert window.automatic.scene._scene.version == session.drawn.version == 1


@pytest.mark.parametrize("how", ["button", "space", "f12"])
@pytest.mark.parametrize("active", [None, *STEPS])
def test_stop_acts_on_press_in_every_state(
    open_window: Opener, qtbot: QtBot, active: Step | None, how: str
) -> None:
    session = ready(5 if active is None else STEPS.index(active), ticks=99, active=active)
    window = open_window(session)
    if how == "button":
        qtbot.mousePress(window.rail.stop_button, Qt.MouseButton.LeftButton)  # not released
    else:
        qtbot.keyPress(window, Qt.Key.Key_Space if how == "space" else Qt.Key.Key_F12)
    assert session.stops == 1
    assert session.job.stopped
    refresh(window)
    assert window.status.state.text() == say("stopped", Language.EN)
    assert EVENTS["operator_stop"].cause[0] == window.alarm.rows["cause"][1].text()
    qtbot.mouseRelease(window.rail.stop_button, Qt.MouseButton.LeftButton)


def test_stop_is_in_the_same_place_and_large_in_every_state(open_window: Opener, screen: Screen) -> None:
    session = ready(4, ticks=99)
    window = open_window(session)
    places = set()
    for language in Language:
        window.set_language(language)
        window.settle()
        for change in ({}, {"causes": ("estop", "joint_stale"), "estop": True}, {"simulated": False}):
            session.more = change
            refresh(window)
            button = window.rail.stop_button
            assert button.isEnabled() and button.isVisible()
            places.add((*button.mapTo(window, QPoint(0, 0)).toTuple(), *button.size().toTuple()))
    assert len(places) == 1
    (_, _, width, height) = places.pop()
    assert min(width, height) >= 2 * screen.touch_px


def test_every_button_is_large_enough_for_gloves(open_window: Opener, screen: Screen) -> None:
    for language in Language:
        window = open_window(ready(2), language)
        for button in window.findChildren(QAbstractButton):
            if button.isVisible():
                name = button.objectName()
                assert button.height() >= screen.touch_px, name
                assert button.width() >= screen.touch_px, name
                assert window.rect().contains(button.mapTo(window, button.rect().bottomRight())), name


@pytest.mark.parametrize("language", Language)
def test_every_page_is_written_when_it_is_first_shown(open_window: Opener, language: Language) -> None:
    window = open_window(ready(2), language)
    for page in window.pages:
        window.show_page(page.key)
        window.refresh()
        blank = [b.objectName() for b in page.findChildren(QAbstractButton) if b.isVisible() and not b.text()]
        assert blank == [], page.key


def shown_texts(window: Window) -> dict[str, str]:
    """Return every text to be read, by a name of its place."""
    texts = {}
    for index, widget in enumerate(window.findChildren(QObject)):
        if isinstance(widget, (QLabel, QAbstractButton)) and widget.isVisible() and widget.text():
            texts[f"{index} {type(widget).__name__}"] = widget.text()
    window.show_page("joints")
    refresh(window, 2)
    model = window.joints_page.table.joint_model
    window.show_page("automatic")
    refresh(window)
    for column in range(model.columnCount()):
        texts[f"header {column}"] = model.headerData(column, Qt.Orientation.Horizontal)
    for row in range(model.rowCount()):
        texts[f"joint {row}"] = model.data(model.index(row, 0))
    texts["bar"] = window.status.bar.format()
    texts["title"] = window.windowTitle()
    return texts


def has_words(text: str) -> bool:
    """Return whether a text holds more than numbers, units and marks."""
    for unit in ("mm", "m", "ms", "°C"):
        text = " ".join(part for part in text.split(" ") if part != unit)
    return any(letter.isalpha() for letter in text)


@pytest.mark.parametrize("state", ["stopped", "running", "semi", "estop"])
def test_language_switch_changes_every_text(open_window: Opener, qtbot: QtBot, state: str) -> None:
    session = {
        "stopped": Rehearsal,
        "running": lambda: ready(4, ticks=999, active=Step.RUN),
        "semi": lambda: ready(4, mode=Mode.SEMI_AUTOMATIC),
        "estop": Rehearsal,
    }[state]()
    if state == "estop":
        session.estop, session.causes = True, ("estop", "joint_stale")
    session._announce("Zero joints: done", "关节归零：完成")
    window = open_window(session)
    window.joints_page.trend._make()  # or it would bring widgets of its own in between
    before = shown_texts(window)
    qtbot.mouseClick(window.rail.language_button, Qt.MouseButton.LeftButton)
    window.settle()
    after = shown_texts(window)
    assert window.language is Language.ZH
    assert before.keys() == after.keys()
    same = {place: text for place, text in before.items() if has_words(text) and text == after[place]}
    assert same == {}
    assert len(before) > 50
    qtbot.mouseClick(window.rail.language_button, Qt.MouseButton.LeftButton)
    window.settle()
    assert shown_texts(window).keys() == before.keys()
    assert window.rail.quit_button.text() == "Quit"


def test_numbers_are_shown_in_their_units(open_window: Opener) -> None:
    session = ready(4, ticks=99)
    q = (0.5, -0.1, 1.2345, 0.2, 0.0, 0.5, 3.0, float("nan"))
    session.more = {
        "q": q, "q_target": (0.6, -0.1, 1.2445, 0.2, 0.0, float("nan"), 3.0, 2.0),
        "drive": (0.255, -1.0, 0, 0, 0, 0, 0, 0), "age_ms": (8, 8, 8, 8, 8, 8, 8, 500),
        "spraying": True,
        "tip": (8.1, -2.4, 3.0), "tip_error_mm": 17.34, "tip_error_deg": 0.42, "reached": 118, "skipped": 2,
        "points": 482, "oil_temp_c": 43.6, "t_s": 754.2,
    }  # fmt: skip
    window = open_window(session)
    window.show_page("joints")
    refresh(window, 2)
    model = window.joints_page.table.joint_model
    window.show_page("automatic")
    refresh(window)

    def row(number: int) -> list[str]:
        return [model.data(model.index(number - 1, column)) for column in range(1, 5)]

    assert row(1) == ["28.6°", "34.4°", "+5.7°", "+26 %"]
    assert row(2) == ["-5.7°", "-5.7°", "+0.0°", "-100 %"]
    assert row(3) in (["1234 mm", "1244 mm", "+10 mm", "+0 %"], ["1234 mm", "1245 mm", "+10 mm", "+0 %"])
    assert row(6) == ["500 mm", "–", "–", "+0 %"]
    assert row(8)[0] == "▲ –"
    assert window.automatic.nozzle.values["position"].text() == "8.100  -2.400  3.000 m"
    assert window.automatic.nozzle.values["nozzle_error"].text() == "17 mm   0.4°"
    assert window.automatic.nozzle.values["points"].text() == "118 of 482, 2 skipped"
    assert window.line.fields["oil"].text() == "Oil 44 °C"
    assert window.line.fields["job_time"].text() == "Job time 12:34"
    assert "max 2.7 ms" in window.line.fields["cycle"].text()


@pytest.mark.parametrize("code", EVENTS)
def test_first_alarm_is_shown_with_cause_effect_action(open_window: Opener, code: str) -> None:
    session = ready()
    session.causes = (code, "bus_error")
    for language in Language:
        window = open_window(session, language)
        event = EVENTS[code]
        window.show_page("alarms")
        refresh(window)
        shown = [window.alarms.rows[key][1].text() for key in ("cause", "consequence", "action")]
        assert window.alarm.rows["action"][1].text() == event.action[language]
        assert shown == [event.cause[language], event.consequence[language], event.action[language]]
        assert event.fault in window.alarm.title.text()


def test_estop_is_mirrored_and_reset_waits_for_its_release(open_window: Opener) -> None:
    session = Rehearsal()
    session.estop, session.causes = True, ("estop",)
    window = open_window(session)
    assert "PRESSED" in window.rail.estop.text()
    assert not window.rail.reset_button.isEnabled()
    session.estop = False
    refresh(window)
    assert "released" in window.rail.estop.text()
    assert window.rail.reset_button.isEnabled()


def test_the_most_serious_state_wins() -> None:
    session = ready(4, ticks=99, active=Step.RUN)
    shot = session.snapshot()
    assert platform_state(shot) == ("moving", "normal")
    session.more = {"reaction": Reaction.STOP}
    assert platform_state(session.snapshot()) == ("holding", "abnormal")
    session.stop()
    assert platform_state(session.snapshot()) == ("stopped", "abnormal")
    session.more["estop"] = True
    assert platform_state(session.snapshot()) == ("estop", "danger")


def test_a_refused_press_says_why(open_window: Opener) -> None:
    session = ready()
    window = open_window(session)
    session.stop()  # between drawing and pressing
    window.steps.buttons[Step.ZERO].click()
    assert Refusal.STOPPED.value[0] in window.alarm.messages.text()
    window.set_language(Language.ZH)
    window.settle()
    assert Refusal.STOPPED.value[1] in window.alarm.messages.text()
    session._announce("Newer", "新消息")
    refresh(window)
    assert Refusal.STOPPED.value[1] not in window.alarm.messages.text()


def test_cancel_only_while_a_step_is_under_way(open_window: Opener, qtbot: QtBot) -> None:
    session = ready(1, ticks=99, active=Step.RECOGNISE)
    window = open_window(session)
    assert window.rail.cancel_button.isEnabled()
    qtbot.mouseClick(window.rail.cancel_button, Qt.MouseButton.LeftButton)
    refresh(window)
    assert session.job.active is None
    assert not window.rail.cancel_button.isEnabled()


def test_mode_can_be_chosen_at_rest_only(open_window: Opener, qtbot: QtBot) -> None:
    session = ready(4, ticks=99)
    window = open_window(session)
    qtbot.mouseClick(window.status.modes[Mode.SEMI_AUTOMATIC], Qt.MouseButton.LeftButton)
    refresh(window)
    assert session.job.mode is Mode.SEMI_AUTOMATIC
    assert window.automatic.nozzle.title.text() == say("nozzle_semi", Language.EN)
    assert "by the operator" in window.automatic.nozzle.values["spray"].text()
    assert (
        window.steps.reasons[Step.RUN].text() == Refusal.NEEDS_GO_TO_START.value[0]
    )  # each mode has its own
    session.start(Step.ZERO)
    refresh(window)
    assert not any(button.isEnabled() for button in window.status.modes.values())


def test_quit_stops_first_and_asks_by_a_second_press(open_window: Opener, qtbot: QtBot) -> None:
    session = ready(4, ticks=999, active=Step.RUN)
    window = open_window(session)
    qtbot.mouseClick(window.rail.quit_button, Qt.MouseButton.LeftButton)
    assert session.stops == 1
    assert session.closed == 0
    assert window.isVisible()
    assert window.rail.quit_button.text() == say("quit_again", Language.EN)
    assert QApplication.activeModalWidget() is None
    qtbot.mouseClick(window.rail.quit_button, Qt.MouseButton.LeftButton)
    assert session.closed == 1
    assert not window.isVisible()


def test_closing_ends_timer_and_session_once(open_window: Opener, qtbot: QtBot) -> None:
    session = ready(4, ticks=999, active=Step.RUN)
    window = open_window(session)
    window._timer.start(1)
    with qtbot.waitSignal(window.closed):
        window.close()
    window.shut_down()
    assert (session.stops, session.closed) == (1, 1)
    assert not any(timer.isActive() for timer in window.findChildren(QTimer))
    moment = session.moment
    qtbot.wait(20)
    assert session.moment == moment


@pytest.mark.parametrize("language", Language)
def test_picture_shows_cloud_path_and_arm(open_window: Opener, screen: Screen, language: Language) -> None:
    session = ready(4, ticks=99)
    empty = pixels(open_window(session, language))
    session.drawn = make_scene()
    session.start(Step.RUN)
    window = open_window(session, language)
    window.settle()
    full = pixels(window)
    assert full.shape == (screen.size.height, screen.size.width, 3)
    view = window.automatic.scene.canvas
    corner = view.mapTo(window, QPoint(0, 0))
    area = np.s_[corner.y() : corner.y() + view.height(), corner.x() : corner.x() + view.width()]
    assert len(np.unique(empty[area].reshape(-1, 3), axis=0)) > 5  # the arm
    assert len(np.unique(full[area].reshape(-1, 3), axis=0)) > 100
    changed = (full[area] != empty[area]).any(-1)
    assert changed.mean() > 0.1


def test_done_part_of_the_path_stays_until_the_next_run(open_window: Opener) -> None:
    session = ready(4, ticks=999, active=Step.RUN)
    window = open_window(session)

    def marked(point: int) -> int:
        session.more = {"point": point}
        refresh(window)
        return window.automatic.scene._point

    assert [marked(point) for point in (3, -1, 7, 7, -1)] == [3, 3, 7, 7, 7]
    session.job = JobState(stopped=False, done=frozenset(STEPS))
    assert marked(-1) == 7
    session.start(Step.RUN)
    assert marked(-1) == -1


def test_pass_under_way_is_marked_and_another_path_begins_with_nothing_done(open_window: Opener) -> None:
    session = ready(4, ticks=400)
    session.drawn = make_scene()
    window = open_window(session)
    window.settle()
    view, canvas = window.automatic.scene, window.automatic.scene.canvas
    session.start(Step.RUN)
    for _ in range(150):
        window.refresh()
    passes = session.drawn.path_pass
    assert view._point > 60 and set(passes[canvas._now].ravel().tolist()) == {int(passes[view._point])}
    assert (canvas._now[:, 1] <= canvas._done).any() and (canvas._now[:, 1] > canvas._done).any()
    session.stop()
    window.refresh()
    done = view._point
    session.drawn = make_scene(version=2, seed=1)  # scanned again, the same path
    window.refresh()
    window.settle()
    assert view._point == done > 0 and not len(canvas._now)
    session.drawn = make_scene(version=3, passes=3)
    window.refresh()
    window.settle()
    assert view._point == canvas._done == -1


def test_a_refresh_is_short(open_window: Opener) -> None:
    session = ready(4, ticks=100_000)
    session.drawn = make_scene(1, 100_000)
    session.start(Step.RUN)
    window = open_window(session)
    refresh(window, 5)
    snapshots = [session.snapshot() for _ in range(100)]
    started = time.process_time()
    for snapshot in snapshots:
        window._draw(snapshot)
    assert (time.process_time() - started) / len(snapshots) < 0.006  # design: 3 ms; this machine is shared


@pytest.mark.parametrize("language", Language)
@pytest.mark.parametrize("page", ["automatic", "wall", "joints", "alarms", "semi", "setup"])
def test_no_text_is_cut(open_window: Opener, language: Language, page: str) -> None:
    """Every label's words fit its place in both languages, on every page, in the longest states."""
    session = ready(4, ticks=99, active=Step.RUN)
    session.drawn = make_scene()
    session.causes = ("following_error", "bus_error")
    for session.more in ({}, {"estop": True, "reaction": Reaction.ESTOP}, {"point": 35}):
        window = open_window(session, language)
        window.settle()
        window.show_page(page)
        refresh(window, 3)
        assert cut_texts(window) == []


def cut_texts(window: QWidget) -> list[str]:
    """Return the texts that do not fit their places."""
    cut = []
    for label in window.findChildren(QLabel):
        if not label.isVisible() or not label.text() or label.parent() is None:
            continue
        margin = 2
        if label.wordWrap():
            fits = label.heightForWidth(label.width()) <= label.height() + margin
        else:
            size = label.fontMetrics().size(0, label.text())
            fits = size.width() <= label.width() + margin and size.height() <= label.height() + margin
        if not fits:
            cut.append(label.text())
    for button in window.findChildren(QAbstractButton):
        if button.isVisible() and button.text():
            size = button.fontMetrics().size(0, button.text())
            if size.width() > button.width() or size.height() > button.height():
                cut.append(button.text())
    return cut


@pytest.mark.parametrize("language", Language)
def test_no_value_in_the_joint_table_is_cut(open_window: Opener, language: Language) -> None:
    session = ready(3)
    far = (-np.pi, -0.436, 1.9, -1.2, -0.65, 2.2, 6.28, 4.18)
    session.more = {"q": far, "q_target": far, "drive": (-1.0,) * 8, "age_ms": (999.0,) * 8}
    window = open_window(session, language)
    refresh(window, 2)
    for page, table in (("joints", window.joints_page.table),):
        window.show_page(page)
        refresh(window, 2)
        for row, column in product(range(8), range(table.joint_model.columnCount())):
            index = table.joint_model.index(row, column)
            needed = table.sizeHintForIndex(index).width()
            assert needed < table.columnWidth(column), f"{index.data()!r} needs {needed} px"


@pytest.mark.parametrize("language", Language)
def test_every_refusal_fits_below_its_step(open_window: Opener, language: Language) -> None:
    window = open_window(ready(2), language)
    label = window.steps.reasons[Step.RUN]
    cut = []
    for refusal in Refusal:
        label.setText(refusal.value[language])
        if label.heightForWidth(label.width()) > label.height():
            cut.append(refusal.value[language])
    assert cut == []
