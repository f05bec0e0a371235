"""Pack coordinate columns of any type into points: the shift is taken off before digits are lost."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Shift = tuple[float, float, float]
NO_SHIFT: Shift = (0.0, 0.0, 0.0)


def pack(columns: Sequence[NDArray[Any]], shift: Shift) -> NDArray[np.float32]:
    """Subtract the shift in double precision and keep what is left as float32.

    Args:
        columns: x, y and z [m], each shape (n,).
        shift: Coordinates of the base origin in the file [m].

    Returns:
        Points, shape (n, 3).
    """
    out = np.empty((len(columns[0]), 3), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is dropped later
        for k, column in enumerate(columns):
            if shift[k] == 0.0:
                out[:, k] = column
            else:
                out[:, k] = column - np.float64(shift[k])
    return out
