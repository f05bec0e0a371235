"""Read E57 through pye57, an extra: it brings compiled Xerces that the cab does not need."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.perception.format.column import NO_SHIFT, Shift, pack

_MAX_POINTS = 200_000_000


def read_e57(path: Path, shift: Shift = NO_SHIFT) -> NDArray[np.float32]:
    """Read all scans of the file in its common frame, less the shift, shape (n, 3) [m].

    Raises:
        InputError: If the extra is not installed, or the file is damaged.
    """
    try:
        import pye57  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise InputError(
            f"{path}: e57 needs the extra 'e57' (pip install 'ascrcp[e57]'); or convert it to las or ply"
        ) from None
    try:
        file = pye57.E57(str(path))
        promised = sum(file.get_header(i).point_count for i in range(file.scan_count))
        if promised > min(_MAX_POINTS, path.stat().st_size):
            raise InputError(f"{path}: the header promises {promised} points, more than the file can hold")
        scans = [file.read_scan(i, ignore_missing_fields=True) for i in range(file.scan_count)]
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 - errors of the compiled reader
        raise InputError(f"{path}: damaged E57 file ({' '.join(str(error).split())[:120]})") from None
    parts = [pack([s[f"cartesian{c}"] for c in "XYZ"], shift) for s in scans if "cartesianX" in s]
    return np.concatenate(parts) if parts else np.zeros((0, 3), dtype=np.float32)
