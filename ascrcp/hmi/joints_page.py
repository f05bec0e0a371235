"""The joints page: every joint with limits and state, trends, and how machine and cycle are."""

from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout

from ascrcp.hmi import quantity
from ascrcp.hmi.contract import Session
from ascrcp.hmi.health_panel import HealthPanel
from ascrcp.hmi.joint_table import WIDE_COLUMNS, JointTable
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import make_button, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.trend import Curves, Recorder, TrendView
from ascrcp.session.snapshot import Snapshot

REDRAW = 5
"""Refreshes from one drawing of the trend to the next."""


HEALTH_PX = 332
"""Width of the right side: its longest row [px]."""


class JointsPage(Page):
    """Joint table and trend at the left, health at the right."""

    key = "joints"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
        self._joints = session.arm.joints
        self._chosen, self._count = 0, 0
        self._recorder = Recorder(screen.trend_s)
        self.table = JointTable(self._joints, screen.stale_ms, WIDE_COLUMNS)
        self.trend = TrendView(screen)
        self.health = HealthPanel()
        self.previous, self.next = (
            make_button("view", name="trend_previous"),
            make_button("view", name="trend_next"),
        )
        self.name = make_label("number", centred=True)
        keys = QHBoxLayout()
        keys.addWidget(self.previous, 2)
        keys.addWidget(self.name, 3)
        keys.addWidget(self.next, 2)
        left = QVBoxLayout()
        left.setSpacing(6)
        left.addWidget(self.table)
        left.addWidget(self.trend, 1)
        right = QVBoxLayout()
        right.setSpacing(6)
        right.addWidget(self.health, 1)
        right.addLayout(keys)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        row.addLayout(left, 1)
        row.addLayout(right)
        self.health.setFixedWidth(HEALTH_PX)
        self.previous.clicked.connect(lambda: self.choose(self._chosen - 1))
        self.next.clicked.connect(lambda: self.choose(self._chosen + 1))

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.table.joint_model.set_language(language)
        self.trend.set_language(language)
        self.health.set_language(language)
        self.previous.setText(say("trend_previous", language))
        self.next.setText(say("trend_next", language))
        self.choose(self._chosen)

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self.trend.set_theme(screen)

    def note_snapshot(self, snapshot: Snapshot) -> None:
        """Keep the trend without gaps."""
        self._recorder.note(snapshot)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw table and health in turns, the trend a few times a second."""
        self._count += 1
        if self._count % 2:
            self.table.joint_model.show_snapshot(snapshot)
        else:
            self.health.show_snapshot(snapshot)
        if self._count % REDRAW == 1:
            self.trend.draw(self._curves(snapshot.t_s))

    def choose(self, index: int) -> None:
        """Show the trend of a joint, counted from 0; the one after the last is the nozzle's error."""
        self._chosen = index % (len(self._joints) + 1)
        self._count = 0
        if self._chosen < len(self._joints):
            joint = self._joints[self._chosen]
            set_text(self.name, f"{joint.number} {(joint.name, joint.name_zh)[self.language]}")
        else:
            set_text(self.name, say("trend_tip_title", self.language))

    def _curves(self, now_s: float) -> Curves:
        if self._chosen == len(self._joints):
            unit = quantity.TIP_ERROR_MM
            return Curves(self.name.text(), unit, self._recorder.tip(), [], now_s)
        actual, target = self._recorder.joint(self._chosen)
        unit = quantity.LENGTH if self._joints[self._chosen].prismatic else quantity.ANGLE
        return Curves(self.name.text(), unit, actual, target, now_s)
