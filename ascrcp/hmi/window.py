"""The main window: a frame that is the same on every page, and the pages. Snapshots in, requests out."""

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QColor, QKeyEvent, QKeySequence, QPainter, QPaintEvent, QShortcut
from PySide6.QtWidgets import QApplication, QHBoxLayout, QPushButton, QStackedWidget, QVBoxLayout, QWidget

from ascrcp.core.errors import RefusedError
from ascrcp.hmi.alarm_bar import AlarmBar
from ascrcp.hmi.alarms_page import AlarmsPage
from ascrcp.hmi.automatic_page import AutomaticPage
from ascrcp.hmi.chore import Chores
from ascrcp.hmi.command_rail import CommandRail
from ascrcp.hmi.contract import Session
from ascrcp.hmi.joints_page import JointsPage
from ascrcp.hmi.page import Page, PageStrip
from ascrcp.hmi.preparation import Preparation, Prepared
from ascrcp.hmi.semi_automatic_page import SemiAutomaticPage
from ascrcp.hmi.setup_page import SetupPage
from ascrcp.hmi.status_line import StatusLine
from ascrcp.hmi.status_panel import StatusPanel
from ascrcp.hmi.step_strip import StepStrip
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen, style_sections, style_sheet, with_theme
from ascrcp.hmi.wall_page import WallPage
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import STEPS, Mode, Step

