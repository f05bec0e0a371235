"""Read PLY: ASCII and binary, either byte order; only x, y, z of the vertices."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.perception.format.column import NO_SHIFT, Shift, pack
from ascrcp.perception.format.table import parse_rows

_MAX_HEADER = 65_536
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


@dataclass(frozen=True)
class _Header:
    encoding: str
    count: int
    fields: list[tuple[str, str]]
    skip: int  # bytes of whole elements before the vertices
    size: int  # bytes of the header


def read_ply(path: Path, shift: Shift = NO_SHIFT) -> NDArray[np.float32]:
    """Read the vertices, less the shift, shape (n, 3) [m].

    Raises:
        InputError: Not a PLY, cut short, or without x, y, z.
    """
    header = _read_header(path)
    names = [name for name, _ in header.fields]
    if not {"x", "y", "z"} <= set(names):
        raise InputError(
            f"{path}: the PLY's vertices must have x, y and z, not {', '.join(names) or 'nothing'}"
        )
    order = _ORDER[header.encoding]
    left = path.stat().st_size - header.size - header.skip
    if header.encoding == "ascii":
        if header.skip:
            raise InputError(f"{path}: elements before the vertices are not supported in an ASCII PLY")
        if left < 2 * len(names) * header.count:
            raise _cut(path, header.count, left // (2 * len(names)))
        columns = (names.index("x"), names.index("y"), names.index("z"))
        with path.open("rb") as file:
            file.seek(header.size)
            return parse_rows(file, path, None, columns, header.count, shift=shift)
    dtype = np.dtype([(name, order + kind) for name, kind in header.fields])
    if left < dtype.itemsize * header.count:
        raise _cut(path, header.count, max(0, left) // dtype.itemsize)
    data = np.fromfile(path, dtype, header.count, offset=header.size + header.skip)
    if dtype == np.dtype([(c, "<f4") for c in "xyz"]) and shift == NO_SHIFT:
        return data.view("<f4").reshape(-1, 3)
    return pack([data[c] for c in "xyz"], shift)


def _cut(path: Path, promised: int, there: int) -> InputError:
    return InputError(
        f"{path}: the header promises {promised} vertices, the file has room for {there}; cut short?"
    )


def _read_header(path: Path) -> _Header:
    with path.open("rb") as file:
        raw = file.read(_MAX_HEADER)
    if not raw.startswith((b"ply\n", b"ply\r")):
        raise InputError(f"{path}: not a PLY file, it does not begin with 'ply'")
    end = raw.find(b"end_header")
    stop = raw.find(b"\n", end)
    if end < 0 or stop < 0:
        raise InputError(f"{path}: the PLY header has no end within {_MAX_HEADER} bytes")
    lines = [line.split() for line in raw[:end].decode("latin-1").splitlines()]
    encoding = next((line[1] for line in lines if len(line) == 3 and line[0] == "format"), "")
    if encoding not in _ORDER:
        raise InputError(f"{path}: PLY format {encoding or 'missing'!r}, allowed {', '.join(_ORDER)}")
    elements = _elements(path, lines)
    if "vertex" not in elements:
        raise InputError(f"{path}: the PLY has no vertices")
    skip = 0
    for name, (count, fields) in elements.items():
        if name == "vertex":
            break
        if any(kind == "list" for _, kind in fields):
            raise InputError(f"{path}: lists before the vertices are not supported")
        skip += count * np.dtype([(n, k) for n, k in fields]).itemsize
    count, fields = elements["vertex"]
    if any(kind == "list" for _, kind in fields):
        raise InputError(f"{path}: lists within vertices are not supported")
    return _Header(encoding, count, fields, skip, stop + 1)


def _elements(path: Path, lines: list[list[str]]) -> dict[str, tuple[int, list[tuple[str, str]]]]:
    """Elements in their order: name -> (count, [(property, type)])."""
    elements: dict[str, tuple[int, list[tuple[str, str]]]] = {}
    current = ""
    for line in lines:
        if line[:1] == ["element"]:
            if len(line) != 3 or not line[2].isdecimal() or len(line[2]) > 12 or line[1] in elements:
                raise InputError(f"{path}: bad PLY header line {' '.join(line)[:80]!r}")
            current = line[1]
            elements[current] = (int(line[2]), [])
        elif line[:1] == ["property"]:
            kind = line[1] if len(line) > 1 else ""
            taken = [name for name, _ in elements[current][1]] if current else []
            known = (kind in _TYPES and len(line) == 3) or (kind == "list" and len(line) == 5)
            if not current or not known or line[-1] in taken:
                raise InputError(f"{path}: bad PLY header line {' '.join(line)[:80]!r}")
            elements[current][1].append((line[-1], _TYPES.get(kind, "list")))
    return elements
