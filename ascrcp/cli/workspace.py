"""workspace: how far an arm reaches, and how much of a heading it can spray from its parking place."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.cli import workspace_picture as picture
from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.cli.wall_cell import WallCells, imagine_heading, lay_cells
from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder, write_atomic
from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array
from ascrcp.core.profile import load_profile
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.barrier import make_barrier
from ascrcp.kinematics.candidate import make_grid
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.lean import LeanSearch
from ascrcp.kinematics.reach import Parking, ReachMap, compare_places, find_reach
from ascrcp.kinematics.smooth import make_cost
from ascrcp.kinematics.spacing import STAND_OFF
from ascrcp.kinematics.workspace import (
    Extreme,
    ReachConfig,
    WorkspaceConfig,
    find_extremes,
    load_config,
    sample_cloud,
)
from ascrcp.planning.parameter import load_parameters as load_planning
from ascrcp.session.round import Round
from ascrcp.session.store import read_surface, write_json
from ascrcp.session.surroundings import find_obstacles

DECIMALS = 4

HIT = "every posture within reach would hit something"


def workspace(options: Options, output: Output) -> int:
    """Write cloud, extremes, reach map, parking comparison and pictures into --out."""
    arm, config = load_arm(options.machine), load_config()
    surface = _find_surface(options, config)
    if surface is not None and arm.held != (5, 6):
        raise InputError(f"machine {arm.name} sprays no tunnel wall: leave --round and --profile out")
    if options.out.exists() and not options.out.is_dir():
        raise InputError(f"{options.out}: not a folder")
    rng = np.random.default_rng([options.seed, 3])
    cloud = sample_cloud(arm, config.cloud_samples, rng, options.load_kg)
    extremes = find_extremes(arm, config.search_starts, rng)
    files: dict[str, bytes] = {"cloud.csv": _encode(("X/mm", "Y/mm", "Z/mm"), cloud * 1e3)}
    tree: dict[str, Any] = {"ok": True, "machine": arm.name, "out": str(options.out)}
    tree["extremes_m"] = {name: round(end.value, 6) for name, end in extremes.items()}
    lines = [_extremes_text(arm, extremes)]
    cells = None
    if surface is not None:
        cells, reach = _map_heading(arm, surface, config, options.load_kg, output)
        blocked = _find_blocked(options, arm, cells, reach)
        parking = _compare(arm, surface, config, options.load_kg, output)
        files["reach.csv"] = _encode_reach(arm, cells, reach, blocked)
        files["reach.png"] = picture.draw_reach(arm, cells, reach, blocked)
        files["parking.png"] = picture.draw_parking(parking)
        tree |= _heading_tree(arm, cells, reach, blocked, parking)
        lines += _heading_text(tree)
    files["workspace.png"] = picture.draw_workspace(arm, cloud, extremes, cells)
    _write(options.out, files, tree)
    output.result(
        tree, "\n".join([*lines, f"-> {options.out}: {', '.join(sorted([*files, 'workspace.json']))}"])
    )
    return OK


def _find_surface(options: Options, config: WorkspaceConfig) -> Surface | None:
    if options.round is not None and options.profile is not None:
        raise InputError("give --round or --profile, not both")
    if options.round is not None:
        return read_surface(Round(options.round).need("surface", "recognise"))
    if options.profile is not None:
        return imagine_heading(load_profile(options.profile), config.heading)
    return None


def _map_heading(
    arm: Arm, surface: Surface, config: WorkspaceConfig, payload_kg: float, output: Output
) -> tuple[WallCells, ReachMap]:
    cells = lay_cells(surface, load_planning().path, config.cell_m)
    if not cells.asked.any():
        raise InputError("nothing of this wall is to be sprayed: unseen, or too near the floor")
    return cells, find_reach(arm, cells.T, config.reach, payload_kg, output.bar("reach map"))


def _find_blocked(options: Options, arm: Arm, cells: WallCells, reach: ReachMap) -> NDArray[np.bool_] | None:
    """Mark cells within reach where every posture would hit what the round's scan saw, shape (m,).

    Looked at as solving does: the posture with most margin first, then the candidates over roll, q5, q6
    and the leans the process allows. None where no scan or no shapes of links are known.
    """
    model, room = arm.description.path, arm.description.clearance
    if options.round is None or model is None or room is None:
        return None
    obstacles = find_obstacles(Round(options.round), arm, load_planning())
    if obstacles is None:
        return None
    blocked = np.zeros(len(cells.T), dtype=bool)
    rows = np.flatnonzero(cells.asked & reach.reachable)
    rows = rows[~(least_distance(arm, reach.q[rows], obstacles) >= room.least)]
    search = LeanSearch(
        arm,
        model,
        make_cost(arm, model),
        make_grid(arm, model),
        make_barrier(arm, obstacles),
        room.wanted,
        float(np.radians(room.tilt_limit_deg)),
        STAND_OFF,
        options.load_kg,
    )
    alone = np.full(len(rows), np.inf)
    none = np.zeros(len(rows), dtype=bool)
    found = search.find(cells.path, rows, alone, reach.q[rows], none, np.zeros((len(rows), 3)))
    blocked[rows] = ~(found.best >= room.least)
    return blocked


def _compare(
    arm: Arm, surface: Surface, config: WorkspaceConfig, payload_kg: float, output: Output
) -> Parking:
    p = config.parking
    cells = lay_cells(surface, load_planning().path, p.cell_m)
    count = round((p.to_m - p.from_m) / p.step_m)
    places = np.unique(np.append(np.linspace(p.from_m, p.to_m, count + 1), 0.0).round(6))
    coarse = ReachConfig(
        roll_step_deg=config.reach.roll_step_deg,
        yaw_candidates=p.yaw_candidates,
        telescope_candidates=p.telescope_candidates,
        starts=p.starts,
        refine_rounds=config.reach.refine_rounds,
    )
    T = cells.T[cells.asked]
    return compare_places(arm, T, places, coarse, payload_kg, output.bar("parking places"))


def _heading_tree(
    arm: Arm, cells: WallCells, reach: ReachMap, blocked: NDArray[np.bool_] | None, parking: Parking
) -> dict[str, Any]:
    asked, reached = cells.asked, cells.asked & reach.reachable
    if blocked is not None:
        reached = reached & ~blocked
    reasons: dict[str, int] = {}
    for row in np.flatnonzero(asked & ~reach.reachable):
        joint = reach.joint[row]
        who = "no posture" if joint < 0 else f"joint {joint + 1} {arm.joints[joint].name}"
        reasons[who] = reasons.get(who, 0) + 1
    best = parking.best
    return {
        "reach": {
            "cells": int(asked.sum()),
            "reachable": int(reached.sum()),
            "covered": float(reached.sum() / asked.sum()),
            "margin_mean": float(reach.margin[reached].mean()) if reached.any() else None,
            "margin_min": float(reach.margin[reached].min()) if reached.any() else None,
            "out_of_reach": dict(sorted(reasons.items(), key=lambda item: -item[1])),
            "clearance_considered": blocked is not None,
            "blocked": None if blocked is None else int(blocked.sum()),
        },
        "parking": {
            "forward_m": parking.offset.tolist(),
            "covered": parking.covered.tolist(),
            "margin_mean": parking.margin.tolist(),
            "best_forward_m": float(parking.offset[best]),
            "best_covered": float(parking.covered[best]),
        },
    }


def _heading_text(tree: dict[str, Any]) -> list[str]:
    reach, parking = tree["reach"], tree["parking"]
    clear = reach["clearance_considered"]
    about = f"{reach['blocked']} more would hit something" if clear else "obstacles are not known"
    share = f"{reach['reachable']} of {reach['cells']} cells ({reach['covered']:.1%})"
    lines = [f"{share} can be sprayed from here; {about}"]
    lines += [f"  {count} cells out of reach: {who}" for who, count in reach["out_of_reach"].items()]
    lines.append(
        f"best parking: {parking['best_forward_m']:+.2f} m forward of here, {parking['best_covered']:.1%}"
    )
    return lines


def _extremes_text(arm: Arm, extremes: dict[str, Extreme]) -> str:
    units = np.where(arm.prismatic, 1.0, 180.0 / np.pi)
    rows = [
        [name, f"{1e3 * end.value:.1f}", *(f"{x:.2f}" for x in end.q * units)]
        for name, end in extremes.items()
    ]
    names = [f"q{j.number} [{'m' if j.prismatic else 'deg'}]" for j in arm.joints]
    return table(["rigid tool, base frame", "mm", *names], rows)


def _encode(columns: tuple[str, ...], values: Array) -> bytes:
    rows = [",".join(columns), *(",".join(f"{x:.1f}" for x in row) for row in values.tolist())]
    return ("\n".join(rows) + "\n").encode()


def _encode_reach(arm: Arm, cells: WallCells, reach: ReachMap, blocked: NDArray[np.bool_] | None) -> bytes:
    """One row per cell; margin and room are empty where no posture is real."""
    hit = np.zeros(len(cells.T), dtype=bool) if blocked is None else blocked
    stations = np.repeat(cells.station, len(cells.along))
    along = np.tile(cells.along, len(cells.station))
    joints = [f"q{j.number}_{'mm' if j.prismatic else 'deg'}" for j in arm.joints]
    header = ["station/m", "along/m", "angle/deg", "X/mm", "Y/mm", "Z/mm", "asked", "reachable"]
    lines = [",".join([*header, "margin/%", "joint", "room", *joints, "reason"])]
    units = np.where(arm.prismatic, 1e3, 180.0 / np.pi)
    for row, point in enumerate(cells.point * 1e3):
        joint = int(reach.joint[row])
        real = joint >= 0
        unit = units[joint] if real else 1.0
        place = [stations[row], along[row], np.degrees(cells.angle[row]), *point]
        lines.append(
            ",".join(
                [
                    *(f"{x:.3f}" for x in place),
                    str(int(cells.asked[row])),
                    str(int(reach.reachable[row] and not hit[row])),
                    f"{100 * reach.margin[row]:.2f}" if real else "",
                    str(joint + 1) if real else "",
                    f"{reach.room[row] * unit:.{DECIMALS}f}" if real else "",
                    *(f"{x:.{DECIMALS}f}" if real else "" for x in reach.q[row] * units),
                    f'"{HIT if hit[row] else reach.reason(arm, row) or ""}"',
                ]
            )
        )
    return ("\n".join(lines) + "\n").encode()


def _write(folder: Path, files: dict[str, bytes], tree: dict[str, Any]) -> None:
    """Write everything, now that nothing can fail but the disk."""
    make_folder(folder)
    for name, data in files.items():
        write_atomic(folder / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
    write_json(folder / "workspace.json", tree)
