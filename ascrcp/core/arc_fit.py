"""Turn a line of points in the section plane into few circular arcs: points -> arcs of a profile."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array

LINE_RADIUS = 2000.0  # a straight wall is an arc this large: 0.25 mm of sagitta on 2 m
TOLERANCE = 0.003  # the arcs stay this near to exact points [m]; half the lidar's noise
MAX_NOISE = 0.02  # points that scatter more than this about their own line are no line [m]
_MIN_RADIUS = 0.25
_STEP = 0.25  # nodes where arcs may meet are this far apart [m]
_DENSE = 0.05  # the line is measured at points this far apart [m]
_WINDOW = 0.30  # digitised points are smoothed within this to either side [m]
_CORNER_DEG = 12.0  # a sharper turn than this of a coarse polyline is a corner, always a node
_LINE_PIECE = 2.0  # longest straight piece [m]


@dataclass(frozen=True)
class FittedArc:
    """One arc: centre (y, z) [m], radius [m], angles counted like the section angle [rad]."""

    centre: tuple[float, float]
    radius: float
    start: float
    end: float


def fit_arcs(line: Array) -> tuple[list[FittedArc], float]:
    """Fit the fewest arcs that stay on the line, walked with rising section angle.

    Dynamic programming over nodes along the line: an arc runs from node to node, so that arcs meet;
    the fewest arcs within the tolerance win, among those the nearest. The tolerance is `TOLERANCE`,
    for digitised points three times their scatter.

    Args:
        line: Points (y, z) [m] in walking order (right, crown, left), shape (n, 2).

    Returns:
        The arcs and the largest distance of the line from them [m].

    Raises:
        ConfigError: The points scatter too much, or the line bends outward (no arc follows it).
    """
    dense, corners = _densify(line)
    nodes, noise = _nodes(line, dense, corners)
    if not noise <= MAX_NOISE:
        raise ConfigError(
            f"the points scatter by {1000 * noise:.0f} mm about their line, allowed {1000 * MAX_NOISE:.0f}"
        )
    at = _project_nodes(nodes, dense)
    tolerance = max(TOLERANCE, 3.0 * noise)
    count = len(nodes)
    cost = np.full(count, np.inf)
    cost[0] = 0.0
    before = np.zeros(count, dtype=int)
    found: dict[tuple[int, int], tuple[FittedArc, float]] = {}
    for j in range(1, count):
        for i in range(j - 1, -1, -1):
            if not np.isfinite(cost[i]):
                continue
            arc, off = _fit_one(nodes[i], nodes[j], dense[at[i] : at[j] + 1])
            if off > tolerance:
                continue
            # fewest arcs first; a sum of deviations far below one only breaks ties
            total = cost[i] + 1.0 + 0.1 * (off / tolerance) ** 2
            if total < cost[j]:
                cost[j], before[j] = total, i
                found[i, j] = arc, off
    if not np.isfinite(cost[-1]):
        reached = nodes[np.flatnonzero(np.isfinite(cost))[-1]]
        raise ConfigError(
            f"no arc follows the line beyond ({reached[0]:.2f}, {reached[1]:.2f}) m within "
            f"{1000 * tolerance:.0f} mm; a design line bends one way only, round the tunnel"
        )
    arcs: list[FittedArc] = []
    worst, j = 0.0, count - 1
    while j > 0:
        arc, off = found[int(before[j]), j]
        worst = max(worst, off)
        arcs[:0] = _pieces(arc)
        j = int(before[j])
    return arcs, worst


def _densify(line: Array) -> tuple[Array, Array]:
    """Points of the polyline at most `_DENSE` apart, and its corners, shape (k, 2)."""
    step = np.diff(line, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    parts = [
        a + (b - a) * np.linspace(0.0, 1.0, max(1, int(np.ceil(d / _DENSE))), endpoint=False)[:, None]
        for a, b, d in zip(line[:-1], line[1:], length, strict=True)
    ]
    turn = np.arctan2(
        step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0], np.sum(step[:-1] * step[1:], axis=1)
    )
    coarse = np.minimum(length[:-1], length[1:]) > 2 * _DENSE
    sharp = coarse & (np.abs(turn) > np.radians(_CORNER_DEG))
    return np.concatenate([*parts, line[-1:]]), line[1:-1][sharp]


def _nodes(line: Array, dense: Array, corners: Array) -> tuple[Array, float]:
    """Places where arcs may meet, smoothed where the points are dense, and the points' scatter [m]."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    stops = np.linspace(0.0, way[-1], max(2, int(np.ceil(way[-1] / _STEP)) + 1))
    nodes = np.stack([np.interp(stops, way, dense[:, k]) for k in (0, 1)], axis=-1)
    spacing = way[-1] / (len(line) - 1)
    if spacing > _WINDOW / 5:
        far = [np.min(np.hypot(*(corners - node).T), initial=np.inf) > _STEP / 4 for node in nodes]
        far[0] = far[-1] = True
        every = np.concatenate([nodes[np.array(far)], corners])
        order = np.argsort([int(np.argmin(np.hypot(*(dense - node).T))) for node in every], kind="stable")
        return every[order], 0.0
    smooth, left = [], []
    for node in nodes:
        near = line[np.hypot(*(line - node).T) < _WINDOW]
        if len(near) < 6:
            smooth.append(node)
            continue
        point, error = _local_fit(node, near)
        smooth.append(point)
        left.append(error)
    return np.array(smooth), float(np.median(left)) if left else 0.0


