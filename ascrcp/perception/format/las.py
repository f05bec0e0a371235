"""Read LAS and LAZ, the surveyors' formats; the header is checked before laspy sees the file."""

import logging
import struct
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.perception.format.column import NO_SHIFT, Shift, pack

# each backend it tries logs its own failure; ours is one line
logging.getLogger("laspy").setLevel(logging.CRITICAL)

_HEADER = 227  # bytes of the smallest public header block, LAS 1.0-1.2
_VLR, _EVLR = 54, 60  # bytes of the heads of (extended) variable length records
_MAX_RECORDS = 10_000
_VARIABLE = 0xFFFFFFFF  # chunk size of LAZ files whose chunks differ
_MAX_CHUNK = 5_000_000  # usual: 50,000 points
_MAX_LAZ_RATIO = 500  # points of a real scan compress 5..20 times; a bomb much more
_MAX_POINTS = 200_000_000


def read_las(path: Path, shift: Shift = NO_SHIFT) -> NDArray[np.float32]:
    """Read the points, less the shift, shape (n, 3) [m].

    Raises:
        InputError: Not a LAS, cut short, or a header that promises more points than the file holds.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375)
    if len(head) < _HEADER or head[:4] != b"LASF":
        raise InputError(f"{path}: not a LAS file, it does not begin with 'LASF' and a whole header")
    start, kind, record, count = struct.unpack_from("<I4xBHI", head, 96)
    if head[25] >= 4 and len(head) >= 255:
        count = max(count, struct.unpack_from("<Q", head, 247)[0])
    compressed = bool(kind & 0xC0)
    room = max(0, size - start)
    limit = room * (_MAX_LAZ_RATIO if compressed else 1)
    if count > _MAX_POINTS or record * count > limit or start > size:
        raise InputError(f"{path}: the header promises {count} points, the file has {room} bytes for them")
    laszip = _check_records(path, head, start, size)
    if count == 0:
        return np.zeros((0, 3), dtype=np.float32)
    if compressed:
        _check_laszip(path, laszip, start, record, count)
    try:
        with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs) as reader:
            points = reader.read()
        return pack([np.asarray(points.x), np.asarray(points.y), np.asarray(points.z)], shift)
    except Exception as error:  # noqa: BLE001 - decoders of several libraries, each with its own errors
        raise InputError(f"{path}: damaged LAS file ({_one_line(error)})") from None
    except BaseException as error:  # a panic of the Rust decoder is not an Exception
        if type(error).__name__ != "PanicException":
            raise
        raise InputError(f"{path}: damaged LAZ file ({_one_line(error)})") from None


def _check_records(path: Path, head: bytes, start: int, size: int) -> bytes:
    """Walk the variable length records: laspy believes their number and would read for minutes.

    Returns:
        The laszip record, empty if there is none.
    """
    laszip = b""
    at, records = struct.unpack_from("<H", head, 94)[0], struct.unpack_from("<I", head, 100)[0]
    chains = [(at, records, start, "<H", 20, _VLR)]
    if head[25] >= 4 and len(head) >= 255:
        at, records = struct.unpack_from("<QI", head, 235)
        chains.append((at, records, size, "<Q", 20, _EVLR))
    with path.open("rb") as file:
        for at, records, end, kind, where, length in chains:
            if records > _MAX_RECORDS:
                raise InputError(
                    f"{path}: the header promises {records} extra records, allowed {_MAX_RECORDS}"
                )
            for _ in range(records):
                file.seek(at)
                record = file.read(length)
                if at > size or len(record) < length:
                    raise InputError(f"{path}: the header promises {records} extra records; cut short?")
                room = struct.unpack_from(kind, record, where)[0]
                if at + length + room > min(end, size):
                    raise InputError(f"{path}: an extra record runs past its end; damaged LAS file")
                if record[2:16] == b"laszip encoded":
                    laszip = file.read(room)
                at += length + room
    return laszip


def _check_laszip(path: Path, laszip: bytes, start: int, record: int, count: int) -> None:
    """Check what the decompressor would believe: it aborts the whole program on a lying chunk table."""
    size = path.stat().st_size
    if len(laszip) < 34:
        raise InputError(f"{path}: the LAZ file has no laszip record; damaged")
    chunk, items = struct.unpack_from("<I", laszip, 12)[0], struct.unpack_from("<H", laszip, 32)[0]
    sizes = [struct.unpack_from("<HHH", laszip, at)[1] for at in range(34, len(laszip) - 5, 6)]
    if len(sizes) != items or sum(sizes) != record or chunk == 0:
        raise InputError(f"{path}: the laszip record does not agree with the points; damaged LAZ file")
    if chunk != _VARIABLE and not chunk <= _MAX_CHUNK:
        raise InputError(f"{path}: chunks of {chunk} points, allowed {_MAX_CHUNK}; damaged LAZ file")
    with path.open("rb") as file:
        file.seek(start)
        table = struct.unpack("<q", file.read(8).ljust(8, b"\0"))[0]
        if table == -1:  # written as a stream: the place stands at the end
            file.seek(size - 8)
            table = struct.unpack("<q", file.read(8))[0]
        if not start + 8 <= table <= size - 8:
            raise InputError(f"{path}: the chunk table lies outside the file; cut short?")
        file.seek(table)
        chunks = struct.unpack("<II", file.read(8))[1]
    most = table - start if chunk == _VARIABLE else -(-count // chunk)
    if chunks > most:
        raise InputError(f"{path}: the chunk table promises {chunks} chunks, at most {most} can be there")


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
