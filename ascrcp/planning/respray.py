"""What a further spraying is to lay: Target + the surface a scan found -> Respray.

What is too thick cannot be taken off, so a further spraying leaves the wall a little too thin. How thin, and
which patches are worth a stroke, follows from the concrete: what the wall still lacks as a whole is laid, but
for a reserve, the thinnest patches first.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from ascrcp.core.errors import InputError, NothingToSprayError
from ascrcp.core.geometry import Array
from ascrcp.planning.misfit import find_need
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.target import Left, Target, mean_finish

LEAST_SHARE = 0.2  # of the tolerance: a patch that lacks less is never sprayed again; placeholder
LEAVE_SHARE = 0.7  # of what a patch must lack to be sprayed: so much thinner it is left; placeholder
LEAVE_BEYOND = 0.2  # the same for one that lacks more than the tolerance; placeholder
SPILL = 1.1  # concrete laid over what the thin patches take: the jet is wider than they; placeholder
HALVINGS = 30  # of the interval in which the lack is sought


@dataclass(frozen=True)
class Respray:
    """What a further spraying is to do.

    Attributes:
        target: Present surface as the scan found it, and the surface wanted.
        thin: Cells whose patch lacks enough to be sprayed, shape (ns, na).
        leave: How much thinner than wanted the wall is left [m], shape (ns, na).
    """

    target: Target
    thin: NDArray[np.bool_]
    leave: Array


def find_respray(
    target: Target, after: Array, unsprayed: tuple[float, float], process: ProcessParameters
) -> Respray:
    """Find the patches to be sprayed again and how thin they may stay.

    Every patch that lacks more than the tolerance is sprayed; those that lack less as long as the wall as a
    whole lacks more than the reserve.

    Args:
        target: Before any spraying.
        after: Offset of the wall found [m], NaN where not seen, shape (ns, na).
        unsprayed: First and last station of the part to spray [m].
        process: Tolerance, patch, reserve.

    Raises:
        InputError: The scan saw none of the wall.
        NothingToSprayError: No patch lacks enough.
    """
    now = renew(target, after, unsprayed, process.target.corner_m)
    need = find_need(now, process)
    lack = np.nan_to_num(mean_finish(need, now.inside, now, process.target.patch_m), nan=-np.inf)
    if not np.isfinite(lack).any():
        raise InputError("the further scan shows none of the wall to be sprayed: scan it again")
    tolerance = process.target.tolerance_m
    least = _choose_lack(now, lack, find_budget(target, after, process), tolerance)
    thin = lack > least
    if not thin.any():
        raise NothingToSprayError(
            f"nothing left to spray: every patch of {process.target.patch_m:g} m lacks less than "
            f"{1e3 * least:.0f} mm"
        )
    return Respray(now, _widen(thin, now, process), _leave(lack, least, tolerance))


def renew(target: Target, after: Array, unsprayed: tuple[float, float], corner: float) -> Target:
    """Put the surface a further scan found in place of the present one.

    What it did not see is left out, and so are the corners at the ends, where face and step are seen.
    """
    middle = (target.station > unsprayed[0] + corner) & (target.station < unsprayed[1] - corner)
    seen = np.isfinite(after) & middle[:, None]
    left = target.left.copy()
    left[(left == Left.NOT) & ~seen] = Left.UNSEEN
    offset = np.where(seen, after, target.wanted)
    rock = np.where(target.arch, target.rock, offset)
    return replace(target, offset=offset, rock=rock, left=left)


def find_budget(target: Target, after: Array, process: ProcessParameters) -> float:
    """Concrete that may still be laid [m3]: what the rock that was seen lacks, but for the reserve."""
    seen = np.isfinite(after) & target.inside & ~target.arch
    laid = np.where(seen, target.offset - after, 0.0)
    wanted = target.volume(target.offset - target.wanted)[seen].sum()
    reserve = process.dose.reserve * target.volume(target.thickness)[seen].sum()
    return float(wanted - target.volume(laid)[seen].sum() - reserve)


def _choose_lack(target: Target, lack: Array, budget: float, tolerance: float) -> float:
    """Choose what a patch must lack to be sprayed [m], so that all of them take the budget [m3].

    Between a share of the tolerance, if the budget is larger than all patches take, and the tolerance.
    """
    area = np.where(target.inside & ~target.beneath, target.area, 0.0)

    def taken(least: float) -> float:
        layer = np.where(lack > least, lack - _leave(lack, least, tolerance), 0.0)
        return SPILL * float((area * layer).sum())

    few, many = tolerance, LEAST_SHARE * tolerance
    if taken(many) <= budget:
        return many
    for _ in range(HALVINGS):
        middle = (few + many) / 2.0
        few, many = (few, middle) if taken(middle) > budget else (middle, many)
    return few


def _leave(lack: Array, least: float, tolerance: float) -> Array:
    """How much thinner than wanted cells are left [m], by what their patches lack [m], shape (ns, na).

    Never more than they lack: what falls on wall that is right would count as an excess that it is not.
    """
    share = np.where(lack > tolerance, LEAVE_BEYOND, LEAVE_SHARE)
    return np.asarray(np.clip(lack, 0.0, share * least))


def _widen(thin: NDArray[np.bool_], target: Target, process: ProcessParameters) -> NDArray[np.bool_]:
    """Widen thin places along the axis so that each holds a pass: passes lie where those of the bay do."""
    half = round(process.dose.pass_spacing_m / 2.0 / target.cell[0])
    rock = ~target.arch  # an arch has one pass of its own
    return np.asarray(thin | (rock & binary_dilation(thin & rock, np.ones((2 * half + 1, 1)))))
