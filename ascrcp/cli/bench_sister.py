"""The sister machines' papers: their printed figures and the errata's beside ours."""

import time

import numpy as np

from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.duct import find_station, make_scene, solve_ring
from ascrcp.cli.muck import MACHINE as MUCK
from ascrcp.cli.muck import MuckJob, solve_muck
from ascrcp.cli.output import Output
from ascrcp.core.errors import UnreachableError
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.duct_bend import draw_bend, make_bend
from ascrcp.kinematics.ring import Scene, plan_ring
from ascrcp.kinematics.ring_parameter import load_ring_parameters
from ascrcp.kinematics.ring_program import close_ring
from ascrcp.kinematics.ring_sweep import limit_acceleration
from ascrcp.kinematics.ring_target import Ring, make_ring
from ascrcp.kinematics.ring_verdict import Verdict, judge_ring
from ascrcp.planning.muck import count_scoops, find_volume, load_muck_parameters

DUCTS = 16
"""Random bends tried (errata 3.4)."""

PAPER_TILT_DEG = 12.0
PAPER_CYCLE_S = 53.0
PAPER_BULKING = 1.2
"""What makes the paper's 0.6984 m3 of the segment's volume (errata 1.5)."""

EXACT_DEPTH_M = 3.8505
"""k1 + k3 + longest d4 + k4 + k5 (errata 1.4)."""


def measure_sister(seed: int, say: Say) -> tuple[list[Figure], list[Figure]]:
    """Measure both machines.

    Args:
        seed: Of starts, random ducts and climbs.
        say: Where progress goes.

    Returns:
        Figures that stand beside others, and proofs that must hold.
    """
    duct_figures, duct_proofs = measure_duct(seed, say)
    muck_figures, muck_proofs = measure_muck(seed)
    return duct_figures + muck_figures, duct_proofs + muck_proofs


def measure_duct(seed: int, say: Say) -> tuple[list[Figure], list[Figure]]:
    """Plan the errata's ring (3.3) in every state, then rings in random ducts (3.4)."""
    parameters = load_ring_parameters()
    say("  duct: the errata's ring")
    scene = make_scene(make_bend("errata 3.3", parameters.bend))
    at = find_station(scene.duct, parameters.ring_z)
    ring = make_ring(scene.duct, at, parameters.count, parameters.stand_off)
    result = solve_ring(scene, ring, at, seed)
    began = time.process_time()
    gentle = judge_ring(scene, ring, limit_acceleration(scene, result.after[0]))
    sweep_ms = 1e3 * (time.process_time() - began) / len(ring.T)
    after, closed = result.after[1], result.closed[1]
    figures = [] if result.before is None else _plain_figures(result.before[1])
    figures += [
        *_peaks("with feedback", after, "errata 0.82, 1.38"),
        *_peaks("and eq. 11, 12", gentle, f"errata 0.27, 0.88 in 440-880 ms a pose; here {sweep_ms:.0f}"),
        *_peaks("closed ring", closed, "errata 0.13, 0.48"),
        *_times(scene, ring, seed),
    ]
    proofs = [
        Figure("duct: poses touching, with feedback", after.colliding, f"of {len(after.clearance)}", 0),
        _clearance("duct: least clearance", after.clearance, scene, "errata 5.4 mm at J7"),
        _clearance("duct: least clearance between poses", after.between, scene, "errata 5.8 mm"),
        Figure("duct: largest tilt", _degrees(after), "deg", PAPER_TILT_DEG, note="paper < 12, errata 7.08"),
        Figure("duct: gun off its place", 1e9 * after.place_error, "nm", 10.0, note="errata 0.13 nm"),
        _clearance("duct: closed ring, least clearance", closed.clearance, scene, ""),
        _clearance("duct: closed ring, least clearance between poses", closed.between, scene, ""),
        Figure("duct: closed ring, largest tilt", _degrees(closed), "deg", PAPER_TILT_DEG),
        Figure("duct: closed ring, open end", closed.open_end, "rad, m", 1e-9, note="errata's plan 0.35"),
        _try_ducts(seed, say),
    ]
    return figures, proofs


def _plain_figures(before: Verdict) -> list[Figure]:
    parts = ", ".join(f"{name} {count}" for name, count in before.touching.items())
    note = f"{parts}; errata 28: J4 2, J5 12, L5 14, J6 17, J7 16"
    return [
        Figure(
            "duct: poses touching, gradient projection",
            before.colliding,
            f"of {len(before.clearance)}",
            note=note,
        ),
        Figure(
            "duct: its least clearance",
            1e3 * float(before.clearance.min()),
            "mm",
            note=f"at {before.nearest}; errata -108.3 at J5",
        ),
        *_peaks("gradient projection", before, "errata 0.78, 1.03"),
    ]


