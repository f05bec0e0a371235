"""Choose how much concrete every stretch of the path lays: Lines + Target -> Dose.

The growth of the wall is linear in the volumes laid, so the doses that bring the wall, averaged over
patches, nearest to the wanted surface are found by a projected gradient on the sparse footprint matrix.
Patches alone would allow any pattern whose mean over a patch is right, so single cells count too.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, hstack

from ascrcp.core.geometry import Array
from ascrcp.planning.coverage import Lines
from ascrcp.planning.deposition import Jet, deposit, rebound
from ascrcp.planning.layer import limit_layer
from ascrcp.planning.misfit import Misfit, descend, steepness
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.target import Left, Target, mean_patch

SAMPLES = (0.25, 0.75)  # of a stretch where its jet stands: 0.1 m apart, less than the footprint's deviation
LEAST_LENGTH_M = 0.02  # a stretch on which the nozzle only turns
EXPOSED = 0.45  # of what even passes give a wall: with less it cannot be brought to the target; placeholder
RESPRAYED = 0.35  # the same at a further spraying, whose strokes lie alone; placeholder
SHADOW_M = 0.25  # so near an arch what no jet exposes lies in its shadow: flanges, oblique jets
STEEP_DEG = 45.0  # a flank steeper than this catches too little of a jet square to the bay; placeholder
LAYER_SLACK = 1.5  # a stretch may lay so much more than its share of the layer limit: its neighbours lay less
LEAST_YIELD = 0.3  # a stretch that loses more is not driven harder; placeholder
MOVED_M = 0.03  # a wall that differs by less gives the same footprint
MOVED_SHARE = 0.05  # of a footprint that must fall on wall that differs, to reckon it anew
THINNINGS = 4  # of doses whose strokes together lay more than stays up
LIMIT_SLACK = 0.05  # of the layer limit: rows and pump hold a dose no better; placeholder
ROUNDS = 3  # of weighting the excess: the set of patches that have one hardly changes any more


@dataclass(frozen=True)
class Stretches:
    """Stretches from point to point of the passes, m of them, and what a dose on each does to the wall.

    Attributes:
        first: Index of the point each begins at, shape (m,).
        length: Way of the nozzle [m], shape (m,).
        growth: Growth of each cell per metre of way and m3/m laid [m / (m3/m)], shape (cells, m).
    """

    first: NDArray[np.int64]
    length: Array
    growth: csr_matrix


@dataclass(frozen=True)
class Dose:
    """What the stretches lay.

    Attributes:
        stretches: The stretches.
        amount: Concrete pumped per metre of way [m3/m], shape (m,).
    """

    stretches: Stretches
    amount: Array

    @property
    def volume(self) -> float:
        """Concrete pumped [m3]."""
        return float(self.amount @ self.stretches.length)

    def layer(self, target: Target) -> Array:
        """Growth of the wall [m], shape (ns, na)."""
        return np.asarray((self.stretches.growth @ self.amount).reshape(target.offset.shape))


def find_stretches(
    lines: Lines,
    jet: Jet,
    reached: NDArray[np.bool_],
    target: Target,
    walls: dict[int, Array],
    process: ProcessParameters,
    progress: Callable[[float], None] | None = None,
) -> Stretches:
    """Find the stretches between reached points of one pass and reckon their footprints.

    Args:
        lines: All points, for pass and layer.
        jet: The points as they will be driven, shape of lines.
        reached: Points that are sprayed, shape (n,).
        target: Grid.
        walls: The wall each layer is sprayed onto, by layer [m], shape (ns, na) each.
        process: Jet and rebound.
        progress: Called with the fraction done.
    """
    same = (lines.pass_index[1:] == lines.pass_index[:-1]) & reached[1:] & reached[:-1]
    first = np.flatnonzero(same)
    length = np.linalg.norm(jet.position[first + 1] - jet.position[first], axis=1)
    length = np.maximum(length, LEAST_LENGTH_M)
    parts, order = [], []
    kinds = np.unique(lines.layer[first])[::-1]
    for number, layer in enumerate(kinds.tolist()):
        if progress is not None:
            progress(number / len(kinds))
        mine = np.flatnonzero(lines.layer[first] == layer)
        parts.append(_lay_out(jet, first[mine], target, walls[layer], process))
        order.append(mine)
    if not parts:
        return Stretches(first, length, csr_matrix((target.offset.size, 0)))
    growth = hstack(parts).tocsc()[:, np.argsort(np.concatenate(order))]
    return Stretches(first, length, csr_matrix(growth.multiply(length[None, :])))


def _lay_out(
    jet: Jet, first: NDArray[np.int64], target: Target, wall: Array, process: ProcessParameters
) -> csr_matrix:
    """Reckon what stretches lay on a wall per volume pumped [m/m3], shape (cells, k)."""
    each = [deposit(_between(jet, first, share), target, wall, process) for share in SAMPLES]
    return sum(each[1:], start=each[0]) * (1.0 / len(SAMPLES))


def renew_stretches(
    stretches: Stretches,
    amount: Array,
    lines: Lines,
    jet: Jet,
    target: Target,
    walls: dict[int, Array],
    process: ProcessParameters,
) -> Stretches:
    """Reckon anew, pass after pass, the footprints that fall where the doses build another wall.

    Flanks take less of a layer than the bottom of a pocket: what comes after meets them steeper than if
    every layer filled its share everywhere, and more of it is thrown back.

    Args:
        stretches: As reckoned.
        amount: Doses by which the wall grows [m3/m], shape (m,).
        lines: The points, for pass and layer.
        jet: The points as they will be driven, shape of lines.
        target: Grid, and the wall before all of them.
        walls: The wall each layer was reckoned on, by layer [m], shape (ns, na) each.
        process: Jet and rebound.
    """
    if not len(stretches.first):
        return stretches
    number = lines.pass_index[stretches.first]
    begin = np.flatnonzero(np.diff(number, prepend=-1)).tolist()
    columns, parts = stretches.growth.tocsc(), []
    built = np.zeros(target.offset.size)
    for first, last in zip(begin, [*begin[1:], len(number)], strict=True):
        growth, mine = columns[:, first:last], amount[first:last]
        layer = (built + growth @ mine / 2.0).reshape(target.offset.shape)  # as it stands half way
        wall = np.where(target.arch, target.offset, target.offset - layer)
        before = walls[int(lines.layer[stretches.first[first]])]
        moved = (np.abs(wall - before) > MOVED_M).astype(float).ravel()
        hit = np.asarray(growth.T @ moved) > MOVED_SHARE * np.asarray(growth.sum(axis=0)).ravel()
        if hit.any():
            rows = first + np.flatnonzero(hit)
            again = _lay_out(jet, stretches.first[rows], target, wall, process)
            again = again.multiply(stretches.length[rows][None, :]).tocsc()
            growth = hstack([growth[:, ~hit], again]).tocsc()[:, np.argsort(np.argsort(hit, kind="stable"))]
        parts.append(growth)
        built += growth @ mine
    return replace(stretches, growth=csr_matrix(hstack(parts)))


def _between(jet: Jet, first: NDArray[np.int64], share: float) -> Jet:
    position = (1.0 - share) * jet.position[first] + share * jet.position[first + 1]
    direction = (1.0 - share) * jet.direction[first] + share * jet.direction[first + 1]
    return Jet(position, direction / np.linalg.norm(direction, axis=1, keepdims=True))


def find_exposed(
    stretches: Stretches, lines: Lines, target: Target, process: ProcessParameters, again: bool
) -> NDArray[np.bool_]:
    """Find the cells the last layer can bring to the target, shape (ns, na)."""
    first = stretches.first
    # per metre of wall: where the nozzle hardly moves as it turns, a short way sprays much
    wall = np.linalg.norm(lines.wall[first + 1] - lines.wall[first], axis=1)
    last = np.where(lines.layer[first] == 1, wall / stretches.length, 0.0)
    exposure = (stretches.growth @ last).reshape(target.offset.shape)
    upward, square, best = target.profile.normal(target.along)[:, 1], np.ones(1), process.rebound.best_m
    lost = rebound(upward, square, np.full(1, best), process.rebound)
    even = (1.0 - lost) / process.dose.pass_spacing_m
    enough = exposure >= (RESPRAYED if again else EXPOSED) * even
    return np.asarray(enough & ~np.isin(target.left, (Left.OUTSIDE, Left.UNSEEN, Left.BEFORE)))


def solve_dose(
    stretches: Stretches,
    lines: Lines,
    target: Target,
    process: ProcessParameters,
    mask: NDArray[np.bool_],
    exposed: NDArray[np.bool_],
    leave: Array,
    start: Array | None = None,
    rounds: int = ROUNDS,
) -> Dose:
    """Find the doses that bring the wall nearest to the wanted surface, patch by patch (`Misfit`).

    Args:
        stretches: Footprints.
        lines: The points, for pass and layer.
        target: Present and wanted surface.
        process: Patch, layer limit, evenness.
        mask: Cells that count, shape (ns, na).
        exposed: Those of them whose lack counts too: of the others, which no pass can fill, the excess alone,
            or what is beside them would be sprayed too thick in their stead.
        leave: How much thinner than wanted a further spraying may leave the wall [m], 0 at the first, shape
            (ns, na).
        start: Doses to begin with [m3/m], shape (m,); None for none.
        rounds: Of weighting the excess; without any the doses to begin with are only held within bounds.
    """
    unit = process.dose.pass_spacing_m  # a dose of one metre's layer: its width times one metre
    joined = np.diff(stretches.first) == 1
    joined &= lines.pass_index[stretches.first[1:]] == lines.pass_index[stretches.first[:-1]]
    misfit = Misfit(csr_matrix(stretches.growth * unit), joined, target, process, mask, exposed, leave)
    highest = _highest(stretches, lines, target, process) / unit
    if start is None:
        amount = descend(misfit.slope, highest, np.zeros(len(highest)), process.dose.iterations)
    else:
        amount = np.minimum(start / unit, highest)
    for _ in range(rounds):
        misfit.weigh(amount)
        amount = descend(misfit.slope, highest, amount, process.dose.iterations)
    for _ in range(THINNINGS if rounds else 0):
        over = _over_limit(stretches, amount * unit, lines, target, process)
        if not (over > 1.0 + LIMIT_SLACK).any():
            break
        highest = np.where(over > 1.0, np.minimum(highest, amount / np.maximum(over, 1.0)), highest)
        amount = descend(misfit.slope, highest, np.minimum(amount, highest), process.dose.iterations)
    return Dose(stretches, _round_off(amount * unit, process))


def _highest(stretches: Stretches, lines: Lines, target: Target, process: ProcessParameters) -> Array:
    """Largest dose of each stretch [m3/m]: the layer limit, and the pump at the slowest nozzle.

    A layer of limit d as wide as the passes are apart takes d times that width; what rebounds or passes
    by comes on top.
    """
    area = np.asarray(stretches.growth.T @ target.area.ravel()) / stretches.length
    column = np.rint((lines.along[stretches.first] - target.along[0]) / target.cell[1]).astype(np.int64)
    layer = limit_layer(target, process.layer)[np.clip(column, 0, len(target.along) - 1)]
    peak = LAYER_SLACK * layer * process.dose.pass_spacing_m / np.maximum(area, LEAST_YIELD)
    return np.asarray(np.minimum(peak, process.spray.pump_m3_s / process.dose.speed_m_s[0]))


def _over_limit(
    stretches: Stretches, amount: Array, lines: Lines, target: Target, process: ProcessParameters
) -> Array:
    """How many times the thickest layer that stays up is laid where a stretch sprays, shape (m,).

    Each dose is bounded, but strokes of one layer overlap: those of a further spraying lie densely and are
    aimed at one place in several ways. Layers are averaged over a patch, as they are counted.

    Args:
        stretches: Footprints.
        amount: Doses [m3/m], shape (m,).
        lines: The points, for the layers.
        target: Grid.
        process: Layer limit, patch.
    """
    limit, layer = limit_layer(target, process.layer), lines.layer[stretches.first]
    over = np.zeros(len(amount))
    for number in np.unique(layer):
        mine = np.flatnonzero(layer == number)
        footprint = stretches.growth[:, mine]
        grown = (footprint @ amount[mine]).reshape(target.offset.shape)
        mean = mean_patch(grown, ~target.arch, target.cell, process.target.patch_m)
        times = np.nan_to_num(mean) / limit
        core = csr_matrix(footprint.T)
        peak = core.max(axis=1).toarray().ravel()
        core.data = np.where(core.data > 0.5 * np.repeat(peak, np.diff(core.indptr)), 1.0, 0.0)
        over[mine] = core.multiply(times.ravel()[None, :]).max(axis=1).toarray().ravel()
    return over


def _round_off(amount: Array, process: ProcessParameters) -> Array:
    """Leave out what is less than the pump can lay at the fastest nozzle."""
    least = process.spray.pump_least * process.spray.pump_m3_s / process.dose.speed_m_s[1]
    return np.where(amount < least / 2.0, 0.0, np.maximum(amount, least))


def choose_speed(dose: Dose, lines: Lines, process: ProcessParameters) -> tuple[Array, Array]:
    """Choose the pump step of every pass and the nozzle speed of every stretch.

    The highest step is taken with which four fifths of a pass stay below the fastest nozzle: the rest
    runs at the fastest nozzle with less flow.

    Returns:
        Nozzle speed [m/s] and flow (fraction of the pump's largest) on leaving each point, shape (n,);
        flow 0 and the fastest nozzle where nothing is to be laid.
    """
    slowest, fastest = process.dose.speed_m_s
    speed = np.full(len(lines.along), fastest)
    flow = np.zeros(len(lines.along))
    first, amount = dose.stretches.first, dose.amount
    for number in np.unique(lines.pass_index[first]):
        mine = np.flatnonzero(lines.pass_index[first] == number)
        laid = amount[mine][amount[mine] > 0.0]
        if not len(laid):
            continue
        steps = [
            s
            for s in process.spray.pump_steps
            if s * process.spray.pump_m3_s / fastest <= np.quantile(laid, 0.2)
        ]
        step = steps[-1] if steps else process.spray.pump_steps[0]
        wanted = step * process.spray.pump_m3_s / np.maximum(amount[mine], 1e-9)
        chosen = np.clip(wanted, slowest, fastest)
        speed[first[mine]] = chosen
        flow[first[mine]] = np.clip(amount[mine] * chosen / process.spray.pump_m3_s, 0.0, 1.0)
    return speed, flow


def explain(
    target: Target, planned: NDArray[np.bool_], reached: NDArray[np.bool_], low: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Say why cells cannot be brought to the target, shape (ns, na).

    Args:
        target: What was to be sprayed.
        planned: Cells exposed by all planned points.
        reached: Cells exposed by the points the arm reaches.
        low: Cells whose nozzle would be too near the floor.
    """
    left = target.left.copy()
    left[target.inside & ~reached] = Left.ARM
    bare = target.inside & ~planned
    beside = np.zeros(left.shape, dtype=bool)
    for lid in target.arches:
        beside |= np.abs(target.station[:, None] - lid.station) <= lid.half + SHADOW_M
    left[bare] = np.where(steepness(target)[bare] > np.sin(np.radians(STEEP_DEG)) ** 2, Left.STEEP, Left.EDGE)
    left[bare & beside] = Left.SHADOW
    left[bare & low] = Left.FLOOR
    return left
