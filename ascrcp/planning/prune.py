"""Leave out the passes to which the doses gave nothing: Lines + Dose -> Lines."""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.planning.coverage import Lines
from ascrcp.planning.dose import Dose

LEAST_M3 = 0.001  # a stroke that would lay less is not driven: half of what a patch takes to be 20 mm thicker
BRIDGED = 2  # so many points without concrete are driven through, not round; placeholder


def keep_dosed(lines: Lines, dose: Dose, close: float) -> Lines:
    """Keep the points at whose stretches something is laid, each pass begun at its end nearer to the last.

    Args:
        lines: The points.
        dose: What each stretch between two of them lays.
        close: Pieces aimed so near to each other reach the same wall: as far as passes are apart [m].

    Returns:
        The points kept, passes numbered anew; a pass falls into pieces where more than `BRIDGED` points
        in a row lay nothing. Of pieces that lay less than `LEAST_M3` those are kept that do with what lesser
        ones close by were to lay; the others are left out.
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
    ]
    pieces = _worth_driving(pieces, [float(volume[piece].sum()) for piece in pieces], lines.wall, close)
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


def _worth_driving(
    pieces: list[NDArray[np.int64]], volume: list[float], wall: Array, close: float
) -> list[NDArray[np.int64]]:
    """Choose the pieces that lay enough [m3], alone or for the lesser ones close by, in their order.

    Args:
        pieces: Points of each.
        volume: What each lays [m3].
        wall: The points aimed at [m], shape (n, 3).
        close: Pieces nearer to each other than this are close by [m].
    """
    small = [k for k in np.argsort(volume)[::-1].tolist() if volume[k] < LEAST_M3]
    dropped: set[int] = set()
    for n, k in enumerate(small):
        if k in dropped:
            continue
        lesser = [
            j for j in small[n + 1 :] if j not in dropped and _apart(wall, pieces[k], pieces[j]) < close
        ]
        if volume[k] + sum(volume[j] for j in lesser) >= LEAST_M3:
            dropped.update(lesser)
        else:
            dropped.add(k)
    return [piece for k, piece in enumerate(pieces) if k not in dropped]


def _apart(wall: Array, one: NDArray[np.int64], other: NDArray[np.int64]) -> float:
    return float(np.linalg.norm(wall[one][:, None] - wall[other][None], axis=2).min())
