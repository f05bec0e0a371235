"""Plan the whole spraying: Surface -> SprayPlan: passes, layers, doses, nozzle speed and pump flow."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError, NothingToSprayError
from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.planning.coverage import Coverage, Lines
from ascrcp.planning.deposition import Jet
from ascrcp.planning.dose import (
    Dose,
    choose_speed,
    explain,
    find_exposed,
    find_stretches,
    renew_stretches,
    solve_dose,
)
from ascrcp.planning.layer import wall_before
from ascrcp.planning.parameter import PlanningParameters, change, check_parameters
from ascrcp.planning.process import ProcessParameters, ReboundParameters
from ascrcp.planning.prune import LEAST_M3, keep_dosed
from ascrcp.planning.respray import find_respray
from ascrcp.planning.target import Left, Target, find_target
from ascrcp.planning.wall import find_floor, fit_wall

Progress = Callable[[float], None]
ROUGH_ROUNDS = 1  # of weighting the excess, for doses that only tell what wall they build


@dataclass(frozen=True)
class Layout:
    """Where a spraying goes, before doses are chosen: what is kept between planning and solving.

    Attributes:
        lines: The points in the tunnel frame, with their layers.
        target: Present and wanted surface; its `left` says what cannot be covered, and why.
        layers: Layers of each cell, shape (ns, na).
        exposed: Cells the lines can bring to the target, shape (ns, na).
        rebound: As believed when it was planned.
        leave: How much thinner than wanted a further spraying leaves the wall [m], 0 at the first, shape
            (ns, na).
    """

    lines: Lines
    target: Target
    layers: NDArray[np.int64]
    exposed: NDArray[np.bool_]
    rebound: ReboundParameters
    leave: Array

    @property
    def again(self) -> bool:
        """Whether it is a further spraying, over what those before left too thin."""
        return bool(self.leave.any())


@dataclass(frozen=True)
class SprayPlan:
    """A planned spraying.

    Attributes:
        path: Nozzle poses with speed and flow.
        layout: Its points on the wall, and the wall.
        dose: What each stretch lays.
    """

    path: SprayPath
    layout: Layout
    dose: Dose

    @property
    def lines(self) -> Lines:
        """The points in the tunnel frame."""
        return self.layout.lines

    @property
    def target(self) -> Target:
        """Present and wanted surface."""
        return self.layout.target

    @property
    def exposed(self) -> NDArray[np.bool_]:
        """Cells the path can bring to the target, shape (ns, na)."""
        return self.layout.exposed

    @property
    def growth(self) -> Array:
        """Predicted layer [m], shape (ns, na)."""
        return self.grown(self.dose.amount)

    def grown(self, amount: Array) -> Array:
        """Layer that doses (m,) [m3/m] lay [m], shape (ns, na)."""
        return np.asarray((self.dose.stretches.growth @ amount).reshape(self.target.offset.shape))


def plan_spray(
    surface: Surface,
    parameters: PlanningParameters,
    process: ProcessParameters,
    after: Array | None = None,
    progress: Progress | None = None,
) -> SprayPlan:
    """Plan a spraying, or a second one over what the first left too thin.

    Args:
        surface: Recognised heading, before any spraying.
        parameters: Distances and angles.
        process: Jet, rebound, wanted surface, layers, dose.
        after: The surface a second scan found, on the target's grid, NaN where not seen (`rescan`); None
            for the first spraying.
        progress: Called with the fraction done; may raise to cancel.

    Raises:
        ConfigError: A parameter outside its range.
        InputError: No bay, nothing seen.
        NothingToSprayError: No pass comes near the wall, or none of it lacks enough.
    """
    parameters, process = check_parameters(parameters), check_parameters(process)
    tell = progress or (lambda fraction: None)
    if not surface.bays:
        raise InputError("the heading has no bay to spray: at least one is needed")
    wall = fit_wall(surface, parameters)
    target = find_target(surface, wall, process, parameters.bridge_m)
    where, leave = None, np.zeros(target.offset.shape)
    if after is not None:
        respray = find_respray(target, after, surface.unsprayed, process)
        target, where, leave = respray.target, respray.thin, respray.leave
    tell(0.1)
    coverage = Coverage(surface, target, wall, parameters, process, where)
    lines, layers = coverage.lines(lambda x: tell(0.1 + 0.3 * x)), coverage.layers
    grid = Layout(lines, target, layers, target.inside, process.rebound, leave)
    sprayed = _Sprayed(grid, lines.jet, process, progress=lambda x: tell(0.4 + 0.4 * x))
    exposed = sprayed.exposed
    low = _is_low(surface, target, parameters)
    target = replace(target, left=explain(target, exposed, exposed, low))
    tell(0.8)
    layout = replace(grid, target=target, exposed=exposed)
    plan = sprayed.dosed(surface, layout)
    if not plan.dose.volume > 0.0:
        raise NothingToSprayError(_why_nothing(parameters, process))
    if layout.again:
        lines = keep_dosed(lines, plan.dose, process.dose.pass_spacing_m)
        if not len(lines.along):
            raise NothingToSprayError(
                f"nothing left to spray: no stroke would lay {1e3 * LEAST_M3:g} l where it is too thin"
            )
        layout = replace(layout, lines=lines)
        sprayed = _Sprayed(layout, lines.jet, process)
        exposed = exposed & sprayed.exposed
        plan = sprayed.dosed(surface, replace(layout, exposed=exposed))
    tell(1.0)
    return plan


def replan(
    layout: Layout,
    surface: Surface,
    driven: SprayPath,
    reached: NDArray[np.bool_],
    process: ProcessParameters,
) -> SprayPlan:
    """Choose the doses anew for the poses the arm takes, without the points it does not reach.

    Args:
        layout: Of the plan whose path was solved.
        surface: Its heading.
        driven: The path as solved: poses may be tilted.
        reached: Points that are sprayed, shape (n,).
        process: As it was planned with; the rebound is the layout's.
    """
    process = change(process, rebound=layout.rebound)
    T = inverse_transform(surface.axis.T_base_tunnel)
    jet = Jet(apply_transform(T, driven.position), driven.direction @ T[:3, :3].T)
    sprayed = _Sprayed(layout, jet, process, reached)
    exposed = sprayed.exposed & layout.exposed
    left = layout.target.left.copy()
    left[layout.exposed & ~exposed] = Left.ARM
    target = replace(layout.target, left=left)
    amount = driven.flow * process.spray.pump_m3_s / np.maximum(driven.speed, process.dose.speed_m_s[0])
    found = sprayed.dosed(surface, replace(layout, target=target, exposed=exposed), amount)
    path = replace(driven, speed=found.path.speed, flow=found.path.flow)
    return replace(found, path=path)


def walls_before(lines: Lines, target: Target, layers: NDArray[np.int64]) -> dict[int, Array]:
    """The wall before each layer [m], by layer, as if every layer filled its share, (ns, na) each."""
    return {layer: wall_before(target, layers, layer) for layer in np.unique(lines.layer).tolist()}


class _Sprayed:
    """Footprints of a layout's points, from which doses are chosen.

    Attributes:
        stretches: As reckoned on the walls that layers leave which fill their share everywhere.
        exposed: Cells they can bring to the target, shape (ns, na).
    """

    def __init__(
        self,
        layout: Layout,
        jet: Jet,
        process: ProcessParameters,
        reached: NDArray[np.bool_] | None = None,
        progress: Progress | None = None,
    ) -> None:
        lines, target = layout.lines, layout.target
        everywhere = np.ones(len(lines.along), dtype=bool)
        self._jet, self._process = jet, process
        self._walls = walls_before(lines, target, layout.layers)
        self.stretches = find_stretches(
            lines, jet, everywhere if reached is None else reached, target, self._walls, process, progress
        )
        self.exposed = find_exposed(self.stretches, lines, target, process, layout.again)

    def dosed(self, surface: Surface, layout: Layout, asked: Array | None = None) -> SprayPlan:
        """Choose doses, speeds and flows for the layout, the doses on the wall that they themselves build.

        Args:
            surface: The heading.
            layout: The same points; target and what is exposed may say more by now.
            asked: Doses planned before, on leaving each point [m3/m], (n,); None for none.
        """
        target, lines, process = layout.target, layout.lines, self._process
        met = np.asarray(self.stretches.growth.sum(axis=1)).reshape(target.offset.shape) > 0.0
        # beside what can be brought to the target, what must not get more counts too
        must_not = target.offset <= target.wanted
        if layout.again:
            must_not = ~np.isin(target.left, (Left.UNSEEN, Left.BEFORE))
        mask = layout.exposed | (met & must_not & (target.left != Left.OUTSIDE))
        fillable = layout.exposed & ~target.beneath  # or the flange in the way would be sprayed for its sake
        start, rounds = (None, ROUGH_ROUNDS) if asked is None else (asked[self.stretches.first], 0)
        leave = layout.leave
        rough = solve_dose(self.stretches, lines, target, process, mask, fillable, leave, start, rounds)
        stretches = renew_stretches(
            self.stretches, rough.amount, lines, self._jet, target, self._walls, process
        )
        dose = solve_dose(stretches, lines, target, process, mask, fillable, leave, rough.amount)
        speed, flow = choose_speed(dose, lines, process)
        return SprayPlan(lines.to_path(surface, speed, flow), layout, dose)


def _why_nothing(parameters: PlanningParameters, process: ProcessParameters) -> str:
    r = process.rebound
    lost = min(1.0, r.wall + r.distance * (parameters.stand_off_m - r.best_m) ** 2)
    return (
        "nothing to spray: no stroke would bring wall to the target; with stand_off_m "
        f"{parameters.stand_off_m:g} and rebound best_m {r.best_m:g} {100.0 * lost:.0f} % rebound from a wall"
    )


def _is_low(surface: Surface, target: Target, parameters: PlanningParameters) -> NDArray[np.bool_]:
    """Mark cells before which a nozzle would stand too near the floor, shape (ns, na)."""
    inside = surface.profile.point(target.along, -parameters.stand_off_m)[:, 1]
    low = inside < find_floor(surface) + parameters.floor_clearance_m + parameters.point_spacing_m
    return np.asarray(np.broadcast_to(low, target.offset.shape))
