"""Read PCD (Point Cloud Library): ascii, binary and binary_compressed; only x, y, z."""

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.perception.format.column import NO_SHIFT, Shift, pack
from ascrcp.perception.format.table import parse_rows

_MAX_HEADER = 65_536
_KEYS = ("FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "POINTS", "DATA")
_TYPES = {"F4": "<f4", "F8": "<f8", "I1": "i1", "I2": "<i2", "I4": "<i4", "I8": "<i8",
          "U1": "u1", "U2": "<u2", "U4": "<u4", "U8": "<u8"}  # fmt: skip
_MAX_LZF_RATIO = 260  # LZF turns 3 bytes into at most 264; more cannot be honest


def read_pcd(path: Path, shift: Shift = NO_SHIFT) -> NDArray[np.float32]:
    """Read the points, less the shift, shape (n, 3) [m].

    Raises:
        InputError: Not a PCD, cut short, or without x, y, z.
    """
    header, start = _read_header(path)
    dtype, count = _layout(path, header)
    left = path.stat().st_size - start
    encoding = header["DATA"][0]
    if encoding == "ascii":
        width = sum(int(c) for c in header["COUNT"])
        if left < 2 * width * count - 1:
            raise InputError(
                f"{path}: the header promises {count} points, the file has {left} bytes for them"
            )
        before = np.cumsum([0] + [int(c) for c in header["COUNT"]])
        columns = [int(before[header["FIELDS"].index(c)]) for c in "xyz"]
        with path.open("rb") as file:
            file.seek(start)
            return parse_rows(file, path, None, (columns[0], columns[1], columns[2]), count, shift=shift)
    if encoding == "binary":
        if left < dtype.itemsize * count:
            raise InputError(
                f"{path}: the header promises {count} points, "
                f"the file has room for {left // dtype.itemsize}; cut short?"
            )
        data = np.fromfile(path, dtype, count, offset=start)
        return pack([data[c] for c in "xyz"], shift)
    if encoding == "binary_compressed":
        return _read_compressed(path, start, dtype, count, shift)
    raise InputError(f"{path}: PCD data {encoding!r}, allowed ascii, binary, binary_compressed")


def _read_header(path: Path) -> tuple[dict[str, list[str]], int]:
    with path.open("rb") as file:
        raw = file.read(_MAX_HEADER)
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        stop = raw.find(b"\n", start)
        if stop < 0:
            raise InputError(f"{path}: not a PCD file, its header has no DATA line")
        words = raw[start:stop].decode("latin-1").split()
        if words and words[0] in _KEYS and len(words) > 1:
            header[words[0]] = words[1:]
        elif words and not words[0].startswith("#") and words[0] not in ("VERSION", "VIEWPOINT"):
            raise InputError(f"{path}: bad PCD header line {' '.join(words)[:80]!r}")
        start = stop + 1
    return header, start


def _layout(path: Path, header: dict[str, list[str]]) -> tuple[np.dtype, int]:
    fields = header.get("FIELDS", [])
    header.setdefault("COUNT", ["1"] * len(fields))
    if not {"x", "y", "z"} <= set(fields):
        raise InputError(
            f"{path}: the PCD's fields must hold x, y and z, not {' '.join(fields)[:80] or 'nothing'}"
        )
    sizes, kinds, counts = header.get("SIZE", []), header.get("TYPE", []), header["COUNT"]
    points = header.get("POINTS") or header.get("WIDTH") or [""]
    numbers = [*counts, points[0]]
    if not len(fields) == len(sizes) == len(kinds) == len(counts) or not all(
        n.isdecimal() and len(n) <= 12 for n in numbers
    ):
        raise InputError(f"{path}: the PCD header's FIELDS, SIZE, TYPE, COUNT and POINTS do not agree")
    codes = [kind + size for kind, size in zip(kinds, sizes, strict=True)]
    if not all(code in _TYPES for code in codes) or not all(0 < int(c) <= 4096 for c in counts):
        raise InputError(f"{path}: unknown field type in the PCD header: {' '.join(codes)[:80]}")
    layout = [
        # padding fields are all called "_"
        (name if name in "xyz" else f"_{i}", _TYPES[code], (int(c),) if int(c) > 1 else ())
        for i, (name, code, c) in enumerate(zip(fields, codes, counts, strict=True))
    ]
    try:
        return np.dtype(layout), int(points[0])
    except ValueError as error:
        raise InputError(f"{path}: bad fields in the PCD header ({error})") from None


def _read_compressed(
    path: Path, start: int, dtype: np.dtype, count: int, shift: Shift
) -> NDArray[np.float32]:
    with path.open("rb") as file:
        file.seek(start)
        sizes = file.read(8)
        if len(sizes) < 8:
            raise InputError(f"{path}: the PCD ends after its header")
        packed, full = struct.unpack("<II", sizes)
        raw = file.read(packed) if packed <= path.stat().st_size else b""
    if len(raw) < packed or full != dtype.itemsize * count or full > _MAX_LZF_RATIO * max(packed, 1):
        raise InputError(f"{path}: the compressed PCD's sizes do not agree with the file; cut short?")
    data = np.frombuffer(_unpack(path, raw, full), np.uint8)
    columns, at = {}, 0
    names = dtype.names or ()
    for name in names:  # compressed PCD stores field after field
        kind = dtype[name]
        if name in ("x", "y", "z"):
            columns[name] = data[at : at + kind.itemsize * count].view(kind)
        at += kind.itemsize * count
    return pack([columns[c] for c in "xyz"], shift)


def _unpack(path: Path, raw: bytes, size: int) -> bytearray:
    """Undo LZF: literal runs and references back into what was already written."""
    out = bytearray()
    i, n = 0, len(raw)
    try:
        while i < n:
            control = raw[i]
            i += 1
            if control < 32:
                out += raw[i : i + control + 1]
                i += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += raw[i]
                i += 1
            back = len(out) - ((control & 31) << 8) - raw[i] - 1
            i += 1
            if back < 0 or len(out) > size:
                raise InputError(f"{path}: the compressed PCD is damaged")
            length += 2
            piece = out[back : back + length]
            while len(piece) < length:  # a reference may overlap what it writes
                piece += piece[: length - len(piece)]
            out += piece
    except IndexError:
        raise InputError(f"{path}: the compressed PCD is cut short") from None
    if len(out) != size:
        raise InputError(f"{path}: the compressed PCD unpacks to {len(out)} bytes, {size} promised")
    return out
