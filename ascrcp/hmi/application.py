"""Run the screen on a session: the Qt application with its window, by hand or by the autopilot."""

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QApplication

from ascrcp.core.ending import Ending
from ascrcp.core.errors import InputError
from ascrcp.hmi.autopilot import Autopilot
from ascrcp.hmi.contract import Session
from ascrcp.hmi.gallery import Gallery
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen, apply_theme, load_screen
from ascrcp.hmi.window import Window

NO_FONT = "no Chinese font is installed (Debian: fonts-wqy-microhei): the screen starts in English"


def tell_stderr(line: str) -> None:
    """Write one line of progress for a person."""
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def has_display() -> bool:
    """Return whether a display is there to open a window on."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def make_application() -> QApplication:
    """Return the Qt application, on the offscreen platform where there is no display."""
    running = QApplication.instance()
    if isinstance(running, QApplication):
        return running
    if not has_display():
        os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    # the cloud draws in a context of its own and hands its picture over
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_ShareOpenGLContexts)
    application = QApplication(["ascrcp"])
    application.setQuitOnLastWindowClosed(False)  # `run` quits when the session has ended, and only then
    return application


def choose_language(screen: Screen, has_chinese: bool) -> Language:
    """Return the configured language, English where Chinese cannot be shown."""
    return Language.ZH if screen.language == "zh" and has_chinese else Language.EN


def run(
    session: Session,
    *,
    offscreen: bool,
    pictures: Path | None,
    auto: bool,
    tell: Callable[[str], None] = tell_stderr,
    screen: Screen | None = None,
    gallery: bool = False,
    resprays: int | None = None,
    ending: Ending | None = None,
) -> int:
    """Show the window until it is closed; the session is closed with it.

    Args:
        session: The job.
        offscreen: No person is watching: no full screen; without a display Qt draws off screen.
        pictures: Folder the autopilot writes PNG files to, None for none.
        auto: Let the autopilot press through the whole automatic job, then close.
        tell: Takes lines of progress: each step begun, failures, the outcome.
        screen: Configuration; None reads config/screen.yaml.
        gallery: Take the pictures of every page in both languages and themes.
        resprays: So many further sprayings the autopilot makes at most; None: it does not scan again.
        ending: Tells when a signal asks to end: the motion is stopped, then the window closes.

    Returns:
        0, or 1 if the autopilot's job or the screen itself failed, or a signal ended it.

    Raises:
        InputError: The folder for pictures cannot be made; the session is closed.
    """
    _make_folder(pictures, session)
    screen = screen or load_screen()
    application = make_application()
    has_chinese = apply_theme(application, screen)
    if not has_chinese:
        tell(NO_FONT)
    window = Window(session, screen, choose_language(screen, has_chinese))
    outcome = [0]

    def end(is_ok: bool) -> None:
        outcome[0] = 0 if is_ok else 1
        window.close()

    def look(snapshot: object) -> None:
        if ending is not None and ending.is_asked:
            end(False)

    window.closed.connect(application.quit)
    window.refreshed.connect(look)
    if auto:
        camera = None if pictures is None else Gallery(window, session, pictures, is_whole=gallery)
        Autopilot(window, screen, tell, camera, resprays).finished.connect(end)
    if offscreen or auto:
        window.resize(screen.size.width, screen.size.height)
        window.show()
    else:
        window.showMaximized()
    if not auto:
        window.joints_page.trend.make_soon()
    with _failures_end(tell, end):
        application.exec()
    window.shut_down()
    window.deleteLater()
    return outcome[0]


def _make_folder(folder: Path | None, session: Session) -> None:
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        session.close()
        raise InputError(f"{folder}: no folder for pictures can be made: {error.strerror or error}") from None


@contextmanager
def _failures_end(tell: Callable[[str], None], end: Callable[[bool], None]) -> Iterator[None]:
    """Let an exception in a slot stop the job and close the window instead of leaving it half alive."""
    before = sys.excepthook

    def fail(kind: type[BaseException], error: BaseException, where: TracebackType | None) -> None:
        if not issubclass(kind, KeyboardInterrupt):
            tell("".join(traceback.format_exception(kind, error, where)).rstrip())
        tell(f"the screen failed: {kind.__name__} {error}")
        end(False)

    sys.excepthook = fail
    try:
        yield
    finally:
        sys.excepthook = before
