"""A joint sequence as a smooth function of time: JointSequence -> joints, speeds, nozzle pose at t."""

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array

_Row = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Sample:
    """The reference at one instant.

    Attributes:
        q: Joints [rad, m].
        speed: Joint speeds [rad/s, m/s].
        position: Nozzle position wanted [m].
        direction: Unit spray direction wanted.
        spraying: Whether concrete should flow.
        flow: Pump flow wanted, fraction 0..1; 0 where not spraying.
    """

    q: _Row
    speed: _Row
    position: _Row
    direction: _Row
    spraying: bool
    flow: float = 0.0


PART = 256  # rows converted at once: a long conversion would keep the interpreter's lock for 10 ms


class Reference:
    """Cubic Hermite interpolation through every row; rests at both ends.

    Slopes are those of Fritsch and Butland's monotone scheme: no joint passes a row's value between
    rows, so a sequence within limits stays within them, and it stands still where rows repeat.
    Evaluation costs the same however long the sequence is, as long as time moves little; building it
    does not: 0.1 s for twenty minutes, too long for the control thread.
    """

    def __init__(self, sequence: JointSequence) -> None:
        self.sequence = sequence
        self.duration = sequence.duration
        self._joints = sequence.q.shape[1]
        values = np.hstack([sequence.q, sequence.position, sequence.direction])
        self._t: list[float] = sequence.t.tolist()
        self._rows = _nested(values)
        self._slopes = _nested(find_slopes(sequence.t, values))
        self._spraying: list[bool] = sequence.spraying.tolist()
        self._flow: list[float] = sequence.flow.tolist()
        at = np.flatnonzero(sequence.point >= 0)
        self.points: list[tuple[float, int]] = [(self._t[i], int(sequence.point[i])) for i in at]
        self._row = 0

    def at(self, t: float) -> Sample:
        """Evaluate everything at an instant [s]; before the start and after the end it rests."""
        values, rates = self._evaluate(t, len(self._rows[0]))
        n = self._joints
        d = values[n + 3 :]
        length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        spraying = self._spraying[self._row] and t < self.duration
        return Sample(
            q=tuple(values[:n]),
            speed=tuple(rates[:n]),
            position=tuple(values[n : n + 3]),
            direction=(d[0] / length, d[1] / length, d[2] / length) if length > 0.0 else (0.0, 0.0, 0.0),
            spraying=spraying,
            flow=self._flow[self._row] if spraying else 0.0,
        )

    def speed_at(self, t: float) -> _Row:
        """Evaluate the joint speeds alone [rad/s, m/s]."""
        return tuple(self._evaluate(t, self._joints)[1])

    def _evaluate(self, t: float, columns: int) -> tuple[list[float], list[float]]:
        k = self._seek(t)
        if k + 1 >= len(self._t) or t <= self._t[0]:
            row = self._rows[k]
            return row[:columns], [0.0] * columns
        h = self._t[k + 1] - self._t[k]
        s = (t - self._t[k]) / h
        s2 = s * s
        s3 = s2 * s
        b1, b3 = 3.0 * s2 - 2.0 * s3, s3 - s2
        b2 = s3 - 2.0 * s2 + s
        c1, c2, c3 = 6.0 * (s - s2) / h, 3.0 * s2 - 4.0 * s + 1.0, 3.0 * s2 - 2.0 * s
        values, rates = [], []
        rows = (self._rows[k], self._rows[k + 1], self._slopes[k], self._slopes[k + 1])
        for p, p1, m, m1 in zip(*(row[:columns] for row in rows), strict=True):
            rise = p1 - p
            values.append(p + b1 * rise + h * (b2 * m + b3 * m1))
            rates.append(c1 * rise + c2 * m + c3 * m1)
        return values, rates

    def _seek(self, t: float) -> int:
        """Return the row whose interval holds t, from the last one found."""
        k, times = self._row, self._t
        last = len(times) - 1
        if not times[k] <= t or (k + 2 <= last and t >= times[k + 2]):
            k = max(0, bisect_right(times, t) - 1)
        elif k < last and t >= times[k + 1]:
            k += 1
        self._row = k
        return k


def _nested(table: Array) -> list[list[float]]:
    return [row for start in range(0, len(table), PART) for row in table[start : start + PART].tolist()]


def find_slopes(t: Array, values: Array) -> Array:
    """Compute monotone slopes at every row (Fritsch-Butland), zero at both ends.

    Args:
        t: Times [s], strictly rising, shape (m,).
        values: Row values, shape (m, k).

    Returns:
        Slopes, shape (m, k): weighted harmonic mean of the two neighbouring rises, 0 at extremes.
    """
    slopes = np.zeros_like(values)
    if len(t) < 3:
        return slopes
    h = np.diff(t)[:, None]
    rise = np.diff(values, axis=0) / h
    before, after = rise[:-1], rise[1:]
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    same = before * after > 0.0
    safe_before, safe_after = np.where(same, before, 1.0), np.where(same, after, 1.0)
    mean = (w1 + w2) / (w1 / safe_before + w2 / safe_after)
    slopes[1:-1] = np.where(same, mean, 0.0)
    return slopes
