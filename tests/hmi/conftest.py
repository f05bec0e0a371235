"""Fixtures of the screen's tests: the real window on a rehearsed session."""

from collections.abc import Callable, Iterator

import pytest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from rehearsal import Rehearsal

from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen, apply_theme, load_screen
from ascrcp.hmi.window import Window


@pytest.fixture(scope="session", autouse=True)
def no_late_quit(qapp: QApplication) -> None:
    """Closing the last window of a test must not quit: Qt then runs no event loop any more."""
    qapp.setQuitOnLastWindowClosed(False)


@pytest.fixture(scope="session")
def screen() -> Screen:
    return load_screen()


@pytest.fixture
def open_window(qtbot: QtBot, screen: Screen) -> Iterator[Callable[..., Window]]:
    """Open windows that refresh only when a test says so, and close them afterwards."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    apply_theme(application, screen)
    windows = []

    def make(session: Rehearsal, language: Language = Language.EN) -> Window:
        window = Window(session, screen, language)
        window._timer.stop()
        windows.append(window)
        with qtbot.waitActive(window):
            window.show()
            window.activateWindow()
        window.refresh()
        return window

    yield make
    for window in windows:
        window.close()
        window.deleteLater()
