"""What the operator was told: lines in both languages, numbered, from any thread."""

import threading

from ascrcp.session.snapshot import Announcement

KEPT = 50
"""Lines the screen may still show."""


class Notices:
    """The last lines; control and worker thread may speak at once."""

    def __init__(self) -> None:
        self._telling = threading.Lock()
        self.lines: tuple[Announcement, ...] = ()

    def add(self, english: str, chinese: str, failure: bool) -> None:
        """Add one line."""
        with self._telling:
            number = self.lines[-1].number + 1 if self.lines else 1
            self.lines = (*self.lines, Announcement(number, (english, chinese), failure))[-KEPT:]
