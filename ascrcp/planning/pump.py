"""Let the pump follow the nozzle: a timed sequence and its path -> the flow of every row."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import Array
from ascrcp.planning.process import SprayParameters


def fill_flow(sequence: JointSequence, path: SprayPath, spray: SprayParameters) -> JointSequence:
    """Set the flow of every spraying row so that the path lays what was planned, however slow the arm is.

    On leaving a point the plan wants a flow at a nozzle speed; where the row is slower (ramps, joints at
    their limit) the flow falls with it, and below what the pump can hold it stands or holds its least,
    whichever is nearer. A path that leaves the speed to the timing keeps its flow. What the nozzle wants
    at an instant is asked of the pump by its lag earlier.

    Args:
        sequence: Timed rows.
        path: Speed and flow wanted on leaving each point.
        spray: What the pump can hold.
    """
    rows = len(sequence.t)
    at = np.where(sequence.point >= 0, np.arange(rows), -1)
    last = np.maximum.accumulate(at)
    leaving = np.where(last >= 0, sequence.point[np.maximum(last, 0)], 0)
    way = np.linalg.norm(np.diff(sequence.position, axis=0), axis=1)
    speed = np.append(way / np.diff(sequence.t), 0.0) if rows > 1 else np.zeros(rows)
    wanted = path.speed[leaving]
    share = np.where(wanted > 0.0, np.minimum(speed / np.where(wanted > 0.0, wanted, 1.0), 1.0), 1.0)
    flow = hold_least(path.flow[leaving] * share, spray)
    flow = np.where(sequence.spraying & (last >= 0), flow, 0.0)
    ahead = np.searchsorted(sequence.t, sequence.t + spray.pump_lag_s, side="right") - 1
    return replace(sequence, flow=np.where(sequence.spraying, flow[ahead], 0.0))


def hold_least(flow: Array, spray: SprayParameters) -> Array:
    """Keep flows the pump can hold; smaller ones become its least or nothing."""
    least = spray.pump_least
    return np.asarray(np.where(flow < least / 2.0, 0.0, np.where(flow < least, least, flow)))


def laid_amount(
    sequence: JointSequence, first: NDArray[np.int64], length: Array, points: int, spray: SprayParameters
) -> Array:
    """Concrete the rows pump on each stretch, per metre of way [m3/m], shape (m,).

    Args:
        sequence: Rows with their flow.
        first: Point each stretch begins at, shape (m,).
        length: Way of each stretch [m], shape (m,).
        points: Number of planned points.
        spray: The pump's largest flow, and its lag.
    """
    rows = len(sequence.t)
    last = np.maximum.accumulate(np.where(sequence.point >= 0, np.arange(rows), -1))
    leaving = np.where(last >= 0, sequence.point[np.maximum(last, 0)], 0)
    before = np.searchsorted(sequence.t, sequence.t - spray.pump_lag_s, side="right") - 1
    flow = np.where(before >= 0, sequence.flow[np.maximum(before, 0)], 0.0)
    volume = flow[:-1] * np.diff(sequence.t) * spray.pump_m3_s
    return np.asarray(np.bincount(leaving[:-1], volume, minlength=points)[first] / length)
