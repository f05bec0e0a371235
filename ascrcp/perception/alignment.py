"""Align the lidar's pan head to the lance it is mounted on: Scan -> Alignment (thesis 3.2).

The lidar sees the lance behind it. The thesis picks one point of joint 6 by hand and turns the head by
the angle between it and the x axis; here the lance's side is found in the plan view and a straight
line is fitted to it: it runs along joint 6, so its direction is the error of the pan zero.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Scan
from ascrcp.core.geometry import Array
from ascrcp.perception.project import echoes
from ascrcp.perception.survey import AlignmentParameters

_NEAR = 0.25  # nearer echoes are the head's own cover [m]; placeholder
_SLICE = 0.05  # slices along the lance [m]
_LINE = 0.01  # a slice counts for a direction where a point lies within this of its line [m]
_STEP_DEG = 0.05  # directions tried
_BAND = 0.03  # points this near the best line are fitted first [m]
_TUKEY = 4.0
_FLOOR = 0.001  # the fit is not believed to be finer than this [m]


@dataclass(frozen=True)
class Alignment:
    """Where the pan head's zero is.

    Attributes:
        pan_zero: Pan angle read when the head points along joint 6 [rad]; hand it to `project`.
        sigma: One standard deviation of it [rad].
        residual: Scatter of the lance's side about a straight line [m].
        length: Length of lance it was fitted to [m].
        points: Number of echoes it was fitted to.
    """

    pan_zero: float
    sigma: float
    residual: float
    length: float
    points: int


def align(scan: Scan, parameters: AlignmentParameters) -> Alignment:
    """Find the pan zero from the lance in the scan.

    Args:
        scan: A sweep whose lines look back along the lance as well as ahead.
        parameters: Where to look, what to believe.

    Returns:
        The pan zero, with its uncertainty.

    Raises:
        RecognitionError: No straight lance is seen, or it lies too far off to be a zero error.
    """
    points = echoes(scan)
    behind = points[
        (points[:, 0] < -_NEAR)
        & (points[:, 0] > -parameters.reach)
        & (np.abs(points[:, 1]) < parameters.aside)
        & (np.abs(points[:, 2]) < parameters.height)
    ]
    xy = behind[:, :2]
    if len(xy) < 20:
        raise RecognitionError(
            f"alignment: only {len(xy)} echoes within {parameters.reach:g} m behind the lidar; "
            "it does not see its lance"
        )
    angle, aside, length = _longest_line(xy, np.radians(parameters.max_zero_deg))
    if not length >= parameters.min_length:
        raise RecognitionError(
            f"alignment: no straight lance within {parameters.max_zero_deg:g} deg of joint 6; the longest "
            f"line behind the lidar is {length:.2f} m, needed {parameters.min_length:g} m"
        )
    angle, sigma, residual, used = _fit_side(xy, angle, aside)
    if not abs(angle) <= np.radians(parameters.max_zero_deg):
        raise RecognitionError(
            f"alignment: the lance lies {np.degrees(angle):.2f} deg off joint 6, "
            f"allowed {parameters.max_zero_deg:g} deg"
        )
    if not residual <= parameters.max_residual:
        raise RecognitionError(
            f"alignment: what is seen of the lance is not straight, it scatters by {1000 * residual:.0f} mm, "
            f"allowed {1000 * parameters.max_residual:.0f} mm"
        )
    return Alignment(angle, sigma, residual, length, used)


def _longest_line(xy: Array, limit: float) -> tuple[float, float, float]:
    """Find the line about the x direction that runs through most slices.

    Counting slices, not points, because the near end of the lance holds most points.

    Returns:
        Angle of the line [rad], its distance to the left of the lidar [m], length of the slices [m].
    """
    best = (0, 0.0, 0.0)
    for angle in np.arange(-limit, limit + 1e-9, np.radians(_STEP_DEG)):
        c, s = np.cos(angle), np.sin(angle)
        along, aside = xy[:, 0] * c + xy[:, 1] * s, xy[:, 1] * c - xy[:, 0] * s
        rail = np.floor(aside / _LINE).astype(np.int64)
        rail -= rail.min()
        row = np.floor(-along / _SLICE).astype(np.int64)
        row -= row.min()
        seen = np.unique(rail * (row.max() + 1) + row) // (row.max() + 1)
        count = np.bincount(seen)
        pair = count + np.append(count[1:], 0)  # a line may lie across the border of two rails
        k = int(pair.argmax())
        if pair[k] > best[0]:
            best = (int(pair[k]), float(angle), float((k + np.floor(aside.min() / _LINE) + 1) * _LINE))
    _, angle, aside = best
    c, s = np.cos(angle), np.sin(angle)
    on = np.abs(xy[:, 1] * c - xy[:, 0] * s - aside) < _LINE
    rows = np.unique(np.floor((xy[on, 0] * c + xy[on, 1] * s) / _SLICE))
    return angle, aside, len(rows) * _SLICE


def _fit_side(xy: Array, angle: float, aside: float) -> tuple[float, float, float, int]:
    """Fit the line by reweighted least squares, every metre of the lance alike.

    Returns:
        Angle and its standard deviation [rad], residual [m], points used.
    """
    scale = _BAND / _TUKEY
    used = 0
    sigma = residual = np.inf
    for _ in range(30):
        c, s = np.cos(angle), np.sin(angle)
        along, off = xy[:, 0] * c + xy[:, 1] * s, xy[:, 1] * c - xy[:, 0] * s - aside
        robust = np.maximum(0.0, 1.0 - (off / (_TUKEY * scale)) ** 2) ** 2
        on = robust > 0.0
        used = int(on.sum())
        if used < 10:
            break
        weight = robust * _evenly(along, on)
        middle = np.average(along, weights=weight)
        lever = along - middle
        information = float(np.sum(weight * lever**2))
        shift = float(np.average(off, weights=weight))
        turn = float(np.sum(weight * lever * off)) / information
        left = off - shift - turn * lever
        residual = float(np.sqrt(np.average(left**2, weights=weight)))
        sigma = float(np.sqrt(np.sum((weight * lever * left) ** 2))) / information
        angle, aside = angle + turn, aside + shift - turn * float(middle)
        narrower = max(_FLOOR, 1.4826 * float(np.median(np.abs(left[on]))))
        if abs(turn) < 1e-7 and abs(narrower - scale) < 1e-6:
            break
        scale = min(scale, narrower) if narrower < scale else scale
    return angle, sigma, residual, used


def _evenly(along: Array, on: NDArray[np.bool_]) -> Array:
    """Weights that make every slice of the lance count alike, shape (n,)."""
    row = np.floor(along / (4 * _SLICE)).astype(np.int64)
    row -= row.min()
    count = np.bincount(row, on)
    return np.where(on, 1.0 / np.maximum(count[row], 1.0), 0.0)
