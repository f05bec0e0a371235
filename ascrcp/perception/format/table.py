"""Read tables of numbers: xyz, csv, txt; also the ASCII bodies of other formats."""

import csv
import warnings
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.perception.format.column import NO_SHIFT, Shift, pack

_COMMENTS = ("#", "//")
_LOOK = 65_536


def read_table(path: Path, shift: Shift = NO_SHIFT) -> NDArray[np.float32]:
    """Read x, y, z from the first three columns, or from those a heading line calls x, y, z.

    Separated by blanks, commas or semicolons; lines that begin with # or // are comments.

    Returns:
        Points, shape (n, 3).

    Raises:
        InputError: Naming the line that is not three numbers.
    """
    with path.open("rb") as file:
        start = file.read(_LOOK)
        if b"\x00" in start:
            raise InputError(f"{path}: not a text file")
        lines = start.decode("latin-1").splitlines()
        delimiter, columns, skip = _sniff(path, lines)
        file.seek(0)
        return parse_rows(file, path, delimiter, columns, None, skip, shift)


def parse_rows(
    file: BinaryIO,
    path: Path,
    delimiter: str | None,
    columns: tuple[int, int, int],
    count: int | None,
    skip: int = 0,
    shift: Shift = NO_SHIFT,
) -> NDArray[np.float32]:
    """Parse rows of numbers from where the file stands, `count` of them if given, less the shift.

    Raises:
        InputError: A row that is not numbers, or too few rows.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no rows at all: the caller says so
            rows = np.loadtxt(
                file,
                dtype=np.float32 if shift == NO_SHIFT else np.float64,
                comments=list(_COMMENTS),
                delimiter=delimiter,
                skiprows=skip,
                usecols=columns,
                max_rows=count,
                ndmin=2,
                encoding="latin-1",
            )
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split('.')[0].split())[:150]}") from None
    if count is not None and len(rows) < count:
        raise InputError(
            f"{path}: the header promises {count} points, the file holds {len(rows)}; cut short?"
        )
    rows = rows.reshape(-1, 3)
    return rows.astype(np.float32, copy=False) if shift == NO_SHIFT else pack(list(rows.T), shift)


def _sniff(path: Path, lines: list[str]) -> tuple[str | None, tuple[int, int, int], int]:
    """Delimiter, columns of x, y, z, and lines to skip before the first row of numbers."""
    for number, line in enumerate(lines):
        text = line.strip()
        if not text or text.startswith(_COMMENTS):
            continue
        delimiter = next((mark for mark in ",;\t" if mark in text), None)
        words = next(csv.reader([text], delimiter=delimiter)) if delimiter else text.split()
        words = [word.strip().lower() for word in words]
        if {"x", "y", "z"} <= set(words):
            return delimiter, (words.index("x"), words.index("y"), words.index("z")), number + 1
        if len(words) >= 3 and all(_is_number(word) for word in words[:3]):
            return delimiter, (0, 1, 2), number
        if number > 0 and len(words) == 1 and _is_number(words[0]):
            continue  # a count of points on a line of its own
        raise InputError(
            f"{path}: line {number + 1} is {text[:40]!r}; three numbers or a heading with x, y, z are needed"
        )
    raise InputError(f"{path}: holds no numbers")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
