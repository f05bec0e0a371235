"""How near a wall comes to the wanted surface, patch by patch: offsets + Target -> Finish."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.planning.process import TargetParameters
from ascrcp.planning.target import Left, Target, mean_finish


@dataclass(frozen=True)
class Finish:
    """Finish of a predicted or scanned wall; lengths in metres.

    Attributes:
        value: Mean distance of each patch from the wanted surface, outward (too thin) positive, NaN where
            not judged, shape (ns, na).
        within: Share of the judged area within the tolerance.
        too_thin: Share that lacks more than it.
        thinnest: Largest lack of a patch, 0 if none lacks.
        thickest: Largest excess of a patch, 0 if none has.
        deviation: Standard deviation.
        area: Judged area [m2].
    """

    value: Array
    within: float
    too_thin: float
    thinnest: float
    thickest: float
    deviation: float
    area: float

    def to_dict(self) -> dict[str, float]:
        """Return plain values for files; millimetres where the key says so."""
        return {
            "within_tolerance": self.within,
            "too_thin": self.too_thin,
            "finish_std_mm": 1e3 * self.deviation,
            "thinnest_mm": 1e3 * self.thinnest,
            "thickest_mm": 1e3 * self.thickest,
            "area_m2": self.area,
        }


def judge_finish(
    offset: Array, target: Target, covered: NDArray[np.bool_], parameters: TargetParameters
) -> Finish:
    """Average what is left of a wall before the wanted surface over patches, and sum it up.

    Args:
        offset: The wall [m], NaN where unknown, shape (ns, na).
        target: Grid and wanted surface.
        covered: Cells that count, as far as they are inside, away from the ends and not beneath a flange,
            shape (ns, na).
        parameters: Patch, tolerance, corners.
    """
    along = target.station[_sprayed_rows(target)]
    covered = covered & target.inside & ~target.beneath & np.isfinite(offset)
    if len(along):
        first, last = along[0] + parameters.corner_m, along[-1] - parameters.corner_m
        covered &= ((target.station > first) & (target.station < last))[:, None]
    value = mean_finish(offset - target.wanted, covered, target, parameters.patch_m)
    judged = np.isfinite(value)
    each, area = value[judged], target.area[judged]
    total = max(float(area.sum()), 1e-9)
    mean = float((each * area).sum()) / total
    return Finish(
        value=value,
        within=float(area[np.abs(each) <= parameters.tolerance_m].sum()) / total,
        too_thin=float(area[each > parameters.tolerance_m].sum()) / total,
        thinnest=float(np.max(each, initial=0.0)),
        thickest=float(-np.min(each, initial=0.0)),
        deviation=float(np.sqrt((area * (each - mean) ** 2).sum() / total)),
        area=float(area.sum()),
    )


def _sprayed_rows(target: Target) -> NDArray[np.bool_]:
    """Mark the rows of the part to be sprayed, shape (ns,)."""
    return np.asarray((target.left != Left.OUTSIDE).any(axis=1))
