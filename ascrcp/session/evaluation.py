"""Judge a run: true nozzle against reference at the same instant, every 20 ms while spraying.

Thesis 6.2.4, eq. 6-1, and its rule: 100 mm and 5 deg at the nozzle. On a machine without a tracker
the measured nozzle stands in for the truth, and the result says so.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ascrcp.core.geometry import Array, angle_between

RULE_MM = 100.0  # thesis 5.4, 6.2.4
RULE_DEG = 5.0


@dataclass(frozen=True)
class RunTrace:
    """What the run recorded, one row per cycle while following.

    Attributes:
        t: Job time [s], shape (m,).
        reference: Wanted nozzle position [m] and unit spray direction, shape (m, 6).
        nozzle: Nozzle that is judged (the rig's truth, or as measured), shape (m, 6).
        measured: Nozzle from the sensors, shape (m, 6).
        spraying: Whether concrete flowed, shape (m,).
        point: Planned point passed in this cycle, -1 if none, shape (m,).
        q_error: Joint error by the sensors, SI, shape (m, joints).
        from_truth: Whether `nozzle` is the rig's truth.
    """

    t: Array
    reference: Array
    nozzle: Array
    measured: Array
    spraying: Array
    point: Array
    q_error: Array
    from_truth: bool


def position_error_mm(trace: RunTrace) -> Array:
    """Nozzle distance from the reference at the same instant [mm], eq. 6-1, shape (m,)."""
    return 1e3 * np.linalg.norm(trace.nozzle[:, :3] - trace.reference[:, :3], axis=1)


def angle_error_deg(trace: RunTrace) -> Array:
    """Angle between the spray directions at the same instant [deg], shape (m,)."""
    return np.degrees(angle_between(trace.nozzle[:, 3:], trace.reference[:, 3:]))


def cross_track_mm(trace: RunTrace, reach: int = 50) -> Array:
    """Nozzle distance from the reference path itself, whatever the instant [mm], shape (m,).

    Args:
        trace: The run.
        reach: How many cycles before and after are searched; one second.
    """
    best = np.full(len(trace.t), np.inf)
    p, ref = trace.nozzle[:, :3], trace.reference[:, :3]
    for shift in range(-reach, reach):
        index = np.clip(np.arange(len(p)) + shift, 0, len(p) - 1)
        a, b = ref[index], ref[np.clip(index + 1, 0, len(p) - 1)]
        ab = b - a
        along = ((p - a) * ab).sum(1) / np.maximum((ab * ab).sum(1), 1e-18)
        near = a + np.clip(along, 0.0, 1.0)[:, None] * ab
        best = np.minimum(best, np.linalg.norm(p - near, axis=1))
    return 1e3 * best


def evaluate(trace: RunTrace) -> dict[str, Any]:
    """Summarise a run as plain values (design.md section 9).

    Returns:
        nozzle_error_mm, nozzle_error_deg, cross_track_mm with mean, p95, max over the spraying
        cycles; at_points with the same over the planned points; joint_error with mean and max.
    """
    spraying = trace.spraying.astype(bool)
    mm, deg = position_error_mm(trace), angle_error_deg(trace)
    at_points = trace.point >= 0
    return {
        "nozzle_error_mm": _summary(mm[spraying]),
        "nozzle_error_deg": _summary(deg[spraying]),
        "cross_track_mm": _summary(cross_track_mm(trace)[spraying]),
        "axis_error_mm": {
            name: _summary(1e3 * np.abs(trace.nozzle[spraying, i] - trace.reference[spraying, i]))
            for i, name in enumerate("xyz")
        },
        "at_points": {
            "count": int(at_points.sum()),
            "error_mm": _summary(mm[at_points]),
            "error_deg": _summary(deg[at_points]),
            "within_rule": int(((mm <= RULE_MM) & (deg <= RULE_DEG))[at_points].sum()),
        },
        "joint_error": [_summary(np.abs(column)) for column in trace.q_error[spraying].T],
        "from_truth": trace.from_truth,
    }


def _summary(values: Array) -> dict[str, float | None]:
    if not len(values):
        return {"mean": None, "p95": None, "max": None}
    return {
        "mean": float(values.mean()),
        "p95": float(np.percentile(values, 95)),
        "max": float(values.max()),
    }
