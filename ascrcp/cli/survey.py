"""align, thickness, section: what a surveyor asks of scanned and recognised rounds."""

from typing import Any

import numpy as np

from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder
from ascrcp.core.geometry import apply_transform
from ascrcp.perception.alignment import align
from ascrcp.perception.cross_section import cut_section
from ascrcp.perception.registration import register
from ascrcp.perception.survey import load_survey
from ascrcp.perception.thickness import (
    ThicknessMap,
    mean_per_block,
    measure_thickness,
    stable_points,
)
from ascrcp.session.round import Round
from ascrcp.session.store import read_scan, read_surface, write_archive, write_json


def align_lidar(options: Options, output: Output) -> int:
    """Find the pan head's zero from the lance in a round's scan (thesis 3.2)."""
    scan = read_scan(Round(options.round).need("scan", "scan"))
    found = align(scan, load_survey().alignment)
    tree = {
        "ok": True,
        "pan_zero_deg": float(np.degrees(found.pan_zero)),
        "sigma_deg": float(np.degrees(found.sigma)),
        "residual_mm": 1000 * found.residual,
        "length_m": found.length,
        "points": found.points,
    }
    output.result(
        tree,
        f"pan zero {tree['pan_zero_deg']:+.3f} deg, one sigma {tree['sigma_deg']:.3f} deg; "
        f"lance straight to {tree['residual_mm']:.1f} mm over {found.length:.2f} m, {found.points} echoes",
    )
    return OK


def thickness(options: Options, output: Output) -> int:
    """Register a second scan onto a recognised round and measure the layer between them."""
    if options.out.exists() and not options.out.is_dir():
        raise InputError(f"{options.out}: not a folder")
    before = read_surface(Round(options.round).need("surface", "recognise"))
    after = read_surface(Round(options.after).need("surface", "recognise"))
    survey = load_survey()
    output.say("  registering the second scan")
    found = register(stable_points(before), stable_points(after), survey.registration)
    moved = apply_transform(found.T_first_second, after.points.astype(float)).astype(np.float32)
    layer = measure_thickness(before.points, moved, before, survey.thickness)
    tree: dict[str, Any] = {
        "ok": True,
        "registration": {
            "T_first_second": found.T_first_second.tolist(),
            "residual_mm": 1000 * found.residual,
            "share": found.share,
            "converged": found.converged,
        },
        **describe(layer),
    }
    make_folder(options.out)
    write_json(options.out / "thickness.json", tree)
    grids = {name: getattr(layer, name) for name in ("station", "along", "thickness", "sigma", "sprayed")}
    write_archive(options.out / "thickness.npz", "thickness", {}, grids)
    output.result(
        tree,
        f"layer {1000 * layer.mean:.1f} mm on {layer.area:.1f} m2, {layer.volume:.2f} m3; noise of a cell "
        f"{1000 * layer.noise_floor:.1f} mm, of a square metre {1000 * layer.noise_floor_m2:.1f} mm; "
        f"unchanged wall {1000 * layer.bias:+.1f} mm -> {options.out}",
    )
    return OK


def describe(layer: ThicknessMap) -> dict[str, Any]:
    """Describe a layer in plain values; metres, square metres by rows of the unrolled wall."""
    row, column = (float(axis[1] - axis[0]) for axis in (layer.station, layer.along))
    blocks = mean_per_block(layer.thickness, layer.sprayed, row, column)
    return {
        "mean_m": layer.mean,
        "area_m2": layer.area,
        "volume_m3": layer.volume,
        "noise_floor_m": layer.noise_floor,
        "noise_floor_m2_m": layer.noise_floor_m2,
        "bias_m": layer.bias,
        "mean_per_m2_m": [[float(value) for value in line] for line in blocks],
    }


def section(options: Options, output: Output) -> int:
    """Cut a recognised round across the axis at one station."""
    surface = read_surface(Round(options.round).need("surface", "recognise"))
    found = cut_section(surface, options.station)
    tree = {
        "ok": True,
        "station": found.station,
        "along": found.along,
        "offset": found.offset,
        "filled": found.filled,
        "yz": found.yz,
        "area_beyond_m2": found.area_beyond,
        "area_inside_m2": found.area_inside,
    }
    known = float(np.mean(~np.isnan(found.offset)))
    output.result(
        tree,
        f"station {found.station:g} m: {found.area_beyond:.2f} m2 beyond the design line, "
        f"{found.area_inside:.2f} m2 inside; {100 * known:.0f} % known, "
        f"{100 * float(np.mean(found.filled)):.0f} % filled in (the whole section with --json)",
    )
    return OK
