"""How far doses leave the wall from the wanted surface, and how that changes with them: what they minimise.

The growth of the wall is linear in the doses, so the misfit, averaged over patches and over single cells, is
a quadratic, but for cells of which the excess alone counts: there it has a bend. Its slope is all that a
projected gradient needs.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.sparse import csr_matrix

from ascrcp.core.geometry import Array
from ascrcp.planning.deposition import SLOPE_SIGMA_M, wall_slope
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.target import Target

OVER_SHARE = 0.1  # of the tolerance, beyond which an excess weighs more; placeholder
LACK_SHARE = 0.5  # and beyond which a lack does at a second spraying; placeholder
HOPELESS_SHARE = 3.0  # of the tolerance: a lack that is left beyond it pulls no harder; placeholder
LEARNED_SHARE = 0.5  # of what a first spraying holds back on flanks a second still does; placeholder
WEIGHT_FLOOR = 0.25  # of a patch inside the part to spray: less has no mean worth meeting


class Misfit:
    """Squared distance of the wall from the wanted surface, by doses in metres of layer (m,).

    Args:
        matrix: Growth of each cell by dose [m/m], shape (cells, m).
        joined: Whether a dose's stretch goes on in the next one's, shape (m - 1,).
        target: Present and wanted surface.
        process: Patch, tolerance, weights.
        mask: Cells that count, shape (ns, na).
        exposed: Those whose lack counts too; of the others the excess alone.
        leave: How much thinner than wanted a further spraying may leave the wall [m], 0 at the first, shape
            (ns, na).
    """

    def __init__(
        self,
        matrix: csr_matrix,
        joined: NDArray[np.bool_],
        target: Target,
        process: ProcessParameters,
        mask: NDArray[np.bool_],
        exposed: NDArray[np.bool_],
        leave: Array,
    ) -> None:
        self._matrix, self._back, self._joined = matrix, csr_matrix(matrix.T), joined
        self._process, self._mask, self._exposed = process, mask, exposed
        self._is_second = bool(leave.any())
        need = find_need(target, process)
        held = held_back(target, process, self._is_second)
        self._need = need - leave - held * np.maximum(need, 0.0)
        cell = target.cell
        self._size = tuple(max(1, round(process.target.patch_m / c)) for c in cell)
        # arches and rock are surfaces of their own: an excess on one does not make up for a lack on the other
        self._sides = [mask & side for side in (target.arch, ~target.arch)]
        self._shares = [np.maximum(self._mean(side.astype(float)), WEIGHT_FLOOR) for side in self._sides]
        self._scale = cell[0] * cell[1] / (process.dose.pass_spacing_m * process.dose.point_spacing_m)
        self._weight = np.where(mask, 1.0, 0.0)
        self._fine = process.dose.fine * self._weight

    def weigh(self, u: Array) -> None:
        """Let patches weigh more that get too thick at these doses, for that cannot be taken off.

        At a second spraying, which none need follow, those too that stay too thin. But what stays far too
        thin is out of the jets' reach: its pull grows no further, or all about it would get too thick for it.
        """
        dose, cells = self._process.dose, self._miss(u)
        tolerance, patches = self._process.target.tolerance_m, self._patches(cells)
        bad = (patches > OVER_SHARE * tolerance) | (self._is_second & (patches < -LACK_SHARE * tolerance))
        most = HOPELESS_SHARE * tolerance
        self._weight = self._mask * np.where(bad, dose.over_weight, 1.0) * _within(most, -patches)
        self._fine = self._mask * dose.fine * _within(most, -cells)

    def slope(self, u: Array) -> Array:
        """Compute the slope at doses u, both shape (m,)."""
        miss, dose = self._miss(u), self._process.dose
        moves = self._exposed | (miss > 0.0)
        push = self._spread(self._weight * self._patches(miss)) + self._fine * miss
        pull = self._back @ (moves * push).ravel()
        step = np.where(self._joined, np.diff(u), 0.0)
        uneven = np.concatenate([[0.0], step]) - np.concatenate([step, [0.0]])
        return np.asarray(self._scale * pull + dose.smooth * uneven)

    def _miss(self, u: Array) -> Array:
        """How much too thick each cell gets [m], shape (ns, na)."""
        miss = (self._matrix @ u).reshape(self._need.shape) - self._need
        return np.asarray(np.where(self._exposed, miss, np.maximum(miss, 0.0)))

    def _patches(self, miss: Array) -> Array:
        """Average over the patch about every cell, shape (ns, na)."""
        means = np.zeros(miss.shape)
        for side, share in zip(self._sides, self._shares, strict=True):
            means += side * self._mean(side * miss) / share
        return means

    def _spread(self, values: Array) -> Array:
        """Apply the transpose of `_patches`."""
        spread = np.zeros(values.shape)
        for side, share in zip(self._sides, self._shares, strict=True):
            spread += side * self._mean(side * values / share)
        return spread

    def _mean(self, values: Array) -> Array:
        return np.asarray(uniform_filter(values, self._size, mode="constant"))


def find_need(target: Target, process: ProcessParameters) -> Array:
    """How much each cell lacks [m], shape (ns, na).

    What is too thick cannot be taken off: beyond the tolerance it does not make up for what is too thin
    beside it.
    """
    return np.asarray(np.maximum(target.offset - target.wanted, -process.target.tolerance_m))


def _within(most: float, lack: Array) -> Array:
    """Weights with which a quadratic's pull grows to a lack and no further, 1 below it."""
    return np.asarray(most / np.maximum(lack, most))