def _peaks(what: str, verdict: Verdict, note: str) -> list[Figure]:
    peak = np.abs(verdict.acceleration).max(axis=0)
    return [
        Figure(f"duct: peak of q1, {what}", float(peak[0]), "m/s2", note=note),
        Figure(f"duct: peak of q2..q8, {what}", float(peak[1:].max()), "rad/s2"),
    ]


def _clearance(what: str, clearance: np.ndarray | float, scene: Scene, note: str) -> Figure:
    aim = 1e3 * scene.parameters.margin
    return Figure(what, 1e3 * float(np.min(clearance)), "mm", aim, more_is_better=True, note=note)


def _degrees(verdict: Verdict) -> float:
    return float(np.degrees(verdict.tilt.max()))


def _times(scene: Scene, ring: Ring, seed: int) -> list[Figure]:
    """Measure the processor time a pose takes with feedback and in the closed ring [ms]."""
    began = time.process_time()
    _, plan = plan_ring(scene, ring, np.random.default_rng(seed))
    middle = time.process_time()
    close_ring(scene, ring, plan)
    end = time.process_time()
    per = 1e3 / len(ring.T)
    return [
        Figure("duct: feedback, starts included", per * (middle - began), "ms/pose", note="errata 16-21"),
        Figure("duct: closed ring", per * (end - middle), "ms/pose", note="errata 148"),
    ]


def _try_ducts(seed: int, say: Say) -> Figure:
    """Plan and close a ring in each of many random bends; count the clear ones."""
    parameters, rng = load_ring_parameters(), np.random.default_rng(seed)
    good, tilt, why = 0, 0.0, ""
    for number in range(1, DUCTS + 1):
        say(f"  duct: random bend {number} of {DUCTS}")
        bend, stand_off = draw_bend(parameters.bend, rng)
        scene = make_scene(make_bend(f"bend {number}", bend))
        at = find_station(scene.duct, parameters.ring_z)
        ring = make_ring(scene.duct, at, parameters.count, stand_off)
        try:
            _, plan = plan_ring(scene, ring, np.random.default_rng(seed))
            verdicts = [judge_ring(scene, ring, p) for p in (plan, close_ring(scene, ring, plan))]
        except UnreachableError as error:
            why = f"; {error}"
            continue
        clear = all(float(v.clearance.min()) >= parameters.margin for v in verdicts)
        good += clear and verdicts[1].open_end < 1e-9
        tilt = max(tilt, *(_degrees(verdict) for verdict in verdicts))
    note = f"largest tilt {tilt:.1f} deg; errata 16 of 16{why}"
    return Figure("duct: random bends clear and closed", good, f"of {DUCTS}", DUCTS, True, note)


def measure_muck(seed: int) -> tuple[list[Figure], list[Figure]]:
    """Plan the paper's job and measure the workspace."""
    parameters = load_muck_parameters()
    loose = load_muck_parameters(bulking=PAPER_BULKING)
    job = solve_muck(load_arm(MUCK), parameters, seed, Output(json=False))
    cycle = job.total_s / len(job.scoops)
    figures = [
        Figure(
            "muck: mean cycle", cycle, "s", PAPER_CYCLE_S, note="paper 53 measured; speeds here placeholders"
        ),
        Figure("muck: whole job", job.total_s / 60, "min", parameters.time_limit_min, note="paper 13.25"),
        Figure("muck: volume", job.volume_m3, "m3", note="paper 0.6984, its scoops fit 0.5821"),
        Figure("muck: volume bulked by 1.2", find_volume(loose), "m3", note="paper 0.6984"),
        Figure(
            "muck: scoops of that",
            count_scoops(loose),
            "",
            note=f"{count_scoops(loose) * cycle / 60:.1f} min",
        ),
    ]
    return figures, _muck_proofs(job)


def _muck_proofs(job: MuckJob) -> list[Figure]:
    off = 1e3 * abs(job.depth_m - EXACT_DEPTH_M)
    clearance = 1e3 * min(scoop.clearance for scoop in job.scoops)
    floor = 1e3 * min(scoop.floor for scoop in job.scoops)
    depth = f"{1e3 * job.depth_m:.1f} mm; paper 3830"
    return [
        Figure("muck: scoops", len(job.scoops), "", 15, note="paper 15"),
        Figure("muck: depth, off the exact 3850.5 mm", off, "mm", 0.01, note=depth),
        Figure("muck: invert covered to either side", job.cover_deg, "deg", 45.0, True, "paper 45"),
        Figure("muck: arm clear of wall and beam", clearance, "mm", 0.0, True),
        Figure("muck: lip within the invert", floor, "mm", 0.0, True),
    ]
