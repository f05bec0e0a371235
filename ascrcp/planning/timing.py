"""Put times to the solved path: SprayPath + joints -> JointSequence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.move import plan_move
from ascrcp.planning.parameter import TimingParameters, check_parameters
from ascrcp.planning.stroke import Stroke

SUBDIVISION = 8  # nodes of the time law per pair of planned points: 20 mm at 0.2 m spacing
CENTRIPETAL_SHARE = 0.5  # of a joint's acceleration for following the bend, the rest for changing speed


@dataclass(frozen=True)
class _Rows:
    """Rows of a stroke or of a move, times from its own start; see JointSequence."""

    t: Array
    q: Array
    position: Array
    direction: Array
    point: NDArray[np.int64]
    spraying: NDArray[np.bool_]


@dataclass(frozen=True)
class TimedPath:
    """A path with times put to it.

    Attributes:
        sequence: Rows from the first point sprayed to the last.
        reasons: Why a solved point was left out, None for the others; one for each planned point.
    """

    sequence: JointSequence
    reasons: tuple[str | None, ...]


def time_sequence(
    arm: Arm,
    path: SprayPath,
    q: ArrayLike,
    break_before: ArrayLike,
    parameters: TimingParameters,
    obstacles: Obstacles | None = None,
) -> JointSequence:
    """Return the sequence of `time_path` alone."""
    return time_path(arm, path, q, break_before, parameters, obstacles).sequence


def time_path(
    arm: Arm,
    path: SprayPath,
    q: ArrayLike,
    break_before: ArrayLike,
    parameters: TimingParameters,
    obstacles: Obstacles | None = None,
    progress: Callable[[float], None] | None = None,
) -> TimedPath:
    """Travel the path at constant nozzle speed, slower where a joint's speed or acceleration asks for it.

    Planned points are joined by spraying strokes as long as they are near and nothing breaks
    them; strokes start and end at rest and are joined by jerk-limited joint moves without spray.
    Points without a solution are skipped, and so is a stroke that no move reaches without coming too
    near to something, from the zero pose for the first; it is tried again when all others are sprayed.
    Rows at planned points hold their joints and pose exactly; on a stroke the pose is the path's, between
    strokes that of the joints.

    Args:
        arm: The arm, for its limits and forward model.
        path: Planned poses, n points.
        q: Joints of each point [rad, m], NaN rows where unsolved, shape (n, joints).
        break_before: Points the arm does not reach without a joint move, shape (n,).
        parameters: Speeds.
        obstacles: What moves keep clear of; None if nothing is known of the surroundings.
        progress: Called with the share done; may raise CancelledError to stop.

    Raises:
        InputError: Shapes that do not belong together.
        UnreachableError: No point has a solution, or no stroke can be reached.
    """
    parameters = check_parameters(parameters)
    q = np.asarray(q, dtype=float)
    breaks = np.asarray(break_before, dtype=bool)
    if q.shape != (len(path), arm.n) or breaks.shape != (len(path),):
        raise InputError(
            f"a path of {len(path)} points needs joints of shape ({len(path)}, {arm.n}) and as many breaks, "
            f"not {q.shape} and {breaks.shape}"
        )
    strokes = find_strokes(path, q, breaks, parameters.gap_m)
    if not strokes:
        raise UnreachableError(f"none of the {len(path)} planned points has a joint solution within limits")
    tour = _Tour(arm, path, q, parameters, obstacles)
    late: list[NDArray[np.int64]] = []
    for number, stroke in enumerate(strokes):
        if progress is not None:
            progress(number / len(strokes))
        late += tour.add(stroke)
    waiting = len(late) + 1
    while len(late) < waiting:  # the arm stands elsewhere now; again as long as that helps
        waiting, late = len(late), [left for stroke in late for left in tour.add(stroke)]
    if not tour.parts:
        first = tour.reasons[strokes[0][0]]
        raise UnreachableError(f"none of {len(strokes)} strokes can be approached; {first}")
    return TimedPath(_join(tour.parts), tuple(tour.reasons))


def _join(parts: Sequence[_Rows]) -> JointSequence:
    return JointSequence(
        t=np.concatenate([p.t for p in parts]),
        q=np.concatenate([p.q for p in parts]),
        position=np.concatenate([p.position for p in parts]),
        direction=np.concatenate([p.direction for p in parts]),
        point=np.concatenate([p.point for p in parts]),
        spraying=np.concatenate([p.spraying for p in parts]),
    )


class _Tour:
    """Strokes one after the other, joined by moves.

    Attributes:
        parts: Rows so far.
        reasons: Why a point is left out, so far.
    """

    def __init__(
        self, arm: Arm, path: SprayPath, q: Array, parameters: TimingParameters, obstacles: Obstacles | None
    ) -> None:
        self._arm, self._path, self._q = arm, path, q
        self._parameters, self._obstacles = parameters, obstacles
        self._clock = 0.0
        self._last = None if obstacles is None else arm.zero_pose
        self.parts: list[_Rows] = []
        self.reasons: list[str | None] = [None] * len(path)

    def add(self, stroke: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """Append a stroke and the move to it; return what cannot be reached from here."""
        skipped = 0
        if self._last is not None:
            skipped, move, why = self._enter(self._last, self._q[stroke])
            for i in stroke.tolist():
                self.reasons[i] = None
            for i in stroke[:skipped].tolist():
                self.reasons[i] = f"its stroke cannot be approached: {why}"
            if move is None:
                return [stroke]
            if self.parts:
                duration, t, q = move
                rows = np.vstack([q, self._q[stroke[skipped]]])
                arrive = _reposition(self._arm, np.append(t, duration), rows)
                self.parts.append(_shift(arrive, self._clock))
                self._clock += duration + self._parameters.settle_s
        sprayed = stroke[skipped:]
        part = _spray(self._arm, self._path, self._q, sprayed, self._parameters)
        self.parts.append(_shift(part, self._clock))
        self._clock, self._last = self._clock + float(part.t[-1]), self._q[sprayed[-1]]
        return [stroke[:skipped]] if skipped else []

    def _enter(self, last: Array, q: Array) -> tuple[int, tuple[float, Array, Array] | None, str]:
        """Find where a stroke can be entered: at its first point, else further and further on.

        The way back along all that was driven and the stroke itself are known to be clear. The first
        stroke does without: the move to it is planned again where the arm then stands.

        Returns:
            How many points are left out, the move to the next one (None: all are), why.
        """
        why, skipped = "", 0
        driven = [np.concatenate([part.q for part in self.parts])[::-1]] if self.parts else []
        while skipped < len(q):
            trails = [*driven, q[skipped:]] if driven else []
            try:
                end = q[skipped]
                move = plan_move(self._arm, last, end, self._parameters, self._obstacles, trails)
            except UnreachableError as error:
                why = why or str(error)
            else:
                return skipped, move, why
            skipped = 2 * skipped + 1
        return len(q), None, why


def find_strokes(
    path: SprayPath, q: Array, break_before: NDArray[np.bool_], gap: float
) -> list[NDArray[np.int64]]:
    """Group the solved points into strokes sprayed without a stop; indices of points, in order."""
    solved = np.flatnonzero(np.isfinite(q).all(axis=1))
    if not len(solved):
        return []
    broken = np.cumsum(break_before)
    before, after = solved[:-1], solved[1:]
    cut = broken[after] > broken[before]
    cut |= ~(np.linalg.norm(path.position[after] - path.position[before], axis=1) <= gap)
    cut |= (path.bay[after] != path.bay[before]) | (path.overbreak[after] != path.overbreak[before])
    return np.split(solved, np.flatnonzero(cut) + 1)


def _shift(rows: _Rows, clock: float) -> _Rows:
    return _Rows(rows.t + clock, rows.q, rows.position, rows.direction, rows.point, rows.spraying)


def _reposition(arm: Arm, t: Array, q: Array) -> _Rows:
    """Make rows of a joint move: no spray, the pose is what the joints give."""
    T = arm.forward(q)
    none = np.full(len(t), -1, dtype=np.int64)
    return _Rows(t, q, T[:, :3, 3], T[:, :3, 0], none, np.zeros(len(t), dtype=bool))


def _spray(
    arm: Arm, path: SprayPath, q: Array, stroke: NDArray[np.int64], parameters: TimingParameters
) -> _Rows:
    """Time one stroke: joints and pose as splines over the path's length, then the fastest law."""
    position, direction = path.position[stroke], path.direction[stroke]
    if len(stroke) == 1:
        return _Rows(np.zeros(1), q[stroke], position, direction, stroke, np.zeros(1, dtype=bool))
    curve = Stroke(arm, q[stroke], position, direction)
    count = len(stroke) - 1
    nodes = np.interp(np.arange(SUBDIVISION * count + 1) / SUBDIVISION, np.arange(count + 1), curve.knots)
    wanted = _wanted_speed(path.speed[stroke], parameters.nozzle_speed_m_s)
    speed = _speed_law(arm, nodes, curve.solve(nodes), curve.pose(nodes)[0], wanted, parameters)
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(nodes) / (speed[:-1] + speed[1:]))])
    t, exact = _row_times(times[::SUBDIVISION], parameters.row_s)
    u = _invert(t, times, nodes, speed)
    rows_q = curve.solve(u)
    rows_p, rows_d = curve.pose(u)
    rows_q[exact], rows_p[exact], rows_d[exact] = q[stroke], position, direction
    point = np.full(len(t), -1, dtype=np.int64)
    point[exact] = stroke
    spraying = np.arange(len(t)) < len(t) - 1
    return _Rows(t, rows_q, rows_p, rows_d, point, spraying)


