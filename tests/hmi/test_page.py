"""Pages: strip, frozen data, theme, dry run, trends, maps, alarm history."""

import math
import statistics
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from rehearsal import Rehearsal, make_scene
from slot_times import measure

from ascrcp.hmi.health_panel import bus_load
from ascrcp.hmi.joint_table import joint_state
from ascrcp.hmi.playback import pose_at
from ascrcp.hmi.quantity import ANGLE, LENGTH, TIP_ERROR_MM, Quantity
from ascrcp.hmi.status_panel import FrozenWatch, platform_state
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, colour_scale, rgb
from ascrcp.hmi.trend import KEPT, SAMPLES, Curves, Recorder, find_axis
from ascrcp.hmi.wall_map import WallView, paint_values
from ascrcp.hmi.window import Window
from ascrcp.kinematics import load_arm
from ascrcp.session.snapshot import Snapshot, WallLayer
from ascrcp.session.state import STEPS, JobState, Step

Opener = Callable[..., Window]


def loaded(ticks: int = 9999) -> Rehearsal:
    session = Rehearsal(ticks)
    session.reset()
    session.job = JobState(stopped=False, done=frozenset(STEPS[:4]))
    session.drawn = make_scene()
    return session


def show(window: Window, times: int = 3) -> None:
    for _ in range(times):
        window.refresh()
        QApplication.processEvents()


@pytest.mark.parametrize("how", ["click", "key"])
def test_every_page_by_touch_and_by_key_under_the_same_frame(
    open_window: Opener, qtbot: QtBot, how: str
) -> None:
    window = open_window(loaded())
    places = set()
    for number, page in enumerate(window.pages):
        if how == "click":
            qtbot.mouseClick(window.strip.buttons[page.key], Qt.MouseButton.LeftButton)
        else:
            qtbot.keyClick(window, Qt.Key(Qt.Key.Key_F1 + number))
        show(window, 1)
        assert window.page is page and page.isVisible()
        assert [key for key, button in window.strip.buttons.items() if button.isChecked()] == [page.key]
        parts = (window.rail.stop_button, window.status, window.steps, window.alarm)
        places.add(
            tuple((*part.mapTo(window, QPoint(0, 0)).toTuple(), *part.size().toTuple()) for part in parts)
        )
    assert len(places) == 1


def test_alarm_button_counts(open_window: Opener) -> None:
    session = loaded()
    window = open_window(session)
    session.causes = ("joint_stale", "bus_error")
    show(window)
    assert "2" in window.strip.buttons["alarms"].text()
    window.show_page("alarms")
    show(window)
    model = window.alarms.table.text_model
    cells = [[model.data(model.index(row, column)) for column in range(5)] for row in range(3)]
    assert {cells[0][2], cells[1][2]} == {"F1", "F30/F33"}
    assert [row[1] for row in cells[:2]] == [say("alarm_also", Language.EN), say("alarm_first", Language.EN)]
    assert say("alarm_active", Language.EN) in cells[0][4]


@given(st.lists(st.booleans(), max_size=60), st.integers(2, 9), st.booleans())
def test_data_is_frozen_when_real_time_stands_still(moves: list[bool], patience: int, lockstep: bool) -> None:
    watch, t, still = FrozenWatch(patience), 0.0, 0
    for number, moved in enumerate(moves):
        t += 0.02 * moved
        frozen = watch.is_frozen(Snapshot(t, JobState(), lockstep=lockstep))
        still = 0 if moved or number == 0 else still + 1
        assert frozen == (still > patience and not lockstep)


def test_frozen_is_said_before_everything(open_window: Opener) -> None:
    session = loaded()
    session.start(Step.RUN)
    session.more = {"lockstep": False, "t_s": 5.0, "estop": True}
    window = open_window(session)
    show(window, 20)
    assert window.status.state.text() == say("frozen", Language.EN)
    assert platform_state(session.snapshot(), True) == ("frozen", "danger")
    del session.more["t_s"]
    show(window, 2)
    assert window.status.state.text() == say("estop", Language.EN)


