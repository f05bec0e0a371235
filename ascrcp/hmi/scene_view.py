"""The 3-D view with its buttons, legend and warnings."""

import math

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QPushButton, QSizePolicy, QVBoxLayout

from ascrcp.hmi import quantity
from ascrcp.hmi.camera import Camera, first_camera, named_cameras
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.preparation import Prepared
from ascrcp.hmi.scene_canvas import SceneCanvas
from ascrcp.hmi.scene_part import arm_line
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, colour_fields
from ascrcp.kinematics import Arm
from ascrcp.session.snapshot import Scene, Snapshot
from ascrcp.session.state import Step

LEGEND = ("bay", "sprayed", "arch", "overbreak", "path", "path_done", "path_unsolved", "arm")
LEGEND_PX = 40
"""Two lines [px]."""
GLIDE = 0.25
"""Share of the turn still to do that is done in one refresh: a press turns smoothly."""
SETTLED_DEG = 0.3


class SceneView(Panel):
    """Cloud, path and arm, turned by buttons; no drag, no wheel needed."""

    def __init__(self, screen: Screen, arm: Arm) -> None:
        super().__init__()
        self._screen, self._arm = screen, arm
        self._cameras = named_cameras(screen.view)
        self._view = next(iter(self._cameras))
        self._scene, self._has_cloud = Scene(), False
        self._point, self._pass, self._is_running, self._turn_left = -1, -1, False, 0.0
        self._pose: tuple[tuple[float, ...], bool] = ((), False)
        self.canvas = SceneCanvas(screen, first_camera(screen.view))
        self.canvas.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.canvas.setMinimumSize(200, 150)
        self.warning = make_label("warning", wrap=True)
        self.note = make_label("small", wrap=True)
        self.buttons: dict[str, QPushButton] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(4, 4, 4, 4)
        grid.setSpacing(4)
        over = QVBoxLayout(self.canvas)
        over.addWidget(self.warning)
        over.addWidget(self.note)
        over.addStretch()
        self.legend = QLabel()
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.legend.setProperty("role", "small")
        self.legend.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.legend.setWordWrap(True)
        self.legend.setFixedHeight(LEGEND_PX)
        grid.addWidget(self.canvas, 0, 0)
        grid.addWidget(self.legend, 1, 0)
        grid.addLayout(self._make_buttons(), 0, 1, 2, 1)
        grid.setColumnStretch(0, 1)
        grid.setRowStretch(0, 1)

    def _make_buttons(self) -> QVBoxLayout:
        column = QVBoxLayout()
        column.setSpacing(4)
        turn, zoom = self._screen.view.turn_deg, self._screen.view.zoom
        for key, press in (
            ("nearer", lambda: self._look(self.canvas.camera.approach(zoom))),
            ("farther", lambda: self._look(self.canvas.camera.approach(1 / zoom))),
            ("turn_left", lambda: self._turn(-turn)),
            ("turn_right", lambda: self._turn(turn)),
            ("view_next", self._next_view),
        ):
            button = make_button("view", name=key)
            button.setFixedWidth(84)
            button.setAutoRepeat(key != "view_next")
            button.clicked.connect(lambda _=False, press=press: press())
            column.addWidget(button)
            self.buttons[key] = button
        column.addStretch()
        return column

    def set_language(self, language: Language) -> None:
        """Write buttons and legend in a language."""
        super().set_language(language)
        for key, button in self.buttons.items():
            button.setText(say(key, language).format(name=say(self._view, language)))
        self._write_legend()
        set_text(self.note, "" if self._has_cloud else say("no_cloud", language))

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen = screen
        self.canvas.set_theme(screen)
        self._write_legend()

    def _write_legend(self) -> None:
        colours = colour_fields(self._screen.look.scene)
        entries = [(colours[key], say(key, self.language).replace(" ", "&nbsp;")) for key in LEGEND]
        self.legend.setText(
            " &nbsp; ".join(f'<span style="color:{c}">■</span>&nbsp;{text}' for c, text in entries)
        )

    def note_progress(self, snapshot: Snapshot) -> None:
        """Keep what is done marked, between points and after the run, until the next run or path."""
        is_running, passes = snapshot.job.active is Step.RUN, self._scene.path_pass
        begins = is_running and not self._is_running
        self._is_running = is_running
        reached, now = -1 if begins else self._point, self._pass if is_running else -1
        if is_running:
            reached = max(reached, snapshot.point)
            now = int(passes[snapshot.point]) if 0 <= snapshot.point < len(passes) else now
        if (reached, now) != (self._point, self._pass):
            self._point, self._pass = reached, now
            self.canvas.draw_progress(reached, now)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Move the arm, if it moved, say how near it is planned to come, and let the view fill up."""
        pose = (snapshot.q, snapshot.spraying)
        if pose != self._pose and snapshot.q:
            self._pose = pose
            q = np.asarray(snapshot.q)
            if np.isfinite(q).all():
                self.canvas.draw_arm(arm_line(np.asarray(self._arm.frames(q)), snapshot.spraying))
        self._warn(snapshot)
        if abs(self._turn_left) > SETTLED_DEG:
            part = self._turn_left * GLIDE
            self._turn_left -= part
            self._look(self.canvas.camera.turn(part))
        self.canvas.advance()

    def show_ghost(self, q: tuple[float, ...] | None, spraying: bool = False) -> None:
        """Draw the dry run's arm; None for none."""
        frames = None if q is None else np.asarray(self._arm.frames(np.asarray(q)))
        self.canvas.draw_ghost(None if frames is None else arm_line(frames, spraying))

    def draw(self, prepared: Prepared) -> None:
        """Draw cloud and path anew; of another path nothing is done."""
        if not np.array_equal(self._scene.path, prepared.scene.path):
            self._point = self._pass = -1
        self._scene = prepared.scene
        self._has_cloud = len(prepared.points) > 0
        set_text(self.note, "" if self._has_cloud else say("no_cloud", self.language))
        self.canvas.draw_scene(prepared)
        self.canvas.draw_progress(self._point, self._pass)

    def _warn(self, snapshot: Snapshot) -> None:
        known, point = self._scene.clearance, snapshot.point
        distance = float(known[point]) if 0 <= point < len(known) else math.nan
        is_near = distance < self._screen.clearance_warn_m  # NaN is not
        if is_near:
            value = quantity.CLEARANCE.show(distance)
            set_text(self.warning, say("clearance_low", self.language).format(value=value))
        if self.warning.isHidden() == is_near:
            self.warning.setVisible(is_near)

    def _turn(self, angle_deg: float) -> None:
        self._turn_left += angle_deg

    def _look(self, camera: Camera) -> None:
        self.canvas.look(camera)

    def _next_view(self) -> None:
        names = list(self._cameras)
        self._view = names[(names.index(self._view) + 1) % len(names)]
        self._turn_left = 0.0
        self._look(self._cameras[self._view])
        self.set_language(self.language)
