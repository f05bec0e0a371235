"""The 3-D picture: camera, cloud in chunks, path and arm over it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot
from rehearsal import SCAN_POSE, make_scene

from ascrcp.core.flow import Label
from ascrcp.hmi.camera import NEAR, Camera, first_camera, named_cameras
from ascrcp.hmi.cloud import FADE, SPLAT_PX, SplatCloud, brightness
from ascrcp.hmi.preparation import Prepared, cut, prepare
from ascrcp.hmi.scene_canvas import SceneCanvas
from ascrcp.hmi.scene_part import (
    arm_line,
    arrow_wings,
    label_table,
    path_segments,
    project_lines,
    unsolved_points,
    wall_hits,
)
from ascrcp.hmi.theme import Screen, rgb
from ascrcp.kinematics import load_arm
from ascrcp.session.snapshot import Scene

angles = st.floats(-180, 180)
lengths = st.floats(2.0, 50.0)
LEVEL = Camera((0.0, 0.0, 0.0), 180.0, 0.0, 10.0, 60.0)
BLACK = (0, 0, 0)


@given(angles, st.floats(-80, 80), lengths)
def test_centre_is_in_the_middle_and_up_is_up(azimuth: float, elevation: float, distance: float) -> None:
    camera = Camera((5.0, 1.0, 2.0), azimuth, elevation, distance, 60.0)
    points = np.array([camera.centre, np.add(camera.centre, [0, 0, 0.1])])
    pixels, depth = camera.project(points, 800, 600)
    np.testing.assert_allclose(pixels[0], [400, 300], atol=1e-6)
    np.testing.assert_allclose(depth[0], distance)
    assert pixels[1, 1] < 300
    _, axes = camera.axes
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)


def test_field_of_view_spans_the_width() -> None:
    edge = 10.0 * np.tan(np.radians(30))
    pixels, _ = LEVEL.project(np.array([[0, edge, 0], [0, -edge, 0]]), 800, 600)
    np.testing.assert_allclose(pixels[:, 0], [0, 800], atol=1e-9)  # y is left, seen along +x


def splat(points: np.ndarray, colours: np.ndarray, chunk: int = 100) -> np.ndarray:
    """Red, green, blue of a picture of 80 x 60 px."""
    painter = SplatCloud(chunk)
    table = np.zeros((256, 3), np.uint8)
    table[: len(colours)] = colours
    painter.take(points.astype(np.float32), np.arange(len(points), dtype=np.uint8), table)
    painter.begin(LEVEL, 80, 60, BLACK)
    while painter.add():
        pass
    return painter._pixels[..., 2::-1].copy()


def test_near_hides_far_and_behind_is_not_drawn() -> None:
    colours = np.array([[255, 0, 0], [0, 0, 255], [0, 255, 0]], np.uint8)
    points = np.array([[0.0, 0, 0], [5.0, 0, 0], [-30.0, 0, 0]])
    for order in ([0, 1, 2], [2, 1, 0]):
        for chunk in (1, 3):
            image = splat(points[order], colours[order], chunk)
            assert image[30, 40, 0] == 255
            assert image[..., 1].max() == 0
    assert splat(np.zeros((0, 3)), np.zeros((0, 3), np.uint8)).max() == 0
    assert LEVEL.project(points[2:], 80, 60)[1][0] < NEAR


def test_no_corner_of_a_far_point_covers_a_near_one() -> None:
    pixel = 10.0 * np.tan(np.radians(30)) / 40  # metres a pixel at the centre
    shifts = np.array([[0.0, dy * pixel, dz * pixel] for dy in (-1, 0, 1) for dz in (-1, 0, 1)])
    points = np.vstack([[[0.0, 0.0, 0.0]], shifts * 1.5 + [5.0, 0.0, 0.0]])
    colours = np.array([[255, 0, 0]] + [[0, 0, 255]] * 9, np.uint8)
    for order in (slice(None), slice(None, None, -1)):
        for chunk in (1, 4, 100):
            assert (splat(points[order], colours[order], chunk)[..., 0] == 255).sum() == SPLAT_PX**2


def test_a_cloud_in_chunks_is_the_cloud_at_once(screen: Screen) -> None:
    ready = prepare(make_scene(points=5000), 5000)
    table = label_table(screen.look.scene)
    camera = first_camera(screen.view)
    pictures = []
    for chunk in (700, 100_000):
        painter = SplatCloud(chunk)
        painter.take(ready.points, ready.labels, table)
        painter.begin(camera, 160, 120, BLACK)
        while painter.add():
            pass
        pictures.append(painter._pixels.copy())
    np.testing.assert_array_equal(*pictures)


def test_brightness_falls_with_depth() -> None:
    depth = np.array([1.0, 2.0, 3.0, 4.0, 90.0])
    np.testing.assert_allclose(brightness(depth, 2.0, 4.0), [1.0, 1.0, 1 - FADE / 2, 1 - FADE, 1 - FADE])


def test_buttons_only_move_the_eye(screen: Screen) -> None:
    camera = first_camera(screen.view)
    assert camera.turn(15).turn(-15) == camera
    assert camera.approach(1.25).distance < camera.distance
    assert camera.approach(1e9).distance > 0
    assert list(named_cameras(screen.view)) == ["view_behind", "view_side", "view_top"]


def test_unknown_labels_look_like_other(screen: Screen) -> None:
    table = label_table(screen.look.scene)
    assert tuple(table[Label.ARCH]) == rgb(screen.look.scene.arch)
    assert tuple(table[200]) == rgb(screen.look.scene.other)


def test_path_is_broken_between_passes() -> None:
    scene = make_scene()
    segments = path_segments(scene)
    assert len(segments) == len(scene.path) - 6
    assert (scene.path_pass[segments[:, 0]] == scene.path_pass[segments[:, 1]]).all()
    assert path_segments(Scene()).shape == (0, 2)


def test_arrows_point_along_the_path() -> None:
    lines = np.stack([np.arange(100.0)[:, None] * [20.0, 0.0], np.arange(1, 101.0)[:, None] * [20.0, 0.0]], 1)
    wings = arrow_wings(lines)
    assert len(wings) > 4
    assert (wings[:, 1, 0] < wings[:, 0, 0]).all()  # wings trail behind the tip
    assert set(np.sign(wings[:, 1, 1])) == {-1.0, 1.0}


def test_lines_behind_the_eye_are_left_out() -> None:
    lines = np.array([[[0.0, 0, 0], [1.0, 0, 0]], [[-30.0, 0, 0], [0.0, 0, 0]]])
    assert len(project_lines(lines, LEVEL, 80, 60)) == 1


def test_jets_meet_the_wall_a_stand_off_away() -> None:
    scene = make_scene()
    hits = wall_hits(scene)
    np.testing.assert_allclose(np.linalg.norm(hits - scene.path, axis=1), 1.0)
    assert wall_hits(replace(scene, path_direction=np.zeros((0, 3)))).shape == (0, 3)


def test_path_may_come_before_its_solution(qtbot: QtBot, screen: Screen) -> None:
    scene = replace(make_scene(), solved=np.zeros(0, np.bool_))
    assert len(unsolved_points(scene)) == 0
    assert len(unsolved_points(make_scene())) == 4
    canvas = SceneCanvas(screen, first_camera(screen.view), SplatCloud(9000))
    qtbot.addWidget(canvas)
    canvas.draw_scene(prepare(scene, 10_000))
    assert not canvas.grab().isNull()


def test_any_first_part_of_a_prepared_cloud_is_an_even_sample() -> None:
    scene = make_scene(points=20_000)
    assert scene.surface is not None
    ready = prepare(scene, 20_000)
    assert sorted(map(tuple, ready.points[:50])) != sorted(map(tuple, scene.surface.points[:50]))
    whole = np.sort(ready.points, axis=0)
    np.testing.assert_array_equal(whole, np.sort(scene.surface.points, axis=0))
    part = ready.points[:2000]
    np.testing.assert_allclose(part.mean(axis=0), ready.points.mean(axis=0), atol=0.3)
    assert len(prepare(scene, 1000).points) == 1000


@given(st.floats(4.0, 14.0), st.floats(0.0, 0.5))
def test_a_section_holds_the_points_near_its_station(station: float, half: float) -> None:
    ready = READY
    points, labels = cut(ready, station, half)
    x = ready.scene.surface.points[:, 0]  # type: ignore[union-attr]
    near = np.abs(x - np.float32(station)) <= half
    edge = np.abs(np.abs(x - np.float32(station)) - half) < 1e-5
    assert abs(len(points) - near.sum()) <= edge.sum()
    assert len(points) == len(labels)


READY: Prepared = prepare(make_scene(points=3000), 3000)


def test_arm_ends_at_the_nozzle() -> None:
    arm = load_arm("kc")
    line = arm_line(arm.frames(SCAN_POSE), spraying=True)
    T = arm.forward(SCAN_POSE)
    np.testing.assert_allclose(line.chain[-1], T[:3, 3])
    np.testing.assert_allclose(line.spray[1] - line.spray[0], T[:3, 0], atol=1e-12)


def test_canvas_fills_up_and_begins_anew_when_it_turns(qtbot: QtBot, screen: Screen) -> None:
    canvas = SceneCanvas(screen, first_camera(screen.view), SplatCloud(1000))
    qtbot.addWidget(canvas)
    canvas.resize(300, 200)
    canvas.draw_scene(prepare(make_scene(points=4500), 4500))
    times = 0
    while not canvas.is_complete:
        canvas.advance()
        times += 1
    assert times == 5
    canvas.look(canvas.camera.turn(3))
    assert not canvas.is_complete


@pytest.mark.parametrize("theme", ["night", "day"])
def test_canvas_shows_sprayed_part_arm_and_ghost(qtbot: QtBot, screen: Screen, theme: str) -> None:
    import msgspec
    from PySide6.QtGui import QImage

    look = msgspec.structs.replace(screen, theme=theme)
    canvas = SceneCanvas(look, first_camera(screen.view), SplatCloud(50_000))
    qtbot.addWidget(canvas)
    canvas.resize(480, 360)
    arm = load_arm("kc")
    canvas.draw_scene(prepare(make_scene(), 40_000))

    def count(name: str) -> int:
        image = canvas.grab().toImage().convertToFormat(QImage.Format.Format_RGB32)
        pixels = np.array(image.constBits(), np.uint8).reshape(360, 480, 4)[..., 2::-1].astype(int)
        return int((np.abs(pixels - rgb(getattr(look.look.scene, name))).max(axis=-1) <= 2).sum())

    before = {name: count(name) for name in ("path_done", "arm", "target")}
    canvas.draw_progress(200)
    canvas.draw_arm(arm_line(arm.frames(SCAN_POSE), spraying=True))
    canvas.draw_ghost(arm_line(arm.frames(SCAN_POSE + 0.2), spraying=False))
    assert all(count(name) > before[name] + 20 for name in before)
    canvas.draw_ghost(None)
    canvas.draw_progress(-1)
    assert count("path_done") <= before["path_done"] + 5
