"""The 3-D view with OpenGL: pyqtgraph's GLViewWidget, same colours and camera as the drawn view."""

import numpy as np
import pyqtgraph.opengl as gl
from pyqtgraph import Vector

from ascrcp.hmi.camera import Camera
from ascrcp.hmi.scene_part import ArmLine, label_table, path_segments, rgb, unsolved_points
from ascrcp.hmi.theme import SceneColours
from ascrcp.session.snapshot import Scene

CLOUD_PX, UNSOLVED_PX, JOINT_PX = 2.0, 8.0, 9.0


def _rgba(colour: str) -> tuple[float, float, float, float]:
    red, green, blue = rgb(colour)
    return red / 255, green / 255, blue / 255, 1.0


class GlView(gl.GLViewWidget):  # type: ignore[misc]  # pyqtgraph has no types
    """Cloud and path are sent to the graphics card when they change; only the arm moves."""

    def __init__(self, colours: SceneColours, void: str, camera: Camera) -> None:
        super().__init__()
        self._table = np.hstack([label_table(colours), np.full((256, 1), 255)]).astype(np.float32) / 255
        self.setBackgroundColor(void)
        self._scene = Scene()
        nothing = np.zeros((0, 3))
        self._cloud = gl.GLScatterPlotItem(pos=nothing, size=CLOUD_PX, glOptions="opaque")
        self._path = gl.GLLinePlotItem(
            pos=nothing, mode="lines", color=_rgba(colours.path), glOptions="opaque"
        )
        self._done = gl.GLLinePlotItem(
            pos=nothing, mode="lines", color=_rgba(colours.path_done), width=3.0, glOptions="opaque"
        )
        self._unsolved = gl.GLScatterPlotItem(
            pos=nothing, size=UNSOLVED_PX, color=_rgba(colours.path_unsolved), glOptions="opaque"
        )
        self._arm = gl.GLLinePlotItem(pos=nothing, color=_rgba(colours.arm), width=5.0, glOptions="opaque")
        self._joints = gl.GLScatterPlotItem(
            pos=nothing, size=JOINT_PX, color=_rgba(colours.joint), glOptions="opaque"
        )
        self._spray = gl.GLLinePlotItem(
            pos=nothing, color=_rgba(colours.spray), width=2.0, glOptions="opaque"
        )
        for item in (
            self._cloud,
            self._path,
            self._done,
            self._unsolved,
            self._arm,
            self._joints,
            self._spray,
        ):
            self.addItem(item)
        self.look(camera)

    def look(self, camera: Camera) -> None:
        """Take another camera."""
        self.opts["fov"] = camera.fov_deg
        self.setCameraPosition(
            pos=Vector(*camera.centre),
            distance=camera.distance,
            elevation=camera.elevation_deg,
            azimuth=camera.azimuth_deg,
        )

    def draw_scene(self, scene: Scene) -> None:
        """Take another scene."""
        self._scene = scene
        self._cloud.setData(pos=scene.points, color=self._table[scene.labels])
        self._path.setData(pos=scene.path[path_segments(scene)].reshape(-1, 3))
        self._unsolved.setData(pos=unsolved_points(scene))
        self._done.setData(pos=np.zeros((0, 3)))

    def draw_progress(self, point: int) -> None:
        """Mark the path as done up to a planned point; -1 for nothing."""
        segments = path_segments(self._scene)
        self._done.setData(pos=self._scene.path[segments[segments[:, 1] <= point]].reshape(-1, 3))

    def draw_arm(self, arm: ArmLine) -> None:
        """Put the arm where it is now."""
        self._arm.setData(pos=arm.chain)
        self._joints.setData(pos=arm.chain)
        if arm.spray is not None:
            self._spray.setData(pos=arm.spray, width=6.0 if arm.spraying else 2.0)
