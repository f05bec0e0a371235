"""Read a cloud file in the base frame: ply, pcd, las, laz, xyz, csv, txt, e57 -> Cloud."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Cloud
from ascrcp.perception.format.column import NO_SHIFT, Shift
from ascrcp.perception.format.e57 import read_e57
from ascrcp.perception.format.las import read_las
from ascrcp.perception.format.pcd import read_pcd
from ascrcp.perception.format.ply import read_ply
from ascrcp.perception.format.table import read_table

MAX_BYTES = 2_000_000_000  # faults.md, security: a cloud is capped at 2 GB

FAR = 4000.0  # half the spacing of float32 is 0.12 mm here [m]
_SAMPLE = 20_000  # points that say where the cloud lies

_READERS: dict[str, Callable[[Path, Shift], NDArray[np.float32]]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
    ".xyz": read_table,
    ".csv": read_table,
    ".txt": read_table,
    ".e57": read_e57,
}


def read_cloud(path: Path, shift: Shift = NO_SHIFT) -> Cloud:
    """Read a cloud file by its suffix.

    Args:
        path: The file; coordinates are metres in the base frame, or parallel to it with the shift.
        shift: Coordinates of the base origin in the file [m], taken off in double precision: clouds
            in surveyors' coordinates keep their millimetres.

    Returns:
        Its finite points.

    Raises:
        InputError: One line: unreadable, unknown format, damaged, cut short, without points,
            or so far from the origin that single precision would lose millimetres.
    """
    path = Path(path)
    if len(shift) != 3 or not all(abs(value) < 1e9 for value in shift):
        raise InputError(f"shift {shift}: three finite coordinates in metres are needed")
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
        points = reader(path, shift)
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
    middle = np.median(points[:: max(1, len(points) // _SAMPLE)].astype(float), axis=0)
    if not np.abs(middle).max() <= FAR:
        offer = ",".join(f"{round(value, -1):.0f}" for value in middle)
        raise InputError(
            f"{path}: the points lie about ({offer}) m from the origin, allowed {FAR:g} m: millimetres, or "
            f"surveyors' coordinates? Say where the base origin lies in them (shift, for example {offer})"
        )
    return Cloud(points, source=str(path))
