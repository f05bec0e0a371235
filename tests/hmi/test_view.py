"""Both 3-D views: the same camera, the same colours, near over far."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytestqt.qtbot import QtBot
from rehearsal import SCAN_POSE, make_scene

from ascrcp.core.flow import Label
from ascrcp.hmi.camera import NEAR, Camera, first_camera, named_cameras
from ascrcp.hmi.drawn_view import SPLAT_PX, DrawnView, splat
from ascrcp.hmi.scene_part import FADE, arm_line, brightness, label_table, path_segments, rgb, unsolved_points
from ascrcp.hmi.scene_view import has_opengl, thin_scene
from ascrcp.hmi.theme import Screen
from ascrcp.kinematics import load_arm
from ascrcp.session.snapshot import Scene

angles = st.floats(-180, 180)
lengths = st.floats(2.0, 50.0)


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
    camera = Camera((0.0, 0.0, 0.0), 180.0, 0.0, 10.0, 60.0)
    edge = 10.0 * np.tan(np.radians(30))
    pixels, _ = camera.project(np.array([[0, edge, 0], [0, -edge, 0]]), 800, 600)
    np.testing.assert_allclose(pixels[:, 0], [0, 800], atol=1e-9)  # y is left, seen along +x


def test_near_hides_far_and_behind_is_not_drawn(screen: Screen) -> None:
    camera = Camera((0.0, 0.0, 0.0), 180.0, 0.0, 10.0, 60.0)
    colours = np.array([[255, 0, 0], [0, 0, 255], [0, 255, 0]], np.uint8)
    points = np.array([[0.0, 0, 0], [5.0, 0, 0], [-30.0, 0, 0]])
    for order in ([0, 1, 2], [2, 1, 0]):
        image = np.zeros((60, 80, 4), np.uint8)
        splat(points[order], colours[order], camera, image)
        assert image[30, 40, 0] == 255
        assert image[..., 1].max() == 0
    splat(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), camera, image)
    assert camera.project(points[2:], 80, 60)[1][0] < NEAR


def test_no_corner_of_a_far_point_covers_a_near_one() -> None:
    camera = Camera((0.0, 0.0, 0.0), 180.0, 0.0, 10.0, 60.0)
    pixel = 10.0 * np.tan(np.radians(30)) / 40  # metres a pixel at the centre
    shifts = np.array([[0.0, dy * pixel, dz * pixel] for dy in (-1, 0, 1) for dz in (-1, 0, 1)])
    points = np.vstack([[[0.0, 0.0, 0.0]], shifts * 1.5 + [5.0, 0.0, 0.0]])
    colours = np.array([[255, 0, 0]] + [[0, 0, 255]] * 9, np.uint8)
    image = np.zeros((60, 80, 4), np.uint8)
    splat(points, colours, camera, image)
    assert (image[..., 0] == 255).sum() == SPLAT_PX**2


def test_brightness_falls_with_depth_and_only_what_is_seen_counts() -> None:
    depth = np.array([-5.0, 2.0, 3.0, 4.0, 90.0])
    seen = np.array([False, True, True, True, False])
    expected = [1.0, 1.0, 1.0 - FADE / 2, 1.0 - FADE, 1.0 - FADE]
    np.testing.assert_allclose(brightness(depth, seen), expected)
    assert (brightness(depth, ~np.ones(5, np.bool_)) == 1.0).all()


def test_buttons_only_move_the_eye(screen: Screen) -> None:
    camera = first_camera(screen.view)
    assert camera.turn(15).turn(-15) == camera
    assert camera.approach(1.25).distance < camera.distance
    assert camera.approach(1e9).distance > 0
    assert list(named_cameras(screen.view)) == ["view_behind", "view_side", "view_top"]


def test_unknown_labels_look_like_other(screen: Screen) -> None:
    table = label_table(screen.scene_colours)
    assert tuple(table[Label.ARCH]) == rgb(screen.scene_colours.arch)
    assert tuple(table[200]) == rgb(screen.scene_colours.other)


def test_path_is_broken_between_passes() -> None:
    scene = make_scene()
    segments = path_segments(scene)
    assert len(segments) == len(scene.path) - 6
    assert (scene.path_pass[segments[:, 0]] == scene.path_pass[segments[:, 1]]).all()
    assert path_segments(Scene()).shape == (0, 2)


def test_path_may_come_before_its_solution(qtbot: QtBot, screen: Screen) -> None:
    scene = replace(make_scene(), solved=np.zeros(0, np.bool_))
    assert len(unsolved_points(scene)) == 0
    assert len(unsolved_points(make_scene())) == 4
    view = DrawnView(screen.scene_colours, screen.colours.void, first_camera(screen.view))
    qtbot.addWidget(view)
    view.draw_scene(scene)
    assert not view.grab().isNull()


def test_thinning_keeps_the_number_and_the_ends() -> None:
    scene = make_scene(points=10_000)
    thin = thin_scene(scene, 1000)
    assert len(thin.points) == len(thin.labels) == 1000
    assert (thin.points[0] == scene.points[0]).all() and (thin.points[-1] == scene.points[-1]).all()
    assert thin_scene(scene, 10_000) is scene


def test_arm_ends_at_the_nozzle() -> None:
    arm = load_arm("kc")
    line = arm_line(arm.frames(SCAN_POSE), spraying=True)
    T = arm.forward(SCAN_POSE)
    np.testing.assert_allclose(line.chain[-1], T[:3, 3])
    assert line.spray is not None
    np.testing.assert_allclose(line.spray[1] - line.spray[0], T[:3, 0], atol=1e-12)


def test_opengl_view_takes_the_same_scene_and_arm(qtbot: QtBot, screen: Screen) -> None:
    pytest.importorskip("OpenGL.GL", exc_type=ImportError)
    from ascrcp.hmi.gl_view import GlView

    view = GlView(screen.scene_colours, screen.colours.void, first_camera(screen.view))
    qtbot.addWidget(view)
    scene = make_scene()
    view.draw_scene(scene)
    view.draw_progress(100)
    view.draw_arm(arm_line(load_arm("kc").frames(SCAN_POSE), spraying=False))
    view.look(first_camera(screen.view).turn(15))
    assert len(view._done.pos) == 2 * (100 - 1)
    assert len(view._cloud.pos) == len(scene.points)
    eye = view.cameraPosition()
    expected, _ = first_camera(screen.view).turn(15).axes
    np.testing.assert_allclose([eye.x(), eye.y(), eye.z()], expected, atol=1e-4)


def test_probe_does_not_raise(qtbot: QtBot) -> None:
    assert has_opengl() in (True, False)
