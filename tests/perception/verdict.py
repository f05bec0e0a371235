"""Compare what was recognised with a synthetic heading's truth: the figures the tests and benches judge."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from synthetic_heading import Truth

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile


@dataclass
class Verdict:
    """Errors of one recognition; lists name what is missing or wrong."""

    axis_deg: float
    axis_mm: float  # lateral, in the middle of the unsprayed part
    unsprayed_m: float
    station_mm: list[float] = field(default_factory=list)
    lean_deg: list[float] = field(default_factory=list)
    missed_arches: list[float] = field(default_factory=list)
    false_arches: list[float] = field(default_factory=list)
    missed_pockets: list[tuple[float, float]] = field(default_factory=list)
    false_regions: list[dict[str, Any]] = field(default_factory=list)


def axis_error(features: dict[str, Any], truth: Truth) -> tuple[float, float]:
    """Angle [deg], and lateral distance in the middle of the unsprayed part [mm]."""
    d = np.array(features["axis"]["direction"])
    angle = np.degrees(2 * np.arcsin(np.linalg.norm(d - truth.direction) / 2))
    w = truth.point + truth.direction * np.mean(truth.unsprayed) - np.array(features["axis"]["point"])
    return float(angle), float(1000 * np.linalg.norm(w - d * (w @ d)))


def judge(features: dict[str, Any], truth: Truth, profile: Profile, limit_m: float = 0.05) -> Verdict:
    """Match arches within `limit_m` of their station, pockets and regions by overlap."""
    angle, lateral = axis_error(features, truth)
    ends = np.abs(np.array(features["unsprayed"]) - truth.unsprayed)
    verdict = Verdict(angle, lateral, float(ends.max()))
    found = list(features["arches"])
    for station, lean in truth.arches:
        near = min(found, key=lambda a: abs(a["station"] - station), default=None)
        if near is None or not abs(near["station"] - station) <= limit_m:
            verdict.missed_arches.append(station)
            continue
        found.remove(near)
        verdict.station_mm.append(1000 * (near["station"] - station))
        verdict.lean_deg.append(near["lean_deg"] - lean)
    verdict.false_arches = [a["station"] for a in found]
    _judge_pockets(verdict, features, truth, profile)
    return verdict


def _judge_pockets(verdict: Verdict, features: dict[str, Any], truth: Truth, profile: Profile) -> None:
    hit = [False] * len(features["overbreak"])
    for pocket, seen in zip(truth.pockets, truth.pocket_seen, strict=True):
        over = [_overlaps(region, pocket, profile) for region in features["overbreak"]]
        if seen >= 0.2 and not any(over):
            verdict.missed_pockets.append((pocket[0], seen))
        hit = [a or b for a, b in zip(hit, over, strict=True)]
    verdict.false_regions = [
        region
        for region, h in zip(features["overbreak"], hit, strict=True)
        if not h and region["area_m2"] >= 0.2
    ]


def _overlaps(region: dict[str, Any], pocket: tuple[float, ...], profile: Profile) -> bool:
    angle: Array = np.degrees(profile.angle(np.array([pocket[1] - pocket[3], pocket[1] + pocket[3]])))
    (s0, s1), (a0, a1) = region["station"], region["angle_deg"]
    return bool(s0 < pocket[0] + pocket[2] and s1 > pocket[0] - pocket[2] and a0 < angle[1] and a1 > angle[0])
