"""The 3-D view with its buttons and legend: OpenGL where a context can be made, else drawn."""

from typing import Protocol

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QOpenGLContext
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from ascrcp.hmi.camera import Camera, first_camera, named_cameras
from ascrcp.hmi.drawn_view import DrawnView
from ascrcp.hmi.panel import Panel, make_button
from ascrcp.hmi.scene_part import ArmLine, arm_line
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, colour_fields
from ascrcp.kinematics import Arm
from ascrcp.session.snapshot import Scene, Snapshot
from ascrcp.session.state import Step

LEGEND = ("bay", "sprayed", "arch", "overbreak", "path", "path_done", "path_unsolved", "arm")

LEGEND_PX = 36
"""Two lines [px]."""


class Canvas(Protocol):
    """What both views can do."""

    def look(self, camera: Camera) -> None:
        """Take another camera."""

    def draw_scene(self, scene: Scene) -> None:
        """Take another scene."""

    def draw_progress(self, point: int) -> None:
        """Mark the path as done up to a planned point."""

    def draw_arm(self, arm: ArmLine) -> None:
        """Put the arm where it is now."""


def has_opengl() -> bool:
    """Return whether an OpenGL context really can be made; Qt's offscreen platform has none."""
    context = QOpenGLContext()
    return bool(context.create())


def _make_canvas(screen: Screen, camera: Camera) -> QWidget:
    if has_opengl():
        from ascrcp.hmi.gl_view import GlView  # loads libGL, absent on a bare machine

        return GlView(screen.scene_colours, screen.colours.void, camera)
    return DrawnView(screen.scene_colours, screen.colours.void, camera)


def thin_scene(scene: Scene, most: int) -> Scene:
    """Return a scene of at most so many points, evenly left out."""
    if len(scene.points) <= most:
        return scene
    keep = np.linspace(0, len(scene.points) - 1, most).astype(np.int64)
    return Scene(
        scene.version,
        scene.points[keep],
        scene.labels[keep],
        scene.path,
        scene.path_pass,
        scene.solved,
        scene.surface,
    )


class SceneView(Panel):
    """Cloud, path and arm, turned by buttons; no drag, no wheel needed."""

    def __init__(self, screen: Screen, arm: Arm) -> None:
        super().__init__()
        self._screen, self._arm = screen, arm
        self._cameras = named_cameras(screen.view)
        self._view = next(iter(self._cameras))
        self._camera = first_camera(screen.view)
        self._version, self._point, self._is_running = 0, -1, False
        self._pose: tuple[tuple[float, ...], bool] = ((), False)
        self.widget = _make_canvas(screen, self._camera)
        self.canvas: Canvas = self.widget  # type: ignore[assignment]
        self.widget.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.widget.setMinimumSize(200, 150)
        self.buttons: dict[str, QPushButton] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(4, 4, 4, 4)
        grid.setSpacing(4)
        column = QVBoxLayout()
        column.setSpacing(4)
        turn, zoom = screen.view.turn_deg, screen.view.zoom
        for key, press in (
            ("nearer", lambda: self._look(self._camera.approach(zoom))),
            ("farther", lambda: self._look(self._camera.approach(1 / zoom))),
            ("turn_left", lambda: self._look(self._camera.turn(-turn))),
            ("turn_right", lambda: self._look(self._camera.turn(turn))),
            ("view_next", self._next_view),
        ):
            button = make_button("view", name=key)
            button.setFixedWidth(screen.touch_px + 16)
            button.clicked.connect(lambda _=False, press=press: press())
            column.addWidget(button)
            self.buttons[key] = button
        column.addStretch()
        self.legend = QLabel()
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.legend.setProperty("role", "small")
        self.legend.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.legend.setWordWrap(True)
        self.legend.setFixedHeight(LEGEND_PX)
        grid.addWidget(self.widget, 0, 0)
        grid.addWidget(self.legend, 1, 0)
        grid.addLayout(column, 0, 1, 2, 1)
        grid.setColumnStretch(0, 1)
        grid.setRowStretch(0, 1)

    def set_language(self, language: Language) -> None:
        """Write buttons and legend in a language."""
        super().set_language(language)
        for key, button in self.buttons.items():
            button.setText(say(key, language).format(name=say(self._view, language)))
        colours = colour_fields(self._screen.scene_colours)
        entries = [(colours[key], say(key, language).replace(" ", "&nbsp;")) for key in LEGEND]
        self.legend.setText(
            " &nbsp; ".join(f'<span style="color:{c}">■</span>&nbsp;{text}' for c, text in entries)
        )

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Move the arm and the done part of the path, if they moved."""
        self._follow_path(snapshot)
        pose = (snapshot.q, snapshot.spraying)
        if pose != self._pose and snapshot.q:
            self._pose = pose
            q = np.asarray(snapshot.q)
            if np.isfinite(q).all():
                self.canvas.draw_arm(arm_line(np.asarray(self._arm.frames(q)), snapshot.spraying))

    def _follow_path(self, snapshot: Snapshot) -> None:
        """Keep what is done marked, between points and after the run, until the next run begins."""
        is_running = snapshot.job.active is Step.RUN
        begins = is_running and not self._is_running
        reached = max(-1 if begins else self._point, snapshot.point)
        self._is_running = is_running
        if reached != self._point:
            self._point = reached
            self.canvas.draw_progress(reached)

    def show_scene(self, scene: Scene) -> None:
        """Draw cloud and path anew, if they changed."""
        if scene.version != self._version:
            self._version = scene.version
            self.canvas.draw_scene(thin_scene(scene, self._screen.view.points))
            self.canvas.draw_progress(self._point)

    def _look(self, camera: Camera) -> None:
        self._camera = camera
        self.canvas.look(camera)

    def _next_view(self) -> None:
        names = list(self._cameras)
        self._view = names[(names.index(self._view) + 1) % len(names)]
        self._look(self._cameras[self._view])
        self.set_language(self.language)
