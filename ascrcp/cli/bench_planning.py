"""Planned spraying on generated headings, sprayed by the simulated jet: finish, concrete, a second scan."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ascrcp.app import Simulation, load_simulation
from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.spray_site import Finish, Site, drive, drive_thesis
from ascrcp.core.errors import NothingToSprayError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.finish import judge_finish
from ascrcp.planning.learning import learn_rebound
from ascrcp.planning.parameter import Parameters, change, load_parameters
from ascrcp.planning.path import plan as plan_thesis
from ascrcp.planning.prediction import predict
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.pump import laid_amount
from ascrcp.planning.rescan import find_after
from ascrcp.planning.spray_plan import SprayPlan, plan_spray, replan
from ascrcp.planning.target import LEFT_TEXT
from ascrcp.simulation.bare_wall import grow_heading
from ascrcp.simulation.deposition import Sprayer

HEADINGS = 20
STAND_OFF_M, DIRECTION_DEG = 0.02, 2.0  # tolerances of the thesis's poses
RESPRAYS = 2  # further scans and sprayings at most, until no patch seen lacks more than the tolerance
STRAY = 0.10  # how far the planner's own model is bent for the second line, each parameter up or down


@dataclass(frozen=True)
class Sprayed:
    """One heading sprayed.

    Attributes:
        finish: After the first spraying and after each further one, where the first scan had seen the wall.
        finish_all: The same with what lay in shadow and was estimated.
        bent: Finish by the planner's own model with its parameters bent.
        thesis: Finish of the thesis's path at constant speed and flow, where the scan had seen the wall.
        thesis_all: The same with what lay in shadow.
        concrete: What stuck after all over what was wanted where it was sprayed.
        beneath: Share of what was wanted that fills the rock beneath flanges.
        rebound: Share of the pumped concrete that rebounded.
        planned, reached: Points.
        left: Area the plan said before spraying that it leaves out, by the code of its reason [m2].
        stand_off: Share of the thesis's points within 20 mm of 1 m to the true smoothed wall.
        direction: Share of them whose direction is within 2 deg of the wanted one.
        plan_s: Processor time of planning [s].
    """

    finish: list[Finish]
    finish_all: list[Finish]
    bent: Finish
    thesis: Finish
    thesis_all: Finish
    concrete: float
    beneath: float
    rebound: float
    planned: int
    reached: int
    left: dict[str, float]
    stand_off: float
    direction: float
    plan_s: float

    @property
    def first(self) -> Finish:
        """Finish without a second scan."""
        return self.finish[0]

    @property
    def first_all(self) -> Finish:
        """The same with what lay in shadow."""
        return self.finish_all[0]

    @property
    def second(self) -> Finish:
        """Finish after one second scan."""
        return self.finish[:2][-1]

    @property
    def second_all(self) -> Finish:
        """The same with what lay in shadow."""
        return self.finish_all[:2][-1]

    @property
    def last(self) -> Finish:
        """Finish when all further sprayings are done."""
        return self.finish[-1]


def spray_heading(arm: Arm, seed: int, parameters: Parameters, simulation: Simulation) -> Sprayed:
    """Plan, drive and spray one heading; scan it again, spray again; and once by the thesis's plan."""
    site = Site(arm, seed, parameters, simulation)
    obstacles = Obstacles.from_surface(site.surface, arm, bodies=parameters.solve.bodies)
    begin = time.process_time()
    plan = plan_spray(site.surface, parameters.path, parameters.process)
    plan_s = time.process_time() - begin
    driven, sequence, reached = drive(site, plan, obstacles)
    sprayer = site.sprayer()
    grown = site.spray(sprayer, sequence)
    rebound, pumped = grown.rebound / grown.pumped, grown.pumped
    finish = [(site.judge(driven, grown, True), site.judge(driven, grown, False))]
    finish += respray(site, obstacles, sprayer, driven, sequence)
    grown = sprayer.grown
    reach, off = site.find_poses(plan_thesis(site.surface, parameters.path))
    by_thesis = site.spray(site.sprayer(), drive_thesis(site, obstacles, pumped))
    return Sprayed(
        finish=[seen for seen, _ in finish],
        finish_all=[whole for _, whole in finish],
        bent=bend(site, driven, sequence, np.random.default_rng([seed, 2000])),
        thesis=site.judge(driven, by_thesis, True),
        thesis_all=site.judge(driven, by_thesis, False),
        concrete=(grown.pumped - grown.rebound) / site.wanted(driven, grown),
        beneath=site.filled_beneath(grown) / site.wanted(driven, grown),
        rebound=rebound,
        planned=len(plan.path),
        reached=reached,
        left=predict(driven, parameters.process).left,
        stand_off=float((np.abs(reach - parameters.path.stand_off_m) <= STAND_OFF_M).mean()),
        direction=float((off <= np.radians(DIRECTION_DEG)).mean()),
        plan_s=plan_s,
    )


