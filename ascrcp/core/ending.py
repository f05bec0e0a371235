"""The wish to end, told by a signal: whoever runs the show looks for it and ends in order.

Raising in the middle of an import, of Qt or of a control cycle would leave threads and processes behind.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from ascrcp.core.errors import EndedError

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interrupted_by_terminate() -> Iterator[None]:
    """Let SIGTERM raise KeyboardInterrupt as SIGINT does: for commands that have no window."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class Ending:
    """While entered, the first signal is noted; the second does what it always did."""

    def __init__(self) -> None:
        self._asked: signal.Signals | None = None
        self._before: dict[signal.Signals, Any] = {}

    @property
    def is_asked(self) -> bool:
        """Whether we are to end."""
        return self._asked is not None

    def check(self) -> None:
        """Go on unless we are to end.

        Raises:
            EndedError: We are.
        """
        if self._asked is not None:
            raise EndedError(self._asked)

    def __enter__(self) -> Self:
        for number in SIGNALS:
            self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *failure: object) -> None:
        self._restore()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._asked = signal.Signals(number)
        self._restore()

    def _restore(self) -> None:
        while self._before:
            signal.signal(*self._before.popitem())
