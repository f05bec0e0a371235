"""Chores: pieces of work put off so that no slot keeps the interpreter for long."""

import time
from collections import deque
from collections.abc import Callable, Iterable

from PySide6.QtCore import QObject, QTimer

EVERY_MS, SLOT_S = 1, 0.0015
"""A slot begins pieces for so long, so often: with its last piece it stays below 3 ms."""

Piece = Callable[[], object]


class Chores(QObject):
    """Does pieces in their order, some at a time; what comes from the cab is heard in between."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._pieces: deque[Piece] = deque()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self.work)

    def add(self, pieces: Iterable[Piece]) -> None:
        """Put pieces off."""
        self._pieces.extend(pieces)
        if self._pieces:
            self._timer.start(EVERY_MS)

    def work(self) -> None:
        """Do some of them."""
        end = time.perf_counter() + SLOT_S
        while self._pieces and time.perf_counter() < end:
            self._pieces.popleft()()
        if not self._pieces:
            self._timer.stop()

    def finish(self) -> None:
        """Do all of them here and now: for pictures and tests."""
        while self._pieces:
            self._pieces.popleft()()
        self._timer.stop()

    def drop(self) -> None:
        """Forget them."""
        self._pieces.clear()
        self._timer.stop()