def respray(
    site: Site, obstacles: Obstacles, sprayer: Sprayer, plan: SprayPlan, sequence: JointSequence
) -> list[tuple[Finish, Finish]]:
    """Scan and spray on until no patch seen lacks enough, or as often as is allowed.

    Args:
        site: The heading.
        obstacles: What the arm must not touch.
        sprayer: Has sprayed the first plan.
        plan: The first plan, as driven.
        sequence: Its rows.

    Returns:
        Finish after each further spraying, where the first scan had seen the wall and with what it had not.
    """
    found, driven = [], plan
    for number in range(RESPRAYS):
        heading = grow_heading(site.heading, site.bare, sprayer.grown.rock, sprayer.grown.flange)
        points = site.scan_again(heading, obstacles, number)
        after = find_after(points, site.surface, plan.target, driven.target.offset - driven.growth)
        again = plan_again(site, driven, sequence, after)
        if again is None:
            break
        driven, sequence, _ = drive(site, again, obstacles)
        grown = site.spray(sprayer, sequence)
        found.append((site.judge(plan, grown, True), site.judge(plan, grown, False)))
    return found


def plan_again(site: Site, driven: SprayPlan, sequence: JointSequence, after: Array) -> SprayPlan | None:
    """Plan what a second scan found too thin with the rebound it shows; None if nothing is."""
    process = site.parameters.process
    rebound = learn_rebound(driven.layout, site.surface, sequence, after, process)
    try:
        return plan_spray(site.surface, site.parameters.path, change(process, rebound=rebound), after)
    except NothingToSprayError:
        return None


def bend(site: Site, driven: SprayPlan, sequence: JointSequence, rng: np.random.Generator) -> Finish:
    """Judge the driven rows by the planner's model with other parameters than it planned with."""
    target, process = driven.target, site.parameters.process
    growth = bend_growth(site, driven, sequence, bend_process(process, rng))
    finish = judge_finish(target.offset - growth, target, driven.exposed, process.target).value
    ok = np.isfinite(finish)
    return Finish(finish[ok], target.area[ok])


def bend_growth(site: Site, driven: SprayPlan, sequence: JointSequence, process: ProcessParameters) -> Array:
    """Layer that the driven rows lay if the process is another than they were planned for [m], (ns, na)."""
    reached = np.zeros(len(driven.path), dtype=bool)
    first = driven.dose.stretches.first
    reached[first] = reached[first + 1] = True
    layout = replace(driven.layout, rebound=process.rebound)  # `replan` reckons with the layout's own
    stretches = replan(layout, site.surface, driven.path, reached, process).dose.stretches
    spray = site.parameters.process.spray
    amount = laid_amount(sequence, stretches.first, stretches.length, len(driven.path), spray)
    return np.asarray((stretches.growth @ amount).reshape(driven.target.offset.shape))


def bend_process(process: ProcessParameters, rng: np.random.Generator) -> ProcessParameters:
    """Bend radius and rebound by up to `STRAY`, each on its own."""

    def bent(value: float) -> float:
        return value * float(rng.uniform(1.0 - STRAY, 1.0 + STRAY))

    spray, rebound = process.spray, process.rebound
    return change(
        process,
        spray=change(spray, radius_m=bent(spray.radius_m)),
        rebound=change(
            rebound, wall=bent(rebound.wall), crown=bent(rebound.crown), angle=bent(rebound.angle)
        ),
    )


def measure_planning(
    machine: str, seed: int, rig: Path | None, say: Say, headings: int = HEADINGS
) -> list[Figure]:
    """Spray generated headings and hold the planner to its promises.

    Args:
        machine: Name of the arm.
        seed: Of the first heading; the others follow it.
        rig: File laid over the simulation's parameters: headings, lidar, jet, what falls off.
        say: Takes progress.
        headings: How many.
    """
    arm = load_arm(machine)
    description = arm.description
    if description.path is None or description.clearance is None or description.lidar is None:
        return [Figure("planned spraying", None, "", note=f"machine {machine} does not spray by a scan")]
    parameters, simulation = load_parameters(), load_simulation(rig)
    found = []
    for number in range(headings):
        found.append(spray_heading(arm, seed + number, parameters, simulation))
        one = found[-1]
        say(
            f"bench: heading {number + 1} of {headings}: "
            f"{100 * one.first.within(parameters.process.target.tolerance_m):.1f} % within at once, "
            f"{100 * one.second.within(parameters.process.target.tolerance_m):.1f} % after a second scan"
        )
    return list_figures(found, parameters)