def held_back(target: Target, process: ProcessParameters, again: bool) -> Array:
    """Share of the wanted layer that is not laid, for what is too thick cannot be taken off, shape (ns, na).

    What a flank catches and throws back is known worse the more obliquely the jet meets it: the share grows
    with the square of the sine of the wall's slope, as the rebound by angle does. How deep the wall is that
    no scan saw is a guess. A second spraying has learned of both.

    Args:
        target: Present and wanted surface.
        process: The shares.
        again: Whether it is a second spraying.
    """
    dose, steep = process.dose, steepness(target)
    if again:
        return np.asarray(dose.hold_back + LEARNED_SHARE * dose.hold_back_slope * steep)
    held = dose.hold_back + dose.hold_back_slope * steep + dose.hold_back_guess * target.guessed
    return np.asarray(np.minimum(held, 1.0))


def steepness(target: Target) -> Array:
    """Compute sin^2 of the rock's slope against the design line, 0 on arches, shape (ns, na)."""
    steep = (wall_slope(target, target.offset, SLOPE_SIGMA_M) ** 2).sum(axis=1).reshape(target.offset.shape)
    return np.asarray(steep / (1.0 + steep))


def descend(gradient: Callable[[Array], Array], highest: Array, start: Array, iterations: int) -> Array:
    """Minimise what is nearly a convex quadratic within 0..highest by an accelerated projected gradient.

    Args:
        gradient: Its gradient at u (m,).
        highest: Upper bounds, shape (m,).
        start: Where to begin, shape (m,).
        iterations: Steps.
    """
    if not len(highest):
        return highest
    zero = gradient(np.zeros(len(highest)))
    probe = np.ones(len(highest))
    bound = 1.0
    for _ in range(12):  # power iteration: the largest curvature
        turned = gradient(probe) - zero
        bound = float(np.linalg.norm(turned) / np.linalg.norm(probe))
        probe = turned / np.linalg.norm(turned)
    u = start
    ahead, momentum = u, 1.0
    for _ in range(iterations):
        step = np.clip(ahead - gradient(ahead) / (1.05 * bound), 0.0, highest)
        following = (1.0 + np.sqrt(1.0 + 4.0 * momentum**2)) / 2.0
        if ((step - u) * (ahead - step)).sum() > 0.0:  # restart where the momentum points uphill
            following = 1.0
        ahead = step + (momentum - 1.0) / following * (step - u) if following > 1.0 else step
        u, momentum = step, following
    return u
