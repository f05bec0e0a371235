"""Pictures of every page in both languages and themes: for documents and for whoever checks the screen."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PySide6.QtWidgets import QApplication

from ascrcp.core.errors import DeviceError
from ascrcp.hmi.contract import Session
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import ThemeName, with_theme
from ascrcp.hmi.window import Window
from ascrcp.session.state import Mode

THEMES: tuple[ThemeName, ...] = ("night", "day")
SETTLE = 6
"""Refreshes before a picture: some panels draw in turns."""
PATIENCE_S = 5.0
DRY_RUN_SHARE = 0.4


class Gallery:
    """Photographs a window; leaves it as it was."""

    def __init__(self, window: Window, session: Session, folder: Path, *, is_whole: bool) -> None:
        """Args: is_whole: every page, language and theme; else only what is in front."""
        self._window, self._session, self._folder, self._is_whole = window, session, folder, is_whole

    def photograph(self, name: str) -> None:
        """Take a state's pictures: NAME.png of what is in front, NAME_page_language_theme.png of the rest.

        Raises:
            DeviceError: The disk refuses.
        """
        self._save(f"{name}.png")
        if not self._is_whole:
            return
        with self._kept():
            for theme in THEMES:
                self._window.set_theme(with_theme(self._window.screen_config, theme))
                for language in Language:
                    self._window.set_language(language)
                    for page in self._window.pages:
                        self._window.show_page(page.key)
                        self._save(f"{name}_{page.key}_{language.code}_{theme}.png")

    def photograph_extra(self) -> None:
        """Take what the job itself does not come by: commissioning, dry run, semi-automatic, stop, e-stop."""
        if not self._is_whole:
            return
        window, session = self._window, self._session
        with self._kept():
            self._each("setup", self._commissioning)
            window.show_page("automatic")
            self._each("dry_run", self._dry_run)
            window.automatic.playback.end()
            session.choose_mode(Mode.SEMI_AUTOMATIC)
            window.show_page("semi")
            self._each("semi_automatic", lambda name: self._save(f"{name}.png"))
            session.choose_mode(Mode.AUTOMATIC)
            window.show_page("automatic")
            session.stop()
            self._wait(lambda: session.snapshot().job.stopped)
            self._each("stopped", lambda name: self._save(f"{name}.png"))
            if session.site is not None:
                session.site.press_estop()
                session.stop()  # lets virtual time go on, so that the mirror is heard
                self._wait(lambda: session.snapshot().estop)
                window.show_page("alarms")
                self._each("estop", lambda name: self._save(f"{name}.png"))
                session.site.release_estop()

    def _each(self, name: str, take: Callable[[str], None]) -> None:
        for theme in THEMES:
            self._window.set_theme(with_theme(self._window.screen_config, theme))
            for language in Language:
                self._window.set_language(language)
                take(f"{name}_{language.code}_{theme}")

    def _commissioning(self, name: str) -> None:
        setup = self._window.setup
        self._window.show_page("setup")
        setup.open()
        for key in setup.parts:
            setup.choose(key)
            self._save(f"{name}_{key.removeprefix('setup_')}.png")
        setup.lock()

    def _dry_run(self, name: str) -> None:
        slider = self._window.automatic.playback.slider
        self._window.refresh()
        slider.setValue(round(DRY_RUN_SHARE * slider.maximum()))
        self._save(f"{name}.png")

    @contextmanager
    def _kept(self) -> Iterator[None]:
        window = self._window
        language, config, page = window.language, window.screen_config, window.page.key
        try:
            yield
        finally:
            window.set_theme(config)
            window.set_language(language)
            window.show_page(page)

    def _wait(self, is_so: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not is_so() and time.monotonic() < end:
            QApplication.processEvents()
            time.sleep(0.01)

    def _save(self, name: str) -> None:
        window = self._window
        for _ in range(SETTLE if self._is_whole else 1):
            window.draw_now()
        window.settle()
        if not window.grab().save(str(self._folder / name)):
            raise DeviceError(f"{self._folder / name}: the picture cannot be written")