def _wanted_speed(planned: Array, default: float) -> Array:
    """Spread the speeds wanted on leaving the points of a stroke (k,) over its nodes [m/s].

    Where two stretches meet the slower one counts: the pump lays less on the faster one while it speeds up.
    """
    leaving = np.where(planned > 0.0, planned, default)[:-1]
    nodes = np.append(np.repeat(leaving, SUBDIVISION), leaving[-1])
    knots = slice(SUBDIVISION, -1, SUBDIVISION)
    nodes[knots] = np.minimum(leaving[1:], leaving[:-1])
    return nodes


def _speed_law(
    arm: Arm, nodes: Array, q: Array, position: Array, wanted: Array, parameters: TimingParameters
) -> Array:
    """Find the fastest path speed at the nodes [m/s] that keeps every limit, at rest at both ends.

    The classic two sweeps: the limit curve from speeds and bends, then forward and backward so
    that no acceleration is exceeded. Rates are those of the joints as they will be driven.

    Args:
        arm: For its largest speeds and accelerations.
        nodes: Path lengths [m], shape (m,).
        q: Joints there, shape (m, joints).
        position: Nozzle positions there [m], shape (m, 3).
        wanted: Nozzle speed wanted there [m/s], shape (m,).
        parameters: Speeds and shares.
    """
    p = parameters
    gaps = np.diff(nodes)[:, None]
    secant = np.diff(q, axis=0) / gaps
    first = _either_side(np.abs(secant))
    second = np.zeros_like(q)
    second[1:-1] = np.abs(np.diff(secant, axis=0)) / ((gaps[1:] + gaps[:-1]) / 2.0)
    chord = np.linalg.norm(np.diff(position, axis=0), axis=1, keepdims=True) / gaps
    place_rate = np.maximum(_either_side(chord)[:, 0], 1e-9)
    tiny = 1e-12
    acceleration = p.acceleration_fraction * arm.max_acceleration
    limit = np.minimum.reduce(
        [
            wanted / place_rate,
            (p.speed_fraction * arm.max_speed / (first + tiny)).min(axis=1),
            np.sqrt(CENTRIPETAL_SHARE * acceleration / (second + tiny)).min(axis=1),
        ]
    )
    ramp = np.minimum(
        p.nozzle_acceleration_m_s2 / place_rate,
        ((1.0 - CENTRIPETAL_SHARE) * acceleration / (first + tiny)).min(axis=1),
    )
    gain = 2.0 * np.minimum(ramp[:-1], ramp[1:]) * np.diff(nodes)
    square = limit**2
    square[0] = square[-1] = 0.0
    for k in range(1, len(nodes)):
        square[k] = min(square[k], square[k - 1] + gain[k - 1])
    for k in range(len(nodes) - 2, -1, -1):
        square[k] = min(square[k], square[k + 1] + gain[k])
    return np.asarray(np.sqrt(square))


def _either_side(values: Array) -> Array:
    """Take at every node the larger of the values of its two intervals, shape (m + 1, k)."""
    ends = values[:1], values[-1:]
    return np.maximum(np.concatenate([ends[0], values]), np.concatenate([values, ends[1]]))


def _row_times(knot_times: Array, row: float) -> tuple[Array, NDArray[np.int64]]:
    """Fill the time between planned points evenly with rows; their times and the points' rows."""
    counts = np.maximum(1, np.ceil(np.diff(knot_times) / row - 1e-9)).astype(np.int64)
    exact = np.concatenate([[0], np.cumsum(counts)])
    return np.interp(np.arange(exact[-1] + 1), exact, knot_times), exact


def _invert(t: Array, times: Array, nodes: Array, speed: Array) -> Array:
    """Find the path length reached at times t: constant acceleration between nodes."""
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(nodes) - 2)
    after = t - times[k]
    acceleration = (speed[k + 1] ** 2 - speed[k] ** 2) / (2.0 * (nodes[k + 1] - nodes[k]))
    return np.clip(nodes[k] + speed[k] * after + 0.5 * acceleration * after**2, nodes[k], nodes[k + 1])
