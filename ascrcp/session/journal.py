"""The event journal of a round: every step, fault and refusal in SQLite, committed one by one.

A write-ahead log loses no committed event when the process is killed (faults G9).
"""

import sqlite3
from pathlib import Path
from typing import NamedTuple

from ascrcp.core.errors import InputError

_SCHEMA = """
CREATE TABLE IF NOT EXISTS event (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    t_s REAL NOT NULL,
    kind TEXT NOT NULL,
    code TEXT NOT NULL,
    detail TEXT NOT NULL
)
"""


class Entry(NamedTuple):
    """One line of the journal: job time [s], kind (step, fault, request, note), code, detail."""

    t_s: float
    kind: str
    code: str
    detail: str


class Journal:
    """Append-only journal; used from one thread."""

    def __init__(self, path: Path) -> None:
        try:
            self._base = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
            self._base.execute("PRAGMA journal_mode=WAL")
            self._base.execute("PRAGMA synchronous=NORMAL")
            self._base.execute(_SCHEMA)
        except sqlite3.Error as error:
            raise InputError(f"{path}: cannot open the event journal: {error}") from None

    def append(self, entry: Entry) -> None:
        """Write one entry; it is committed when this returns."""
        self._base.execute("INSERT INTO event (t_s, kind, code, detail) VALUES (?, ?, ?, ?)", entry)

    def entries(self) -> list[Entry]:
        """Return every entry, oldest first."""
        rows = self._base.execute("SELECT t_s, kind, code, detail FROM event ORDER BY number")
        return [Entry(*row) for row in rows]

    def close(self) -> None:
        """Close the file."""
        self._base.close()
