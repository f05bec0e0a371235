"""Read a cloud file in the base frame: ply, pcd, las, laz, xyz, csv, txt, e57 -> Cloud."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Cloud
from ascrcp.perception.format.e57 import read_e57
from ascrcp.perception.format.las import read_las
from ascrcp.perception.format.pcd import read_pcd
from ascrcp.perception.format.ply import read_ply
from ascrcp.perception.format.table import read_table

MAX_BYTES = 2_000_000_000  # faults.md, security: a cloud is capped at 2 GB

_READERS: dict[str, Callable[[Path], NDArray[np.float32]]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
    ".xyz": read_table,
    ".csv": read_table,
    ".txt": read_table,
    ".e57": read_e57,
}


def read_cloud(path: Path) -> Cloud:
    """Read a cloud file by its suffix.

    Args:
        path: The file; coordinates are metres in the base frame.

    Returns:
        Its finite points.

    Raises:
        InputError: One line: unreadable, unknown format, damaged, cut short, or without points.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(
            f"{path}: unknown cloud format {path.suffix or 'without suffix'!r}, allowed {' '.join(_READERS)}"
        )
    try:
        if not path.is_file():
            raise InputError(f"{path}: {'not a file' if path.exists() else 'no such file'}")
        size = path.stat().st_size
        if size == 0:
            raise InputError(f"{path}: the file is empty")
        if size > MAX_BYTES:
            raise InputError(f"{path}: {size} bytes, allowed {MAX_BYTES}")
        points = reader(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory") from None
    return _checked(points, path)


def _checked(points: NDArray[np.float32], path: Path) -> Cloud:
    if not len(points):
        raise InputError(f"{path}: holds no points")
    # the sum is finite unless a point is not: one pass without a temporary
    with np.errstate(over="ignore", invalid="ignore"):
        clean = bool(np.isfinite(points.sum(dtype=np.float64)))
    if not clean:
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            raise InputError(f"{path}: holds no finite point, all are NaN or infinite")
    return Cloud(points, source=str(path))
