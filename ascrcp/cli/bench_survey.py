"""Alignment of the lidar, second scans and layers on simulated headings, scanned as the rig scans."""

from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.cli.bench import Figure, Say
from ascrcp.core.config import load
from ascrcp.core.flow import Cloud, Scan, Surface
from ascrcp.core.geometry import Array, apply_transform, rotation, transform
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import load_arm
from ascrcp.perception.alignment import align
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.project import project
from ascrcp.perception.recognise import recognise
from ascrcp.perception.registration import register
from ascrcp.perception.survey import SurveyParameters, load_survey
from ascrcp.perception.thickness import mean_per_block, measure_thickness, stable_points
from ascrcp.simulation.heading import build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import TunnelConfig

PAN_STEP_DEG = 0.25
"""As the rig sweeps."""

LANCE_DEG = 30.0
"""Lines farther off look past the lance: they say nothing about the pan zero."""

ALIGNMENTS = 12
PAIRS = 3
MAX_ZERO_DEG = 2.0
"""Drawn errors of the pan zero; placeholder."""

LAYER = 0.080
"""Concrete sprayed between the two scans [m]."""

PARKED, TURNED_DEG = 0.15, 1.0
"""The machine is parked anew by up to so much [m, deg]; placeholder."""


@dataclass(frozen=True)
class Pair:
    """How two scans of one wall agree, and the layer found between it and a third.

    Attributes:
        away_mm: Mean distance of the second scan's points from where they belong [mm].
        blocks_mm: Error of the layer's mean on each square metre [mm], shape (n,).
    """

    away_mm: float
    blocks_mm: Array


def measure_survey(seed: int, say: Say) -> list[Figure]:
    """Measure alignment, second scans and layers; every figure hangs on the seed alone."""
    say(f"bench: {ALIGNMENTS} alignments of the lidar")
    rng = np.random.default_rng(seed)
    errors = [abs(alignment_error(rng)) for _ in range(ALIGNMENTS)]
    pairs = []
    for number in range(PAIRS):
        say(f"bench: second scans, {number + 1} of {PAIRS}")
        pairs.append(measure_pair(seed + number))
    blocks = np.concatenate([np.abs(pair.blocks_mm) for pair in pairs])
    away = max(pair.away_mm for pair in pairs)
    return [
        Figure("alignment", max(errors), "deg", 0.05, note=f"largest of {ALIGNMENTS}; {median(errors):.2g}"),
        Figure("two scans of one wall", away, "mm", 3.0, note=f"mean over the points; largest of {PAIRS}"),
        Figure(
            f"layer of {1000 * LAYER:.0f} mm, a square metre",
            float(blocks.max()),
            "mm",
            5.0,
            note=f"largest of {len(blocks)}; median {np.median(blocks):.2g}",
        ),
    ]


def alignment_error(rng: np.random.Generator) -> float:
    """Draw a heading, a pose of the arm and a pan zero, scan, align: found less true [deg]."""
    zero = float(rng.uniform(-MAX_ZERO_DEG, MAX_ZERO_DEG))
    config = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig, {"pan_zero_deg": zero})
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig)
    arm = load_arm("kc")
    q = arm.zero_pose.copy()
    q[[0, 1, 4]] += np.radians(rng.uniform(-5.0, 5.0, 3))
    model = LidarModel(config, build_heading(tunnel, rng))
    scan = _scan(model, config, arm.lidar(q), q, LANCE_DEG, rng)
    return float(np.degrees(align(scan, load_survey().alignment).pan_zero)) + zero


def measure_pair(seed: int) -> Pair:
    """Scan a heading, park the machine anew, scan again, then once more with a layer on the rock."""
    survey, rng = load_survey(), np.random.default_rng([seed, 1])
    first = _points(seed, 0.0, np.eye(4), rng)
    turn = np.radians(rng.uniform(-TURNED_DEG, TURNED_DEG, 3))
    R = rotation("z", turn[0]) @ rotation("y", turn[1]) @ rotation("x", turn[2])
    T = transform(R, rng.uniform(-PARKED, PARKED, 3))
    surface = _recognised(first)
    away = []
    for layer in (0.0, LAYER):
        points = _points(seed, layer, T, rng)
        found = register(stable_points(surface), stable_points(_recognised(points)), survey.registration)
        every = points[:: max(1, len(points) // 5000)].astype(float)
        apart = apply_transform(found.T_first_second, every) - apply_transform(T, every)
        away.append(1000.0 * float(np.linalg.norm(apart, axis=1).mean()))
        moved = apply_transform(found.T_first_second, points.astype(float)).astype(np.float32)
    return Pair(max(away), 1000.0 * (_blocks(first, moved, surface, survey) - LAYER))


def _blocks(
    first: NDArray[np.float32], second: NDArray[np.float32], surface: Surface, survey: SurveyParameters
) -> Array:
    """Mean thickness of every square metre that was measured [m]."""
    layer = measure_thickness(first, second, surface, survey.thickness)
    row, column = (float(axis[1] - axis[0]) for axis in (layer.station, layer.along))
    blocks = mean_per_block(layer.thickness, layer.sprayed, row, column)
    return np.asarray(blocks[~np.isnan(blocks)])


def _points(seed: int, layer: float, T_first_base: Array, rng: np.random.Generator) -> NDArray[np.float32]:
    """Scan the heading of a seed from a base that stands elsewhere; points in that base's frame (n, 3)."""
    config = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)
    tree: dict[str, Any] = {"rock": {"layer": layer}}
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, tree)
    arm = load_arm("kc")
    mount = arm.lidar(arm.zero_pose)
    model = LidarModel(config, build_heading(tunnel, np.random.default_rng(seed)))
    scan = _scan(model, config, T_first_base @ mount, arm.zero_pose, 90.0, rng)
    return project(scan, mount).points


def _recognised(points: NDArray[np.float32]) -> Surface:
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig)
    return recognise(Cloud(points), tunnel.load_profile(), load_parameters())


def _scan(
    model: LidarModel, config: LidarConfig, mount: Array, q: Array, reach_deg: float, rng: np.random.Generator
) -> Scan:
    pan = np.radians(np.arange(-reach_deg, reach_deg + 1e-9, PAN_STEP_DEG))
    ranges = np.array([model.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
    return Scan(ranges, config.beam, pan, q)