def test_theme_can_be_switched_at_rest_and_back(open_window: Opener, qtbot: QtBot) -> None:
    session = loaded()
    window = open_window(session)
    window.settle()

    def middle() -> tuple[int, ...]:
        show(window, 3)
        window.settle()
        return window.grab().toImage().pixelColor(4, 4).getRgb()[:3]

    colours = window.screen_config.themes
    assert middle() == rgb(colours.night.colours.background)
    qtbot.mouseClick(window.rail.theme_button, Qt.MouseButton.LeftButton)
    assert middle() == rgb(colours.day.colours.background)
    session.start(Step.RUN)  # into the tunnel and out of it the arm may move
    show(window, 1)
    qtbot.mouseClick(window.rail.theme_button, Qt.MouseButton.LeftButton)
    assert middle() == rgb(colours.night.colours.background)


def test_dry_run_plays_and_ends_when_the_arm_moves(open_window: Opener, qtbot: QtBot) -> None:
    session = loaded()
    window = open_window(session)
    window.settle()
    show(window)
    bar, sequence = window.automatic.playback, session.drawn.sequence
    assert sequence is not None
    qtbot.mouseClick(bar.play_button, Qt.MouseButton.LeftButton)
    show(window, 5)
    assert 0.0 < bar.t_s < sequence.duration
    assert window.automatic.dry_note.isVisible() and window.automatic.scene.canvas._ghost is not None
    bar.slider.setValue(500)
    assert bar.t_s == pytest.approx(sequence.duration / 2, rel=0.01)
    assert session.job.active is None  # nothing was asked of the machine
    session.start(Step.GO_TO_START)
    show(window, 1)
    assert not window.automatic.dry_note.isVisible() and window.automatic.scene.canvas._ghost is None
    assert not bar.play_button.isEnabled()


@given(st.floats(-1.0, 200.0))
def test_dry_run_shows_the_sequence(t: float) -> None:
    sequence = SEQUENCE
    q, _ = pose_at(sequence, t)
    wanted = [np.interp(t, sequence.t, column) for column in sequence.q.T]
    np.testing.assert_allclose(q, wanted, atol=1e-9)


SEQUENCE = make_scene().sequence
assert SEQUENCE is not None


def test_low_clearance_is_said_where_it_is_planned(open_window: Opener) -> None:
    session = loaded()
    session.start(Step.RUN)
    window = open_window(session)
    window.settle()
    for point, is_low in ((5, False), (35, True), (60, False)):
        session.more = {"point": point}
        show(window, 1)
        assert window.automatic.scene.warning.isVisible() == is_low
    session.more = {"point": 35}
    show(window, 1)
    assert "0.11 m" in window.automatic.scene.warning.text()


def test_wall_map_left_is_left_and_up_is_into_the_tunnel() -> None:
    values = np.zeros((3, 4), np.float32)
    values[2, 3] = 1.0  # farthest station, largest arc length: left of the tunnel
    values[0, 0] = np.nan
    layer = WallLayer(np.arange(3.0), np.arange(4.0), values)
    table = colour_scale(["#000000", "#ffffff"])
    image = paint_values(layer, WallView((0.0, 2.0), (0.0, 3.0)), table, (0.0, 1.0), "#ff0000")
    assert image.pixelColor(0, 0).getRgb()[:3] == (255, 255, 255)
    assert image.pixelColor(3, 2).getRgb()[:3] == (255, 0, 0)
    assert image.pixelColor(1, 1).getRgb()[:3] == (0, 0, 0)


def test_a_touch_on_the_map_chooses_the_section(open_window: Opener, qtbot: QtBot) -> None:
    session = loaded()
    window = open_window(session)
    window.settle()
    window.show_page("wall")
    show(window)
    area = window.wall.map._area()
    qtbot.mouseClick(window.wall.map, Qt.MouseButton.LeftButton, pos=area.center().toPoint())
    low, high = window.wall.map._view.station  # type: ignore[union-attr]
    assert window.wall.map.station == pytest.approx((low + high) / 2, abs=0.05)
    before = window.wall.map.station
    window.wall.on.click()
    assert window.wall.map.station == pytest.approx(before + 0.10, abs=0.011)
    window.wall._show(11.6)
    assert window.wall.section.worst() == pytest.approx(0.2, abs=0.06)
    qtbot.mouseClick(window.wall.at_nozzle, Qt.MouseButton.LeftButton)
    session.more = {"tip": (10.0, 0.0, 4.0), "tip_direction": (0.0, 0.0, 1.0)}
    show(window)
    assert window.wall.map.station == pytest.approx(10.0, abs=0.01)
    assert window.wall.layers["predicted"].isEnabled() and not window.wall.layers["achieved"].isEnabled()


