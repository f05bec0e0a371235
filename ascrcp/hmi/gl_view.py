"""The 3-D view with OpenGL: pyqtgraph's GLViewWidget, same colours, depth and camera as the drawn view."""

from typing import Any

import numpy as np
import pyqtgraph.opengl as gl
from OpenGL import GL
from pyqtgraph import Vector
from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent

from ascrcp.hmi.camera import Camera, is_inside
from ascrcp.hmi.scene_part import ArmLine, brightness, label_table, path_segments, rgb, unsolved_points
from ascrcp.hmi.theme import SceneColours
from ascrcp.session.snapshot import Scene

CLOUD_PX = 2.26
"""Diameter of a disc that covers as much as the drawn view's squares of 2 px."""

UNSOLVED_PX, JOINT_PX = 7.0, 9.0
PATH_PX, DONE_PX, ARM_PX, SPRAY_PX, SPRAYING_PX = 1.0, 3.0, 5.0, 2.0, 6.0

ON_TOP = {GL.GL_DEPTH_TEST: False, GL.GL_BLEND: False}
"""Path and arm are never hidden by the wall: the operator looks for them, not at it."""

NOTHING = np.zeros((0, 3))


def _rgba(colour: str) -> tuple[float, float, float, float]:
    red, green, blue = rgb(colour)
    return red / 255, green / 255, blue / 255, 1.0


class GlView(gl.GLViewWidget):  # type: ignore[misc]  # pyqtgraph has no types
    """Cloud and path are sent to the graphics card when they change; only the arm moves."""

    def __init__(self, colours: SceneColours, void: str, camera: Camera) -> None:
        super().__init__()
        # the eye is moved by the buttons alone: pyqtgraph's own dragging would lose the camera
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._table = label_table(colours).astype(np.float32) / 255
        self.setBackgroundColor(void)
        self._scene = Scene()
        self._camera = camera
        self._cloud = gl.GLScatterPlotItem(pos=NOTHING, size=CLOUD_PX, glOptions="opaque")
        self.addItem(self._cloud)
        # in the order in which they cover each other
        self._path = self._add_lines(colours.path, PATH_PX, mode="lines")
        self._unsolved = self._add_dots(colours.path_unsolved, UNSOLVED_PX)
        self._done = self._add_lines(colours.path_done, DONE_PX, mode="lines")
        self._arm = self._add_lines(colours.arm, ARM_PX)
        self._joints = self._add_dots(colours.joint, JOINT_PX)
        self._spray = self._add_lines(colours.spray, SPRAY_PX)
        self.look(camera)

    def look(self, camera: Camera) -> None:
        """Take another camera."""
        self._camera = camera
        self.opts["fov"] = camera.fov_deg
        self.setCameraPosition(
            pos=Vector(*camera.centre),
            distance=camera.distance,
            elevation=camera.elevation_deg,
            azimuth=camera.azimuth_deg,
        )
        self._shade()

    def draw_scene(self, scene: Scene) -> None:
        """Take another scene."""
        self._scene = scene
        self._cloud.setData(pos=scene.points)
        self._shade()
        self._path.setData(pos=scene.path[path_segments(scene)].reshape(-1, 3))
        self._unsolved.setData(pos=unsolved_points(scene))
        self._done.setData(pos=NOTHING)

    def draw_progress(self, point: int) -> None:
        """Mark the path as done up to a planned point; -1 for nothing."""
        segments = path_segments(self._scene)
        self._done.setData(pos=self._scene.path[segments[segments[:, 1] <= point]].reshape(-1, 3))

    def draw_arm(self, arm: ArmLine) -> None:
        """Put the arm where it is now."""
        self._arm.setData(pos=arm.chain)
        self._joints.setData(pos=arm.chain)
        if arm.spray is not None:
            self._spray.setData(pos=arm.spray, width=SPRAYING_PX if arm.spraying else SPRAY_PX)

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802
        """Shade what another size shows."""
        super().resizeEvent(event)
        self._shade()

    def _add_lines(self, colour: str, width: float, mode: str = "line_strip") -> Any:
        return self._add(gl.GLLinePlotItem(pos=NOTHING, color=_rgba(colour), width=width, mode=mode))

    def _add_dots(self, colour: str, size: float) -> Any:
        return self._add(gl.GLScatterPlotItem(pos=NOTHING, color=_rgba(colour), size=size))

    def _add(self, item: Any) -> Any:
        item.setGLOptions(ON_TOP)
        item.setDepthValue(len(self.items))  # drawn after what was added before
        self.addItem(item)
        return item

    def _shade(self) -> None:
        """Let the cloud's colours fade with depth."""
        points = self._scene.points
        if not len(points):
            return
        width, height = max(1, self.width()), max(1, self.height())
        pixels, depth = self._camera.project(points.astype(np.float64), width, height)
        bright = brightness(depth, is_inside(pixels, depth, width, height)).astype(np.float32)
        colour = np.ones((len(points), 4), np.float32)
        colour[:, :3] = self._table[self._scene.labels] * bright[:, None]
        self._cloud.setData(color=colour)
