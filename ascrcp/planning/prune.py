"""Leave out the passes to which the doses gave nothing: Lines + Dose -> Lines."""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from ascrcp.planning.coverage import Lines
from ascrcp.planning.dose import Dose

LEAST_M3 = 0.001  # a stroke that would lay less is not driven: half of what a patch takes to be 20 mm thicker
BRIDGED = 2  # so many points without concrete are driven through, not round; placeholder


def keep_dosed(lines: Lines, dose: Dose) -> Lines:
    """Keep the points at whose stretches something is laid, each pass begun at its end nearer to the last.

    Args:
        lines: The points.
        dose: What each stretch between two of them lays.

    Returns:
        The points kept, passes numbered anew; a pass falls into pieces where more than `BRIDGED` points
        in a row lay nothing, and pieces that lay less than `LEAST_M3` are left out.
    """
    used = np.zeros(len(lines.along), dtype=bool)
    first = dose.stretches.first[dose.amount > 0.0]
    used[first] = used[first + 1] = True
    volume = np.zeros(len(lines.along))
    volume[dose.stretches.first] = dose.amount * dose.stretches.length
    pieces = [
        piece
        for number in np.unique(lines.pass_index[used])
        for piece in _pieces(np.flatnonzero(used & (lines.pass_index == number)))
        if volume[piece].sum() >= LEAST_M3
    ]
    order: list[NDArray[np.int64]] = []
    for piece in pieces:
        if order:
            here = lines.nozzle[order[-1][-1]]
            ahead, behind = np.linalg.norm(lines.nozzle[piece[[0, -1]]] - here, axis=1)
            piece = piece[::-1] if behind < ahead else piece
        order.append(piece)
    rows = np.concatenate(order) if order else np.zeros(0, dtype=np.int64)
    kept = {field.name: getattr(lines, field.name)[rows] for field in fields(Lines)}
    kept["pass_index"] = np.repeat(np.arange(len(order)), [len(piece) for piece in order])
    return Lines(**kept)


def _pieces(points: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Part points of one pass at long gaps and fill the short ones."""
    parts = np.split(points, np.flatnonzero(np.diff(points) > BRIDGED + 1) + 1)
    return [np.arange(part[0], part[-1] + 1) for part in parts]
