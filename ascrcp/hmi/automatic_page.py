"""The automatic page: a large 3-D scene, the nozzle and the dry run beside it (thesis 6.1.2)."""

from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout

from ascrcp.hmi.contract import Session
from ascrcp.hmi.nozzle_panel import NozzlePanel
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import make_label
from ascrcp.hmi.playback import PlaybackBar
from ascrcp.hmi.preparation import Prepared
from ascrcp.hmi.scene_view import SceneView
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.session.snapshot import Scene, Snapshot

SIDE_PX = 356
"""Width of what stands beside the scene: the nozzle's longest row [px]."""


class AutomaticPage(Page):
    """Watch the job: what is done, where the arm is, how far off."""

    key = "automatic"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
        self.scene = SceneView(screen, session.arm)
        self.playback = PlaybackBar(screen.refresh_ms)
        self.dry_note = make_label("warning", centred=True)
        self.dry_note.hide()
        self.nozzle = NozzlePanel()
        left, right = QVBoxLayout(), QVBoxLayout()
        left.setSpacing(6)
        left.addWidget(self.dry_note)
        left.addWidget(self.scene, 1)
        right.setSpacing(6)
        right.addWidget(self.nozzle, 1)
        right.addWidget(self.playback)
        self.nozzle.setFixedWidth(SIDE_PX)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        row.addLayout(left, 1)
        row.addLayout(right)
        self.playback.posed.connect(self._pose)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        for panel in (self.scene, self.playback, self.nozzle):
            panel.set_language(language)
        self.dry_note.setText(say("dry_run_note", language))

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self.scene.set_theme(screen)

    def note_snapshot(self, snapshot: Snapshot) -> None:
        """Follow the path even while another page is in front."""
        self.scene.note_progress(snapshot)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw arm and nozzle."""
        self.scene.show_snapshot(snapshot)
        self.playback.show_snapshot(snapshot)
        self.nozzle.show_snapshot(snapshot)

    def show_scene(self, scene: Scene) -> None:
        """Take the loaded sequence."""
        self.playback.show_scene(scene)

    def draw(self, prepared: Prepared) -> None:
        """Draw another cloud and path."""
        self.scene.draw(prepared)

    def leave(self) -> None:
        """End the dry run."""
        self.playback.end()

    def _pose(self, pose: tuple[tuple[float, ...], bool] | None) -> None:
        self.dry_note.setVisible(pose is not None)
        if pose is None:
            self.scene.show_ghost(None)
        else:
            self.scene.show_ghost(*pose)