STOP_KEYS = (Qt.Key.Key_Space, Qt.Key.Key_F12)
PRESS_KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


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
        self._session, self.screen_config = session, screen
        self._is_open = True
        self.language = language
        self.rail = CommandRail(screen)
        self.status = StatusPanel(screen)
        self.steps = StepStrip(session.refusal)
        self.automatic = AutomaticPage(session, screen)
        self.wall = WallPage(screen)
        self.joints_page = JointsPage(session, screen)
        self.alarms = AlarmsPage()
        self.semi = SemiAutomaticPage(session, screen)
        self.setup = SetupPage(session, screen)
        self.pages: tuple[Page, ...] = (
            self.automatic, self.wall, self.joints_page, self.alarms, self.semi, self.setup,
        )  # fmt: skip
        self.strip = PageStrip(tuple(page.key for page in self.pages))
        self.alarm = AlarmBar()
        self.line = StatusLine()
        self.panels = (self.rail, self.status, self.steps, self.strip, self.alarm, self.line)
        self.stack = QStackedWidget()
        for page in self.pages:
            self.stack.addWidget(page)
        self.preparation = Preparation(screen.view.points)
        self._version = 0
        self._chores = Chores(self)
        self._lay_out()
        self._connect()
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)  # or the first button would look chosen
        self.setFocus()
        self.setMinimumSize(screen.size.width, screen.size.height)
        for page in self.pages:
            page.set_language(language)
        self.set_language(language)
        self._chores.finish()
        self.show_page(self.automatic.key)
        self._timer = self._call_every(screen.refresh_ms, self.refresh)
        self._pulse = self._call_every(screen.stick_ms, self._keep_stick)

    def _call_every(self, period_ms: int, slot: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setTimerType(Qt.TimerType.PreciseTimer)
        timer.timeout.connect(slot)
        timer.start(period_ms)
        return timer

    @property
    def page(self) -> Page:
        """The page in front."""
        return self.pages[self.stack.currentIndex()]

    def refresh(self) -> None:
        """Draw the session's newest snapshot."""
        if not self._is_open:
            return
        snapshot = self._session.snapshot()
        self._draw(snapshot)
        scene = self._session.scene()
        if scene.version != self._version:
            self._version = scene.version
            for page in self.pages:
                page.show_scene(scene)
        ready = self.preparation.poll(scene)
        if ready is not None:
            self._take(ready)
        self.refreshed.emit(snapshot)

    def _keep_stick(self) -> None:
        """Send the stick more often than pictures are drawn: a hung screen is told in 100 ms (F29)."""
        if self._is_open:
            self.page.keep_stick()

    def draw_now(self) -> None:
        """Draw the newest snapshot without telling anybody: for pictures."""
        self._draw(self._session.snapshot())

    def settle(self) -> None:
        """Draw now what else comes in slices: for pictures and tests."""
        scene = self._session.scene()
        if scene.version != self._version:
            self._version = scene.version
            for page in self.pages:
                page.show_scene(scene)
        ready = self.preparation.wait(scene)
        if ready is not None:
            self._take(ready)
        self._chores.finish()
        self.automatic.scene.canvas.complete()

    def show_page(self, key: str) -> None:
        """Bring a page to the front."""
        page = next(page for page in self.pages if page.key == key)
        if page is not self.page:
            self.page.leave()
        if page.language is not self.language:
            page.set_language(self.language)
        self.stack.setCurrentWidget(page)
        self.strip.show_front(key)

    def set_language(self, language: Language) -> None:
        """Write in another language, piece by piece: what is in front first."""
        self.language = language
        self.setWindowTitle(say("window", language))
        self._chores.add(partial(panel.set_language, language) for panel in (*self.panels, self.page))
        self._chores.add((self.draw_now,))
        self._chores.add(partial(self._translate, page) for page in self.pages)

    def _translate(self, page: Page) -> None:
        if page.language is not self.language:
            page.set_language(self.language)

    def set_theme(self, screen: Screen) -> None:
        """Take another look, section by section: what is in front first."""
        self.screen_config = screen
        sheet = style_sheet(screen)
        others = (page for page in self.pages if page is not self.page)
        for panel in (*self.panels, self.page, *others):
            self._chores.add(partial(section.setStyleSheet, sheet) for section in self._sections[panel])
            self._chores.add((partial(panel.set_theme, screen),))
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Paint what is behind the panels."""
        QPainter(self).fillRect(event.rect(), QColor(self.screen_config.look.colours.background))

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Let Enter press the button that has the keyboard's focus."""
        focused = QApplication.focusWidget()
        if event.key() in PRESS_KEYS and isinstance(focused, QPushButton):
            focused.click()
            return
        super().keyPressEvent(event)

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
        self._pulse.stop()
        self._chores.drop()
        self._stop_motion()
        self._session.close()
        self.preparation.close()
        self.joints_page.trend.close_loading()
        self.automatic.scene.canvas.painter.close()
        self.closed.emit()

    def _draw(self, snapshot: Snapshot) -> None:
        self.rail.show_snapshot(snapshot)
        self.status.show_snapshot(snapshot)
        self.steps.show_snapshot(snapshot)
        self.strip.show_snapshot(snapshot)
        self.alarm.show_snapshot(snapshot)
        self.line.show_snapshot(snapshot)
        for page in self.pages:
            page.note_snapshot(snapshot)
        self.page.show_snapshot(snapshot)

    def _take(self, prepared: Prepared) -> None:
        self._chores.add((partial(self.automatic.draw, prepared), partial(self.wall.draw, prepared)))

    def _lay_out(self) -> None:
        left = QVBoxLayout()
        left.setSpacing(6)
        left.addWidget(self.status)
        left.addWidget(self.steps)
        left.addWidget(self.strip)
        left.addWidget(self.stack, 1)
        left.addWidget(self.alarm)
        left.addWidget(self.line)
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 8, 8, 6)
        row.setSpacing(10)
        row.addLayout(left, 1)
        row.addWidget(self.rail)
        sheet = style_sheet(self.screen_config)
        self._sections = {panel: style_sections(panel) for panel in (*self.panels, *self.pages)}
        for sections in self._sections.values():
            for section in sections:
                section.setStyleSheet(sheet)  # costs nothing before they are shown

    def _connect(self) -> None:
        session, rail = self._session, self.rail
        rail.stop.connect(session.stop)
        rail.reset.connect(session.reset)
        rail.cancel.connect(session.cancel)
        rail.language_switched.connect(lambda: self.set_language(self.language.other))
        rail.theme_switched.connect(self._switch_theme)
        rail.quit_asked.connect(self._stop_motion)
        rail.quit_confirmed.connect(self.close)
        self.status.mode_chosen.connect(session.choose_mode)
        self.steps.pressed.connect(self._start)
        self.strip.chosen.connect(self.show_page)
        for key in STOP_KEYS:
            self._bind(key, session.stop)
        for number, page in enumerate(self.pages):
            self._bind(Qt.Key(Qt.Key.Key_F1 + number), partial(self.show_page, page.key))
        for number, step in enumerate(STEPS):
            button = self.steps.buttons[step]
            self._bind(QKeySequence(f"Alt+{number + 1}"), button.click)
        for letter, button in (
            ("R", rail.reset_button), ("L", rail.language_button), ("T", rail.theme_button),
            ("C", rail.cancel_button), ("Q", rail.quit_button), ("A", self.status.modes[Mode.AUTOMATIC]),
            ("S", self.status.modes[Mode.SEMI_AUTOMATIC]),
        ):  # fmt: skip
            self._bind(QKeySequence(f"Alt+{letter}"), button.click)

    def _bind(self, key: Qt.Key | QKeySequence, press: Callable[[], object]) -> None:
        shortcut = QShortcut(QKeySequence(key), self)
        shortcut.setContext(Qt.ShortcutContext.ApplicationShortcut)
        shortcut.setAutoRepeat(False)
        shortcut.activated.connect(press)

    def _switch_theme(self) -> None:
        self.set_theme(with_theme(self.screen_config, self.screen_config.other_theme))

    def _stop_motion(self) -> None:
        job = self._session.snapshot().job
        if job.active is not None or job.jogging:
            self._session.stop()

    def _start(self, step: Step) -> None:
        try:
            self._session.start(step)
        except RefusedError as error:  # the state changed between drawing and pressing
            reason = self._session.refusal(step)
            self.alarm.show_refusal((str(error), str(error)) if reason is None else reason.value)
            self.refused.emit(str(error))
        self.refresh()
