"""Spray path and joint sequence as CSV (thesis table 4-1), sealed against damage (fault F40)."""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.json import encode
from numpy.typing import ArrayLike

from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import Array

VERSION = 2  # 2: pump flow
MAX_BYTES = 50_000_000  # faults.md, security: trajectories are capped at 50 MB
MAX_DIGITS = 9  # of a row count; more would not fit MAX_BYTES
PATH_KIND, JOINTS_KIND = "ascrcp spray path", "ascrcp joint sequence"
PATH_COLUMNS = (
    "序号", "X/mm", "Y/mm", "Z/mm", "theta3/deg", "theta2/deg",
    "station/m", "angle/deg", "bay", "pass", "kind", "speed/mm/s", "flow",
)  # fmt: skip
ROW_COLUMNS = ("point", "spraying", "flow", "X/mm", "Y/mm", "Z/mm", "dx", "dy", "dz")
KINDS = ("bay", "overbreak")


@dataclass(frozen=True)
class _Table:
    """A table as text cells.

    Attributes:
        note: What the rows have in common, on the second line.
        columns: Column names, without the seal.
        rows: Cells; the file's line number of rows[i] is FIRST_LINE + i.
    """

    note: str
    columns: tuple[str, ...]
    rows: list[list[str]]


FIRST_LINE = 4
"""Line of the first row: header, note and column names come before."""


def write_path(file: Path, path: SprayPath) -> None:
    """Write a planned path, one row per point in spraying order.

    Args:
        file: CSV file; replaced whole or not at all.
        path: Planned poses.

    Raises:
        InputError: The file cannot be written.
    """
    numbers = zip(
        range(1, len(path) + 1),
        *(path.position.T * 1e3).tolist(),
        np.degrees(path.theta3).tolist(),
        np.degrees(path.theta2).tolist(),
        path.station.tolist(),
        np.degrees(path.angle).tolist(),
        path.bay.tolist(),
        path.pass_index.tolist(),
        [KINDS[int(flag)] for flag in path.overbreak],
        (path.speed * 1e3).tolist(),
        path.flow.tolist(),
        strict=True,
    )
    note = "R_base_tunnel " + " ".join(repr(x) for x in path.R_base_tunnel.ravel().tolist())
    _write(file, PATH_KIND, note, PATH_COLUMNS, numbers)


def read_path(file: Path) -> SprayPath:
    """Read a planned path.

    Raises:
        InputError: Not such a file, cut, or changed; names the line. Nothing is loaded in part.
    """
    table = _read(file, PATH_KIND)
    if table.columns != PATH_COLUMNS:
        raise InputError(f"{file}: line 3: columns must be {','.join(PATH_COLUMNS)}")
    kind = PATH_COLUMNS.index("kind")
    for line, row in enumerate(table.rows, start=FIRST_LINE):
        if row[kind] not in KINDS:
            raise InputError(
                f"{file}: line {line}: kind must be one of {', '.join(KINDS)}, not {row[kind]!r}"
            )
    overbreak = np.array([row[kind] == KINDS[1] for row in table.rows], dtype=bool)
    cells = [row[:kind] + row[kind + 1 :] for row in table.rows]
    c = dict(
        zip(PATH_COLUMNS[:kind] + PATH_COLUMNS[kind + 1 :], _numbers(file, cells, len(PATH_COLUMNS) - 1).T)
    )
    rotation = _numbers(file, [table.note.split()[1:]], 9, line=2)
    return SprayPath(
        position=np.column_stack([c["X/mm"], c["Y/mm"], c["Z/mm"]]) / 1e3,
        theta2=np.radians(c["theta2/deg"]),
        theta3=np.radians(c["theta3/deg"]),
        station=c["station/m"],
        angle=np.radians(c["angle/deg"]),
        bay=c["bay"].astype(np.int64),
        pass_index=c["pass"].astype(np.int64),
        overbreak=overbreak,
        speed=c["speed/mm/s"] / 1e3,
        flow=c["flow"],
        R_base_tunnel=rotation.reshape(3, 3),
    )


def write_joints(file: Path, sequence: JointSequence, prismatic: ArrayLike) -> None:
    """Write a joint sequence, one row per instant; turning joints in degrees, sliding ones in mm.

    Args:
        file: CSV file; replaced whole or not at all.
        sequence: Joints against time.
        prismatic: Whether each joint slides, shape (joints,).

    Raises:
        InputError: The file cannot be written.
    """
    slides = np.asarray(prismatic, dtype=bool)
    units = np.where(slides, 1e3, np.degrees(1.0))
    columns = ("t_s", *_joint_columns(slides), *ROW_COLUMNS)
    numbers = zip(
        sequence.t.tolist(),
        *(sequence.q * units).T.tolist(),
        sequence.point.tolist(),
        sequence.spraying.astype(int).tolist(),
        sequence.flow.tolist(),
        *(sequence.position.T * 1e3).tolist(),
        *sequence.direction.T.tolist(),
        strict=True,
    )
    _write(file, JOINTS_KIND, f"joints {len(slides)}", columns, numbers)