def list_figures(found: list[Sprayed], parameters: Parameters) -> list[Figure]:
    """Put the headings' results beside their aims."""
    tolerance = parameters.process.target.tolerance_m

    def joined(name: str) -> Finish:
        parts: list[Finish] = [getattr(one, name) for one in found]
        return Finish(np.concatenate([p.value for p in parts]), np.concatenate([p.area for p in parts]))

    def within(what: str, name: str, aim: float | None) -> Figure:
        each = [100 * getattr(one, name).within(tolerance) for one in found]
        note = f"{1e3 * tolerance:g} mm, patches of 0.3 m; worst heading {min(each):.1f} %"
        return Figure(what, 100 * joined(name).within(tolerance), "%", aim, more_is_better=True, note=note)

    first, second, last = (joined(name) for name in ("first", "second", "last"))
    left = {code: sum(one.left.get(code, 0.0) for one in found) / len(found) for code in LEFT_TEXT}
    planned, reached = sum(one.planned for one in found), sum(one.reached for one in found)
    ratio = [one.concrete for one in found]
    return [
        within("finish within tolerance, no second scan", "first", 95.0),
        within("the same with what lay in shadow", "first_all", None),
        within("the same by the planner's bent model", "bent", 95.0),
        within("finish within tolerance, one second scan", "second", 99.0),
        within("the same with what lay in shadow", "second_all", None),
        within(f"the same after up to {RESPRAYS}, until no patch seen lacks more", "last", None),
        _thinnest(found, first, second, last),
        Figure(
            "concrete off wanted / (1 - rebound), worst heading",
            100 * float(np.abs(np.array(ratio) - 1.0).max()),
            "%",
            5.0,
            note=f"rebound {100 * float(np.mean([one.rebound for one in found])):.0f} %, "
            f"headings {100 * (min(ratio) - 1):+.1f}..{100 * (max(ratio) - 1):+.1f} %, "
            f"mean {100 * (float(np.mean(ratio)) - 1):+.1f} %; of what is wanted "
            f"{100 * float(np.mean([one.beneath for one in found])):.0f} % fills rock beneath flanges",
        ),
        *_thesis_figures(found, joined),
        Figure(
            "points reached",
            100.0 * reached / planned,
            "%",
            note=f"of {planned}",
        ),
        Figure(
            "left out of a heading, told before spraying",
            sum(left.values()),
            "m2",
            note=", ".join(f"{area:.2f} {code}" for code, area in left.items() if area >= 0.005),
        ),
        Figure(
            "planning a heading",
            float(np.median([one.plan_s for one in found])),
            "s",
            1.5,
            note="median, processor time",
        ),
    ]


def _thinnest(found: list[Sprayed], first: Finish, second: Finish, last: Finish) -> Figure:
    """Tell the thinnest patch of all headings after their last spraying, and before."""
    at_once, after_one, then = (1e3 * float(one.value.max()) for one in (first, second, last))
    most = 1e3 * float(np.quantile(last.value, 0.999))
    count = np.mean([len(one.finish) - 1 for one in found])
    return Figure(
        "thinnest patch then",
        then,
        "mm",
        30.0,
        note=f"{at_once:.0f} mm at once, {after_one:.0f} after one; 99.9 % of the area below {most:.0f} mm; "
        f"{count:.1f} further sprayings on average",
    )


def _thesis_figures(found: list[Sprayed], joined: Callable[[str], Finish]) -> list[Figure]:
    """Put the thesis's plan beside ours; deviations are those of all headings together."""

    def beside(what: str, theirs: str, ours: str, aim: float | None) -> Figure:
        a, b = joined(theirs).deviation, joined(ours).deviation
        worst = min(getattr(one, theirs).deviation / getattr(one, ours).deviation for one in found)
        note = f"{1e3 * a:.0f} over {1e3 * b:.1f} mm; worst heading {worst:.1f} x"
        return Figure(what, a / b, "x", aim, more_is_better=True, note=note)

    return [
        beside("deviation, thesis's plan over ours", "thesis", "first", 3.0),
        beside("the same with what lay in shadow", "thesis_all", "first_all", None),
        Figure(
            "thesis's points 1 m off within 20 mm",
            100 * float(np.mean([one.stand_off for one in found])),
            "%",
            note="of the true wall; the others: unseen parts of pockets, nozzles drawn back from arches",
        ),
        Figure(
            "thesis's directions within 2 deg",
            100 * float(np.mean([one.direction for one in found])),
            "%",
            note="of the true smoothed wall's normal, tilted",
        ),
    ]
