"""Read LAS and LAZ, the surveyors' formats; the header is checked before laspy sees the file."""

import struct
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError

_HEADER = 227  # bytes of the smallest public header block, LAS 1.0-1.2
_MAX_LAZ_RATIO = 500  # points of a real scan compress 5..20 times; a bomb much more
_MAX_POINTS = 200_000_000


def read_las(path: Path) -> NDArray[np.float32]:
    """Read the points, shape (n, 3) [m].

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
    if count == 0:
        return np.zeros((0, 3), dtype=np.float32)
    try:
        with laspy.open(path) as reader:
            points = reader.read()
        xyz = np.stack([points.x, points.y, points.z], axis=-1)
    except Exception as error:  # noqa: BLE001 - decoders of several libraries, each with its own errors
        raise InputError(f"{path}: damaged LAS file ({_one_line(error)})") from None
    return np.asarray(xyz, dtype=np.float32)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