def _local_fit(node: Array, near: Array) -> tuple[Array, float]:
    """Put a node on the parabola through its neighbours; return it and their scatter about it [m]."""
    d = near - near.mean(axis=0)
    _, axes = np.linalg.eigh(d.T @ d)
    tangent, normal = axes[:, 1], axes[:, 0]
    u, v = d @ tangent, d @ normal
    bend = np.polynomial.polynomial.polyfit(u, v, 2)
    x = float((node - near.mean(axis=0)) @ tangent)
    error = v - np.polynomial.polynomial.polyval(u, bend)
    height = float(np.polynomial.polynomial.polyval(x, bend))
    return near.mean(axis=0) + x * tangent + height * normal, float(np.sqrt(np.mean(error**2)))


def _project_nodes(nodes: Array, dense: Array) -> Array:
    """Index of the dense point nearest each node, rising, shape (k,)."""
    nearest = np.array([int(np.argmin(np.hypot(*(dense - node).T))) for node in nodes])
    return np.maximum.accumulate(nearest)


def _fit_one(a: Array, b: Array, points: Array) -> tuple[FittedArc, float]:
    """Fit the arc from a to b, one free number: where on the chord's bisector its centre lies.

    With m the chord's middle and n its inward normal, |p - m|^2 - (c/2)^2 = 2 t (p - m).n holds on the
    circle about m + t n through both ends: linear in t.
    """
    chord = b - a
    half = float(np.hypot(*chord)) / 2
    middle = (a + b) / 2
    # walking with rising section angle turns clockwise in (y, z): inward is on the right hand
    inward = np.array([chord[1], -chord[0]]) / max(2 * half, 1e-12)
    d = points - middle
    left, slope = np.sum(d * d, axis=1) - half**2, 2.0 * (d @ inward)
    square = float(slope @ slope)
    limit = float(np.sqrt(max(LINE_RADIUS**2 - half**2, 0.0)))
    t = limit
    if square > 1e-18 and float(slope.sum()) < 0.0:  # the line bulges outward: an arc bends inward
        t = float(left @ slope) / square
        t = max(-limit, min(limit, t)) if np.isfinite(t) else limit
    centre = middle + t * inward
    radius = float(np.hypot(half, t))
    away = float(np.abs(np.hypot(*(points - centre).T) - radius).max())
    start = float(np.arctan2(a[1] - centre[1], -(a[0] - centre[0])))
    sweep = (float(np.arctan2(b[1] - centre[1], -(b[0] - centre[0]))) - start) % (2 * np.pi)
    if start < -np.pi / 2:
        start += 2 * np.pi  # the floor is the cut, as for the section angle
    if radius < _MIN_RADIUS or sweep > 1.9 * np.pi:
        away = np.inf
    return FittedArc((float(centre[0]), float(centre[1])), radius, start, start + sweep), away


def _pieces(arc: FittedArc) -> list[FittedArc]:
    """Cut a straight wall so that its pieces stay straight; leave other arcs whole."""
    length = arc.radius * (arc.end - arc.start)
    if arc.radius < LINE_RADIUS / 2 or length <= _LINE_PIECE:
        return [arc]
    count = int(np.ceil(length / _LINE_PIECE))
    a, b = (
        np.array(arc.centre) + arc.radius * np.array([-np.cos(angle), np.sin(angle)])
        for angle in (arc.start, arc.end)
    )
    ends = a + (b - a) * np.linspace(0.0, 1.0, count + 1)[:, None]
    return [_fit_one(p, q, np.stack([p, q]))[0] for p, q in pairwise(ends)]