def read_joints(file: Path) -> JointSequence:
    """Read a joint sequence.

    Raises:
        InputError: Not such a file, cut, or changed; names the line. Nothing is loaded in part.
    """
    table = _read(file, JOINTS_KIND)
    joints = len(table.columns) - 1 - len(ROW_COLUMNS)
    slides = np.array([name.endswith("_mm") for name in table.columns[1 : 1 + max(joints, 0)]], dtype=bool)
    if table.columns != ("t_s", *_joint_columns(slides), *ROW_COLUMNS) or joints < 1:
        raise InputError(f"{file}: line 3: columns are not those of a joint sequence")
    values = _numbers(file, table.rows, len(table.columns))
    units = np.where(slides, 1e3, np.degrees(1.0))
    row = dict(zip(ROW_COLUMNS, values[:, 1 + joints :].T, strict=True))
    return JointSequence(
        t=values[:, 0],
        q=values[:, 1 : 1 + joints] / units,
        position=np.column_stack([row["X/mm"], row["Y/mm"], row["Z/mm"]]) / 1e3,
        direction=np.column_stack([row["dx"], row["dy"], row["dz"]]),
        point=row["point"].astype(np.int64),
        spraying=row["spraying"] != 0.0,
        flow=row["flow"],
    )


def _joint_columns(slides: Array) -> list[str]:
    return [f"q{i}_{'mm' if slide else 'deg'}" for i, slide in enumerate(slides, start=1)]


def _write(
    file: Path, kind: str, note: str, columns: Sequence[str], rows: Iterable[tuple[float | int | str, ...]]
) -> None:
    """Write header, note, columns and rows; every line is sealed by the CRC32 of all text up to it.

    The running seal costs one column and lets a reader name the very line that is damaged.
    """
    body = [f"# {note}", ",".join(columns)]
    # the shortest digits that give the same bits back, as of repr(), five times as fast; words need no quotes
    body += [encode(row)[1:-1].decode().replace('"', "") for row in rows]
    seal, lines = 0, []
    for line in body:
        seal = zlib.crc32(line.encode(), seal)
        lines.append(f"{line},{seal:08x}")
    header = f"# {kind} version={VERSION} rows={len(body) - 2} crc32={seal:08x}"
    text = "\n".join([header, *lines]) + "\n"
    write_atomic(file, lambda stream: stream.write(text.encode()))


def _read(file: Path, kind: str) -> _Table:
    """Read and verify a whole file before any of it is used."""
    try:
        if file.stat().st_size > MAX_BYTES:
            raise InputError(f"{file}: larger than {MAX_BYTES} bytes")
        lines = file.read_bytes().decode("utf-8").split("\n")
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InputError(f"{file}: line {line}: not UTF-8 text") from None
    start = f"# {kind} version={VERSION} rows="
    head = lines[0][len(start) :].split(" crc32=")
    count = head[0]
    if not (lines[0].startswith(start) and len(head) == 2 and count.isascii() and count.isdigit()):
        raise InputError(
            f"{file}: line 1: not a file of this kind, expected '# {kind} version={VERSION} ...'"
            + (", of another version: make it again" if lines[0].startswith(f"# {kind} version=") else "")
        )
    seal, body = 0, []
    for number, sealed in enumerate(lines[1:-1], start=2):
        text, _, given = sealed.rpartition(",")
        seal = zlib.crc32(text.encode(), seal)
        if given != f"{seal:08x}":
            raise InputError(
                f"{file}: line {number}: damaged, its checksum is {seal:08x} but says {given[:8]!r}"
            )
        body.append(text)
    rows = int(count[:MAX_DIGITS])
    if lines[-1] != "" or len(body) != rows + 2:
        raise InputError(
            f"{file}: line {len(lines)}: cut or joined, {rows} rows expected, {len(body) - 2} whole"
        )
    if head[1] != f"{seal:08x}":
        raise InputError(f"{file}: line 1: checksum {head[1][:8]!r} does not fit the rows, {seal:08x}")
    if rows < 1:
        raise InputError(f"{file}: line 1: no rows, at least one is needed")
    return _Table(body[0].removeprefix("# "), tuple(body[1].split(",")), [row.split(",") for row in body[2:]])


def _numbers(file: Path, rows: list[list[str]], width: int, line: int = FIRST_LINE) -> Array:
    """Turn cells into numbers (rows, width), refusing text, NaN and infinity by line."""
    values = np.empty((len(rows), width))
    for number, row in enumerate(rows):
        try:
            if len(row) != width:
                raise ValueError(f"{len(row)} cells")
            values[number] = [float(cell) for cell in row]
        except ValueError as error:
            raise InputError(f"{file}: line {line + number}: {width} numbers expected, {error}") from None
        if not np.isfinite(values[number]).all():
            raise InputError(f"{file}: line {line + number}: every number must be finite")
    return values
