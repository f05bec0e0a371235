"""The main window: snapshots of the session in, presses on buttons out."""

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from ascrcp.core.errors import RefusedError
from ascrcp.hmi.alarm_panel import AlarmPanel
from ascrcp.hmi.command_rail import CommandRail
from ascrcp.hmi.contract import Session
from ascrcp.hmi.joint_table import JointTable
from ascrcp.hmi.nozzle_panel import NozzlePanel
from ascrcp.hmi.scene_view import SceneView
from ascrcp.hmi.status_line import StatusLine
from ascrcp.hmi.status_panel import StatusPanel
from ascrcp.hmi.step_strip import StepStrip
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Step

STOP_KEYS = (Qt.Key.Key_Space, Qt.Key.Key_F12)


class Window(QWidget):
    """The one window. It never waits for the session and opens no dialog.

    Signals:
        refreshed: After every snapshot drawn, with the snapshot.
        refused: A step the session refused, with the reason.
        closed: Once, when timer and session have ended.
    """

    refreshed = Signal(object)
    refused = Signal(str)
    closed = Signal()

    def __init__(self, session: Session, screen: Screen, language: Language) -> None:
        super().__init__()
        self._session = session
        self._is_open = True
        self.language = language
        self.rail = CommandRail(screen)
        self.status = StatusPanel()
        self.steps = StepStrip(session.refusal)
        self.scene = SceneView(screen, session.arm)
        self.joints = JointTable(session.arm.joints, screen.stale_ms)
        self.nozzle = NozzlePanel()
        self.alarm = AlarmPanel()
        self.line = StatusLine()
        self.panels = (self.rail, self.status, self.steps, self.scene, self.nozzle, self.alarm, self.line)
        self._lay_out()
        self._connect()
        self.setMinimumSize(screen.size.width, screen.size.height)
        self.set_language(language)
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self.refresh)
        self._timer.start(screen.refresh_ms)

    def refresh(self) -> None:
        """Draw the session's newest snapshot."""
        if not self._is_open:
            return
        snapshot = self._session.snapshot()
        self._draw(snapshot)
        self.scene.show_scene(self._session.scene())
        self.refreshed.emit(snapshot)

    def set_language(self, language: Language) -> None:
        """Write everything in a language, at once."""
        self.language = language
        self.setWindowTitle(say("window", language))
        for panel in self.panels:
            panel.set_language(language)
        self.joints.joint_model.set_language(language)
        self._draw(self._session.snapshot())

    def closeEvent(self, event: QCloseEvent) -> None:  # noqa: N802
        """Stop a step under way, end timer and session, then let the window go."""
        self.shut_down()
        event.accept()

    def shut_down(self) -> None:
        """Stop, end the timer, close the session; a second call does nothing."""
        if not self._is_open:
            return
        self._is_open = False
        self._timer.stop()
        self._stop_motion()
        self._session.close()
        self.closed.emit()

    def _draw(self, snapshot: Snapshot) -> None:
        self.rail.show_snapshot(snapshot)
        self.status.show_snapshot(snapshot)
        self.steps.show_snapshot(snapshot)
        self.scene.show_snapshot(snapshot)
        self.joints.joint_model.show_snapshot(snapshot)
        self.nozzle.show_snapshot(snapshot)
        self.alarm.show_snapshot(snapshot)
        self.line.show_snapshot(snapshot)

    def _lay_out(self) -> None:
        right = QVBoxLayout()
        right.setSpacing(8)
        right.addWidget(self.joints)
        right.addWidget(self.nozzle, 1)
        middle = QHBoxLayout()
        middle.setSpacing(8)
        middle.addWidget(self.scene, 8)
        middle.addLayout(right, 7)
        left = QVBoxLayout()
        left.setSpacing(6)
        left.addWidget(self.status)
        left.addWidget(self.steps)
        left.addLayout(middle, 1)
        left.addWidget(self.alarm)
        left.addWidget(self.line)
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 8, 8, 6)
        row.setSpacing(10)
        row.addLayout(left, 1)
        row.addWidget(self.rail)

    def _connect(self) -> None:
        session, rail = self._session, self.rail
        rail.stop.connect(session.stop)
        rail.reset.connect(session.reset)
        rail.cancel.connect(session.cancel)
        rail.language_switched.connect(lambda: self.set_language(self.language.other))
        rail.quit_asked.connect(self._stop_motion)
        rail.quit_confirmed.connect(self.close)
        self.status.mode_chosen.connect(session.choose_mode)
        self.steps.pressed.connect(self._start)
        for key in STOP_KEYS:
            shortcut = QShortcut(QKeySequence(key), self)
            shortcut.setContext(Qt.ShortcutContext.ApplicationShortcut)
            shortcut.setAutoRepeat(False)
            shortcut.activated.connect(session.stop)

    def _stop_motion(self) -> None:
        if self._session.snapshot().job.active is not None:
            self._session.stop()

    def _start(self, step: Step) -> None:
        try:
            self._session.start(step)
        except RefusedError as error:  # the state changed between drawing and pressing
            reason = self._session.refusal(step)
            self.alarm.show_refusal((str(error), str(error)) if reason is None else reason.value)
            self.refused.emit(str(error))
        self.refresh()
