"""ascrcp duct: contours of a duct -> joints that spray rings inside it without touching it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.cli.folder import check_folder, write_folder
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.ring_picture import draw_ring
from ascrcp.cli.table import table
from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.duct import Duct
from ascrcp.kinematics.duct_bend import make_bend
from ascrcp.kinematics.duct_body import SphereBody
from ascrcp.kinematics.duct_file import encode_duct, read_duct
from ascrcp.kinematics.ring import RingPlan, Scene, plan_plain, plan_ring
from ascrcp.kinematics.ring_parameter import load_ring_parameters
from ascrcp.kinematics.ring_program import close_ring
from ascrcp.kinematics.ring_target import Ring, make_ring
from ascrcp.kinematics.ring_verdict import Verdict, judge_ring

MACHINE = "duct"


@dataclass(frozen=True)
class RingResult:
    """One ring in its three states; before is None where gradient projection alone does not get round."""

    at: float
    ring: Ring
    before: tuple[RingPlan, Verdict] | None
    after: tuple[RingPlan, Verdict]
    closed: tuple[RingPlan, Verdict]


def make_scene(duct: Duct) -> Scene:
    """Put the duct arm and its envelope into a duct."""
    parameters = load_ring_parameters()
    arm = load_arm(MACHINE)
    return Scene(arm, SphereBody.of(arm, parameters.body), duct, parameters)


def find_station(duct: Duct, z: float) -> float:
    """Return how far along a duct that runs up the z axis a height z lies [m]."""
    return float(np.interp(z, duct.centre[:, 2], duct.station))


def solve_ring(scene: Scene, ring: Ring, at: float, seed: int, near: Array | None = None) -> RingResult:
    """Plan one ring: before and after collision feedback, and closed.

    Raises:
        UnreachableError: It cannot be kept clear.
    """
    start, after = plan_ring(scene, ring, np.random.default_rng(seed), near)
    try:
        plain = plan_plain(scene, ring, start)
        before = plain, judge_ring(scene, ring, plain)
    except UnreachableError:
        before = None
    closed = close_ring(scene, ring, after)
    verdict = judge_ring(scene, ring, closed)
    if not verdict.between >= 0.0:
        raise UnreachableError(f"the arm touches the wall between two poses ({1e3 * verdict.between:.0f} mm)")
    return RingResult(at, ring, before, (after, judge_ring(scene, ring, after)), (closed, verdict))


def duct(options: Options, output: Output) -> int:
    """Plan rings inside a duct; write joints.csv, contours.csv, ring pictures and duct.json."""
    check_folder(options.out)
    parameters = load_ring_parameters()
    if options.contours is None:
        shape, places = make_bend("trial bend", parameters.bend), options.at
        places = places or [find_station(shape, parameters.ring_z)]
    else:
        shape, places = read_duct(options.contours), options.at
    if not places:
        raise InputError(f"--at M is needed: where along the duct to spray, 0..{shape.station[-1]:.3f} m")
    scene = make_scene(shape)
    stand_off = parameters.stand_off if options.stand_off is None else options.stand_off
    rings = [make_ring(shape, at, parameters.count, stand_off) for at in places]
    tell = output.bar("rings")
    results: list[RingResult] = []
    for number, (at, ring) in enumerate(zip(places, rings, strict=True)):
        near = results[-1].closed[0].q[0] if results else None
        try:
            results.append(solve_ring(scene, ring, at, options.seed, near))
        except UnreachableError as error:
            raise UnreachableError(f"ring at {at:g} m: {error}") from None
        tell((number + 1) / len(rings))
    tree = {
        "ok": True,
        "duct": shape.name,
        "out": str(options.out),
        "stand_off_m": stand_off,
        "rings": [_ring_tree(scene.arm, result) for result in results],
    }
    files = {"contours.csv": encode_duct(shape), "joints.csv": _encode(scene.arm, results)}
    for number, result in enumerate(results, start=1):
        plans = [state for state in (result.before, result.after, result.closed) if state is not None]
        files[f"ring-{number}.png"] = draw_ring(scene, result.ring, plans)
    write_folder(options.out, files, "duct.json", tree)
    output.result(tree, "\n".join(_text(scene.arm, results, options.out)))
    return OK


def verdict_tree(arm: Arm, verdict: Verdict) -> dict[str, Any]:
    """Return a verdict's figures for JSON."""
    tilt = np.degrees(verdict.tilt)
    return {
        "colliding": verdict.colliding,
        "touching": verdict.touching,
        "clearance_min_m": float(verdict.clearance.min()),
        "nearest": verdict.nearest,
        "clearance_between_min_m": verdict.between,
        "place_error_m": verdict.place_error,
        "tilt_max_deg": float(tilt.max()),
        "tilted": int((tilt > TILTED_DEG).sum()),
        "open_end": verdict.open_end,
        "peak_acceleration": {
            f"q{joint.number}_{'m_s2' if joint.prismatic else 'rad_s2'}": float(peak)
            for joint, peak in zip(arm.joints, np.abs(verdict.acceleration).max(axis=0), strict=True)
        },
    }


