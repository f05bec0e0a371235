"""A leg of the muck job: postures -> joints over time, through all of them without a stop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator, make_interp_spline

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm

SAMPLES = 21
"""Places of a piece between two postures at which its rates are looked at."""

ROUNDS, GAIN = 60, 0.3
"""Rounds of fitting the pieces' times, and how much of each correction is made."""

CUTS = 2, 3, 4
"""Pieces a way from posture to posture is cut into, monotone in every joint, so that no spline swings far
out; the fastest cut within the ranges is taken."""

SHORTEST_S = 0.05
"""Shortest time of a piece [s]."""

OVERSHOOT = 0.02
"""How far a way may swing beyond a range between its poses before it is refused [rad, m]; it is cut."""


@dataclass(frozen=True)
class Leg:
    """Rows of a motion from rest to rest.

    Attributes:
        name: What it does.
        t: Times from its start [s], shape (m,).
        q: Joints [rad, m], shape (m, joints).
    """

    name: str
    t: Array
    q: Array


def time_leg(arm: Arm, name: str, q: Array, row_s: float, share: float) -> Leg:
    """Travel through postures without stopping, every limit of speed, acceleration and jerk kept.

    A quintic spline at rest at both ends; the time of every piece is stretched or shortened until each one
    takes what the limits allow, then all together by what the worst still lacks.

    Args:
        arm: For its largest speeds, accelerations and jerks.
        name: What the leg does.
        q: Postures [rad, m], shape (m, joints), m >= 2.
        row_s: Longest time between rows [s].
        share: Of every limit.
    """
    limits = (arm.max_speed, arm.max_acceleration, arm.max_jerk)
    through = PchipInterpolator(np.arange(len(q)), q)
    best: Leg | None = None
    for cut in CUTS:
        t, rows = _fit_times(
            through(np.linspace(0, len(q) - 1, cut * (len(q) - 1) + 1)), limits, row_s, share
        )
        if arm.within_limits(rows, OVERSHOOT).all() and (best is None or t[-1] < best.t[-1]):
            best = Leg(name, t, np.clip(rows, arm.lower, arm.upper))
    if best is None:
        raise UnreachableError(f"{arm.name}: the way of '{name}' leaves the joints' ranges between its poses")
    return best


def _fit_times(q: Array, limits: Sequence[Array], row_s: float, share: float) -> tuple[Array, Array]:
    """Fit the times of the pieces between postures (m, joints); rows' times and joints."""
    piece = np.maximum((np.abs(np.diff(q, axis=0)) / limits[0]).max(axis=1), SHORTEST_S)
    best, duration = piece, np.inf
    for _ in range(ROUNDS):
        need = _find_needs(_spline(piece, q), piece, limits, share)
        if piece.sum() * need.max() < duration:  # stretched by that, every limit holds
            best = piece * need.max()
            duration = float(best.sum())
        piece = np.maximum(piece * np.clip(need, 0.5, 2.0) ** GAIN, SHORTEST_S)
    t = np.linspace(0.0, duration, int(np.ceil(duration / row_s)) + 1)
    return t, np.asarray(_spline(best, q)(t))


def _spline(piece: Array, q: Array) -> BSpline:
    t = np.concatenate([[0.0], np.cumsum(piece)])
    rest = [(1, np.zeros(q.shape[1])), (2, np.zeros(q.shape[1]))]
    return make_interp_spline(t, q, k=5, bc_type=(rest, rest))


def _find_needs(curve: BSpline, piece: Array, limits: Sequence[Array], share: float) -> Array:
    """Find by what factor each piece must be stretched to keep the limits, shape (pieces,)."""
    ends = np.concatenate([[0.0], np.cumsum(piece)])
    t = ends[:-1, None] + piece[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    need = np.zeros(len(piece))
    for order, limit in enumerate(limits, start=1):
        rate = np.abs(curve(t, order)) / (share * limit)
        need = np.maximum(need, rate.max(axis=(1, 2)) ** (1.0 / order))
    return need
