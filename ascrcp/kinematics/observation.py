"""Measured tip positions for a calibration: CSV of joint readings and surveyed points -> Observations."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.sag import MAX_PAYLOAD_KG

MAX_BYTES = 10_000_000
"""A survey of a hundred thousand rows; a larger file is not one."""

POINT_COLUMNS = ("X/mm", "Y/mm", "Z/mm")
PAYLOAD_COLUMN = "payload_kg"
LABEL_COLUMN = "label"

MAX_DISTANCE = 50.0
"""No tip is farther from the base [m]: a larger number has the wrong unit."""

RANGE_MARGIN = 0.02
"""Share of its range by which a reading may stand outside it, as for the sensors (fault F6)."""

UNITS = {"deg": np.pi / 180.0, "mm": 1e-3}


@dataclass(frozen=True)
class Observations:
    """Tip positions measured from outside, with the joints as the platform showed them.

    Attributes:
        q: Joint vectors [rad, m], shape (n, joints).
        payload_kg: Concrete in the hose [kg], shape (n,).
        position: Tip in the base frame [m], shape (n, 3).
        line: Line of the file each row stood on, shape (n,).
        source: Where they came from, for messages.
    """

    q: Array
    payload_kg: Array
    position: Array
    line: NDArray[np.int64]
    source: str = ""

    LENGTH_RULE: ClassVar[str] = "q, payload_kg, position and line must have one row per observation"

    def __post_init__(self) -> None:
        n = len(self.q)
        if self.payload_kg.shape != (n,) or self.position.shape != (n, 3) or self.line.shape != (n,):
            raise InputError(self.LENGTH_RULE)
        for array in (self.q, self.payload_kg, self.position):
            if not np.isfinite(array).all():
                raise InputError("observations must be finite, but hold NaN or infinity")
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.q)

    def pick(self, rows: NDArray[np.bool_]) -> "Observations":
        """Return the rows marked, shape (n,)."""
        parts = (self.q[rows], self.payload_kg[rows], self.position[rows], self.line[rows])
        return Observations(*parts, source=self.source)


def list_columns(arm: Arm) -> tuple[str, ...]:
    """Name the columns a survey of this arm must have: joints as in joints.csv, payload, point."""
    joints = [f"q{joint.number}_{'mm' if joint.prismatic else 'deg'}" for joint in arm.joints]
    return (*joints, PAYLOAD_COLUMN, *POINT_COLUMNS)


def read_observations(file: Path, arm: Arm) -> Observations:
    """Read a survey; lines that begin with # and a column named label are left aside.

    Args:
        file: CSV file with a header, columns in any order.
        arm: The arm that was surveyed.

    Raises:
        InputError: Unreadable, a column missing, unknown or twice, text or NaN in place of a number,
            a reading outside the joint's range, an absurd payload or point; names the line.
    """
    rows = _read_rows(file)
    if not rows:
        raise InputError(f"{file}: empty, expected a header and rows")
    columns = list_columns(arm)
    header = [name.strip() for name in rows[0][1]]
    _check_header(file, header, columns)
    if len(rows) < 2:
        raise InputError(f"{file}: no rows below the header")
    places = [header.index(name) for name in columns]
    values = np.array([_read_numbers(file, line, cells, header, places) for line, cells in rows[1:]])
    units = np.array([UNITS[name.rpartition("_")[2]] for name in columns[: arm.n]])
    found = Observations(
        q=values[:, : arm.n] * units,
        payload_kg=values[:, arm.n].copy(),
        position=values[:, arm.n + 1 :] / 1e3,
        line=np.array([line for line, _ in rows[1:]], dtype=np.int64),
        source=str(file),
    )
    _check_plausible(file, arm, found)
    return found


def write_observations(file: Path, arm: Arm, found: Observations) -> None:
    """Write a survey as read_observations reads it.

    Raises:
        InputError: The file cannot be written.
    """
    columns = list_columns(arm)
    units = np.array([UNITS[name.rpartition("_")[2]] for name in columns[: arm.n]])
    table = np.column_stack([found.q / units, found.payload_kg, found.position * 1e3])
    lines = [",".join(columns), *(",".join(f"{x:.4f}" for x in row) for row in table.tolist())]
    try:
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror or error}") from None


def _read_rows(file: Path) -> list[tuple[int, list[str]]]:
    """Return the lines that hold something, with their numbers; a byte order mark does not count."""
    try:
        if file.stat().st_size > MAX_BYTES:
            raise InputError(f"{file}: larger than {MAX_BYTES} bytes")
        text = file.read_text(encoding="utf-8-sig")
        return [
            (number, row)
            for number, row in enumerate(csv.reader(text.splitlines()), start=1)
            if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")
        ]
    except OSError as error:
        raise InputError(f"{file}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise InputError(f"{file}: not UTF-8 text") from None
    except csv.Error as error:
        raise InputError(f"{file}: not CSV: {error}") from None


def _check_header(file: Path, header: list[str], columns: tuple[str, ...]) -> None:
    missing = [name for name in columns if name not in header]
    if missing:
        raise InputError(f"{file}: column {missing[0]} is missing; needed are {','.join(columns)}")
    for name in header:
        if name not in columns and name != LABEL_COLUMN:
            raise InputError(
                f"{file}: unknown column {name!r}; allowed are {','.join(columns)},{LABEL_COLUMN}"
            )
        if header.count(name) > 1:
            raise InputError(f"{file}: column {name} stands twice")


def _read_numbers(
    file: Path, line: int, cells: list[str], header: list[str], places: list[int]
) -> list[float]:
    if len(cells) != len(header):
        raise InputError(f"{file}: line {line}: {len(cells)} cells, the header has {len(header)}")
    numbers = []
    for place in places:
        try:
            value = float(cells[place])
        except ValueError:
            raise InputError(
                f"{file}: line {line}: {header[place]} is {cells[place].strip()!r}, a number is needed"
            ) from None
        if not abs(value) < float("inf"):
            raise InputError(f"{file}: line {line}: {header[place]} is {value}, a finite number is needed")
        numbers.append(value)
    return numbers


def _check_plausible(file: Path, arm: Arm, found: Observations) -> None:
    """Refuse what only a wrong unit or column explains."""
    g = found.q @ arm.limit_matrix.T
    margin = RANGE_MARGIN * (arm.limit_upper - arm.limit_lower)
    outside = ~((g >= arm.limit_lower - margin) & (g <= arm.limit_upper + margin))
    for row, i in np.argwhere(outside)[:1]:
        joint = arm.joints[i]
        unit, name = (1e3, "mm") if joint.prismatic else (180.0 / np.pi, "deg")
        what = "+".join(f"q{k}" for k in joint.limit_sum)
        raise InputError(
            f"{file}: line {found.line[row]}: {what} is {g[row, i] * unit:.1f} {name}, "
            f"allowed {joint.lower * unit:g}..{joint.upper * unit:g} (joint {joint.number} {joint.name})"
        )
    for row in np.flatnonzero(~((found.payload_kg >= 0.0) & (found.payload_kg <= MAX_PAYLOAD_KG)))[:1]:
        raise InputError(
            f"{file}: line {found.line[row]}: {PAYLOAD_COLUMN} is {found.payload_kg[row]:g}, "
            f"allowed 0..{MAX_PAYLOAD_KG:g}"
        )
    for row in np.flatnonzero(~(np.abs(found.position) <= MAX_DISTANCE).all(axis=1))[:1]:
        x, y, z = found.position[row] * 1e3
        raise InputError(
            f"{file}: line {found.line[row]}: point {x:g}, {y:g}, {z:g} mm, "
            f"allowed up to {MAX_DISTANCE * 1e3:g} mm from the base"
        )