TILTED_DEG = 0.01
"""Tilts below this are rounding."""


def _ring_tree(arm: Arm, result: RingResult) -> dict[str, Any]:
    return {
        "at_m": result.at,
        "poses": len(result.ring.T),
        "before": None if result.before is None else verdict_tree(arm, result.before[1]),
        "after": verdict_tree(arm, result.after[1]),
        "closed": verdict_tree(arm, result.closed[1]),
    }


def _text(arm: Arm, results: Iterable[RingResult], out: Path) -> list[str]:
    lines = []
    for result in results:
        rows = []
        states = (("gradient projection", result.before), ("with feedback", result.after))
        for name, state in (*states, ("closed ring", result.closed)):
            if state is None:
                rows.append([name, "out of range", *["-"] * 6])
                continue
            verdict = state[1]
            peak = np.abs(verdict.acceleration).max(axis=0)
            rows.append(
                [
                    name,
                    f"{verdict.colliding}/{len(verdict.clearance)}",
                    f"{1e3 * verdict.clearance.min():.1f} ({verdict.nearest})",
                    f"{1e3 * verdict.between:.1f}",
                    f"{np.degrees(verdict.tilt).max():.2f}",
                    f"{peak[arm.prismatic].max():.2f}",
                    f"{peak[~arm.prismatic].max():.2f}",
                    f"{verdict.open_end:.1e}",
                ]
            )
        head = ["poses touching", "least clearance [mm]", "between [mm]", "tilt [deg]"]
        head += ["peak m/s2", "peak rad/s2", "open end"]
        lines += [table([f"ring at {result.at:.3f} m", *head], rows), ""]
    return [*lines, f"-> {out}/joints.csv"]


def _encode(arm: Arm, results: Iterable[RingResult]) -> bytes:
    """Write the closed rings: one row per pose, the first again at the end of each ring."""
    units = np.where(arm.prismatic, 1.0, 180.0 / np.pi)
    names = [f"q{j.number}_{'m' if j.prismatic else 'deg'}" for j in arm.joints]
    lines = [",".join(["ring", "at_m", "pose", *names, "x_m", "y_m", "z_m", "tilt_deg", "clearance_mm"])]
    for number, result in enumerate(results, start=1):
        plan, verdict = result.closed
        n = len(plan.T)
        for row, q in enumerate(plan.q * units):
            pose = row % n
            values = [*q, *plan.T[pose, :3, 3], np.degrees(verdict.tilt[pose]), 1e3 * verdict.clearance[row]]
            lines.append(f"{number},{result.at:.4f},{pose + 1}," + ",".join(f"{x:.6f}" for x in values))
    return ("\n".join(lines) + "\n").encode()