def test_trend_keeps_its_span_and_no_more() -> None:
    recorder = Recorder(180.0)
    for t in np.arange(0.0, 400.0, 0.05):
        recorder.note(Snapshot(float(t), JobState(), q=(float(t),) * 8, q_target=(0.0,) * 8))
    assert len(recorder.rows) <= SAMPLES + 1
    actual, target = recorder.joint(3)
    assert actual[-1][0] - actual[0][0] >= 170.0
    assert all(t == value for t, value in actual) and len(actual) == len(target)


VALUES = st.lists(st.floats(-3.0, 3.0) | st.just(math.nan), max_size=30)


@given(VALUES, VALUES, st.sampled_from([ANGLE, LENGTH, TIP_ERROR_MM]))
def test_trend_axis_has_room_for_every_value_and_round_lines(
    first: list[float], then: list[float], unit: Quantity
) -> None:
    axis = None
    for values in (first, then):
        curves = Curves("", unit, list(enumerate(values)), [], len(values))
        axis = find_axis(curves, axis)
        for value in values:
            assert not math.isfinite(value) or axis.low <= unit.scale * value <= axis.high
        ticks = axis.ticks()
        assert ticks[-1] == pytest.approx(axis.high) and 2 <= len(ticks) - 1 <= 3 * KEPT
        assert len({unit.show(tick / unit.scale) for tick in ticks}) == len(ticks), "no number twice"
        assert find_axis(curves, axis) == axis


def test_trend_plot_shows_the_last_minutes(open_window: Opener, screen: Screen) -> None:
    session = Rehearsal(ticks=9999)
    session.reset()
    window = open_window(session)
    page = window.joints_page
    page.trend.make_soon()
    page.trend.close_loading()
    window.show_page("joints")
    for k in range(200):
        session.more = {"t_s": float(k), "q": (0.001 * k,) * 8}
        window.refresh()
    window.refresh()
    plot = page.trend._plot
    assert plot is not None and plot.widget.isVisible()
    assert plot.widget.height() > 0.5 * page.trend.height()
    assert not page.trend.geometry().intersects(page.table.geometry())
    t, shown = plot._actual.getData()
    assert t[-1] == pytest.approx(0.0, abs=5.0) and t[0] >= -screen.trend_s
    assert shown[-1] == pytest.approx(math.degrees(0.001 * (t[-1] + 199)), abs=0.1)
    low, high = plot._box.viewRange()[1]
    assert low < shown.min() and shown.max() < high


def test_joint_states_in_words() -> None:
    joint = load_arm("kc").joints[0]
    base = Rehearsal().snapshot()

    def state(value: float, age: float = 8.0) -> str:
        shot = replace(base, q=(value, *base.q[1:]), age_ms=(age, *base.age_ms[1:]))
        return joint_state(joint, shot, 60.0)

    span = joint.upper - joint.lower
    assert state(0.0) == "joint_fresh"
    assert state(0.0, 90.0) == "joint_stale"
    assert state(joint.upper - 0.01 * span) == "joint_near"
    assert state(joint.upper + 0.01) == "joint_beyond"
    assert state(math.nan) == "joint_unknown"


def test_bus_load_of_a_full_bus_is_one() -> None:
    frames = tuple((i, bytes(8)) for i in range(150))
    assert 0.9 < bus_load(frames) < 1.05  # 111 bits and stuffing: 150 frames fill 20 ms at 1 Mbit/s
    assert bus_load(()) == 0.0


def test_no_slot_keeps_the_interpreter_for_long(screen: Screen, qapp: QApplication) -> None:
    """Half a million points, a whole round's path; 3 ms by processor time, four times when busy."""
    times = measure(screen)
    for name, values in times.items():
        assert statistics.median(values) < 3.0, name
        assert max(values) < 12.0, name
