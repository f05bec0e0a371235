"""Eight hours of the screen on the simulated rig in virtual time: does memory stay flat?

    python -m ascrcp.hmi.soak --round DIR [--hours 8] [--rig FILE]

DIR is a solved round (joints.csv). The job is run again and again while the pages are looked through;
after every run memory is read. Exit code 0 if it did not grow by more than the limit after the first run.
"""

import argparse
import os
import resource
import sys
from pathlib import Path

from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication

from ascrcp.app import Options, open_session
from ascrcp.hmi.application import make_application
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import apply_theme, load_screen
from ascrcp.hmi.window import Window
from ascrcp.session.session import Session
from ascrcp.session.state import Step

GROWTH_MB = 60.0
"""What memory may grow by after the first run, which fills the caches; placeholder."""
JOB = (Step.ZERO, Step.LOAD, Step.GO_TO_START, Step.RUN)
PAGE_MS = 700
"""How long each page is looked at."""
TURN_MS = 100


def memory_mb() -> float:
    """Return the memory this process holds now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


class Soak:
    """Presses through the job again and again; pages, language and view change all the time."""

    def __init__(self, window: Window, session: Session, hours: float) -> None:
        self._window, self._session, self._hours = window, session, hours
        self._next = 0
        self._looked = 0
        self.memory: list[float] = []
        self._press_timer, self._page_timer = QTimer(window), QTimer(window)
        self._press_timer.timeout.connect(self.press)
        self._page_timer.timeout.connect(self.look)
        self._press_timer.start(TURN_MS)
        self._page_timer.start(PAGE_MS)

    def press(self) -> None:
        """Press what the job waits for."""
        snapshot = self._session.snapshot()
        if snapshot.job.stopped:
            self._window.rail.reset_button.click()
            return
        if snapshot.job.active is not None:
            return
        if self._next == len(JOB):
            self._next = 0
            self._note(snapshot.t_s)
            if snapshot.t_s >= 3600.0 * self._hours:
                self._window.close()
                return
        button = self._window.steps.buttons[JOB[self._next]]
        if button.isEnabled():
            self._next += 1
            button.click()

    def look(self) -> None:
        """Look at the next page; turn the view and change the language now and then."""
        self._looked += 1
        pages = self._window.pages
        self._window.show_page(pages[self._looked % len(pages)].key)
        self._window.automatic.scene.buttons["turn_right"].click()
        if self._looked % 20 == 0:
            self._window.rail.language_button.click()

    def _note(self, t_s: float) -> None:
        self.memory.append(memory_mb())
        sys.stdout.write(f"{t_s / 3600.0:6.2f} h of machine time, {self.memory[-1]:7.1f} MB\n")
        sys.stdout.flush()


def main() -> int:
    """Run the soak; return the exit code."""
    parser = argparse.ArgumentParser(description="The screen in virtual time for hours: is memory flat?")
    parser.add_argument("--round", type=Path, required=True, help="a solved round")
    parser.add_argument("--hours", type=float, default=8.0, help="of machine time (8)")
    parser.add_argument("--rig", type=Path, default=None, help="overlay of the rig's parameters")
    options = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    application = make_application()
    screen = load_screen()
    apply_theme(application, screen)
    session = open_session(Options(rig=options.rig), options.round, options.round.parent)
    window = Window(session, screen, Language.ZH)
    window.closed.connect(QApplication.quit)
    window.show()
    soak = Soak(window, session, options.hours)
    application.exec()
    grown = soak.memory[-1] - soak.memory[0] if len(soak.memory) > 1 else 0.0
    sys.stdout.write(f"grown by {grown:.1f} MB after the first of {len(soak.memory)} runs\n")
    return 0 if grown <= GROWTH_MB else 1


if __name__ == "__main__":
    sys.exit(main())
