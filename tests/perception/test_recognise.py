"""Recognition on synthetic headings with exact truth: arches, pockets, axis, extent, and what is refused."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from synthetic_heading import CIRCLE, Heading, Recipe, Truth, circle, three_centre
from verdict import judge

from ascrcp.core.errors import CancelledError, RecognitionError
from ascrcp.core.flow import Cloud, Label, Surface
from ascrcp.perception.features import build_features, shadow_volume
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.recognise import recognise

PARAMETERS = load_parameters()

RECIPES = {
    "leaning": Recipe(seed=11, lean_deg=5.0, rays=150_000),
    "steep, yawed, beside the axis": Recipe(
        seed=12, yaw_deg=8.0, grade_percent=5.0, arches=3, axis_y=0.8, rays=150_000
    ),
    "no arch": Recipe(seed=13, yaw_deg=-8.0, grade_percent=-5.0, arches=0, rays=120_000),
    "three-centre, four arches": Recipe(
        seed=14,
        profile=three_centre(),
        arches=4,
        lean_deg=4.0,
        axis_y=-0.7,
        axis_z=-1.0,
        floor=-1.3,
        rays=200_000,
    ),
    "small": Recipe(seed=15, profile=circle(4.2), floor=-1.4, axis_z=-1.5, arches=1, rays=120_000),
    "large": Recipe(seed=16, profile=circle(7.0), yaw_deg=6.0, rays=200_000),
    "short sprayed part, not concentric": Recipe(
        seed=17, sprayed=6.0, arch_shift=0.015, dust=0.01, rays=150_000
    ),
    "no pocket, rough": Recipe(seed=18, pockets=0, rough=0.06, lean_deg=5.0, rays=150_000),
}


@dataclass(frozen=True)
class Case:
    surface: Surface
    features: dict[str, Any]
    truth: Truth
    heading: Heading


@cache
def case(name: str) -> Case:
    recipe = RECIPES[name]
    heading = Heading(recipe)
    points = heading.cast()
    timing: dict[str, float] = {}
    surface = recognise(Cloud(points), recipe.profile, PARAMETERS, timing=timing)
    return Case(surface, build_features(surface, len(points), timing), heading.truth(), heading)


@pytest.mark.parametrize("name", RECIPES)
def test_finds_every_arch_and_pocket_and_nothing_else(name: str) -> None:
    c = case(name)
    verdict = judge(c.features, c.truth, c.surface.profile)
    assert not verdict.missed_arches and not verdict.false_arches
    assert not verdict.missed_pockets and not verdict.false_regions
    assert all(abs(e) <= 25.0 for e in verdict.station_mm)
    assert all(abs(e) <= 0.5 for e in verdict.lean_deg)
    assert verdict.unsprayed_m <= 0.05


@pytest.mark.parametrize("name", RECIPES)
def test_axis_is_near_the_truth_and_knows_how_near(name: str) -> None:
    c = case(name)
    verdict = judge(c.features, c.truth, c.surface.profile)
    assert verdict.axis_deg <= 0.15
    assert verdict.axis_mm <= 15.0
    assert verdict.axis_deg <= 4.0 * c.surface.axis.direction_sigma_deg
    assert "sprayed" in c.surface.axis.evidence


def test_bare_rock_is_recognised_and_its_axis_said_to_be_uncertain() -> None:
    recipe = Recipe(seed=21, sprayed=0.0, rough=0.03, rays=150_000)
    heading = Heading(recipe)
    surface = recognise(Cloud(heading.cast()), recipe.profile, PARAMETERS)
    verdict = judge(build_features(surface, 1, {}), heading.truth(), recipe.profile, limit_m=0.08)
    assert not verdict.missed_arches and not verdict.false_arches
    assert "sprayed" not in surface.axis.evidence
    assert surface.axis.direction_sigma_deg >= 0.15
    assert verdict.axis_deg <= 3.0 * surface.axis.direction_sigma_deg


@pytest.mark.parametrize("name", RECIPES)
def test_wall_cells_that_were_seen_hold_the_true_offset(name: str) -> None:
    c = case(name)
    s = c.surface
    seen = ~s.filled & np.isfinite(s.offset) & (s.station > s.unsprayed[0] + 0.1)[:, None]
    row, column = np.nonzero(seen)
    error = s.offset[row, column] - c.heading.wall(s.station[row], s.along[column])
    assert abs(np.median(error)) <= 0.015
    assert np.percentile(np.abs(error), 80) <= 0.03


@pytest.mark.parametrize("name", RECIPES)
def test_volume_of_what_was_seen(name: str) -> None:
    c = case(name)
    seen = c.features["overbreak_volume_m3"]
    deep = sum(1 for area in c.truth.pocket_seen if area >= 0.2)
    if deep == 0:
        assert seen <= 0.02
        return
    # which cells were seen is a matter of definition: the truth bridges no gap between scan lines
    assert 0.85 * c.truth.volume_seen <= seen <= 1.35 * c.truth.volume_seen
    assert c.features["overbreak_volume_shadow_m3"] == shadow_volume(c.surface) >= 0.0


@pytest.mark.parametrize("name", RECIPES)
def test_bays_and_arches_tile_the_unsprayed_part(name: str) -> None:
    surface = case(name).surface
    length = sum(b.station[1] - b.station[0] for b in surface.bays)
    steel = sum(a.width for a in surface.arches)
    assert length + steel == pytest.approx(surface.unsprayed[1] - surface.unsprayed[0], abs=0.05)
    assert [b.station for b in surface.bays] == sorted(b.station for b in surface.bays)
    assert {b.arch_after for b in surface.bays} >= set(range(len(surface.arches)))


def test_labels_name_what_the_points_lie_on() -> None:
    c = case("leaning")
    s = c.surface
    assert len(s.labels) == len(s.points) == c.features["points"]["kept"]
    counts = {label: int(np.sum(s.labels == label)) for label in Label}
    assert all(counts[label] > 100 for label in Label)
    local = (s.points - c.truth.point) @ s.axis.T_base_tunnel[:3, :3]
    _, offset = s.profile.locate(local[:, 1:])
    assert abs(np.median(offset[s.labels == Label.ARCH]) - s.profile.arch_line) < 0.03
    assert np.median(offset[s.labels == Label.OVERBREAK]) > s.profile.overbreak_line
    assert np.abs(np.median(local[s.labels == Label.FACE, 0]) - c.truth.unsprayed[1]) < 0.05


def test_same_cloud_gives_the_same_surface_and_leaves_the_cloud_alone() -> None:
    heading = Heading(replace(RECIPES["small"], rays=80_000))
    cloud = Cloud(heading.cast())
    before = cloud.points.copy()
    first, second = (recognise(cloud, heading.profile, PARAMETERS) for _ in range(2))
    assert np.array_equal(first.offset, second.offset, equal_nan=True)
    assert np.array_equal(first.labels, second.labels)
    assert first.arches == second.arches and first.overbreak == second.overbreak
    assert np.array_equal(cloud.points, before)


def test_order_of_the_points_does_not_matter() -> None:
    heading = Heading(replace(RECIPES["small"], rays=80_000))
    points = heading.cast()
    shuffled = np.random.default_rng(0).permutation(points)
    first, second = (recognise(Cloud(p), heading.profile, PARAMETERS) for p in (points, shuffled))
    assert [a.station for a in first.arches] == pytest.approx([a.station for a in second.arches], abs=0.01)
    assert len(first.overbreak) == len(second.overbreak)


def test_progress_rises_and_may_cancel() -> None:
    heading = Heading(replace(RECIPES["small"], rays=60_000))
    cloud = Cloud(heading.cast())
    told: list[tuple[str, float]] = []
    timing: dict[str, float] = {}
    recognise(cloud, heading.profile, PARAMETERS, lambda s, f: told.append((s, f)), timing)
    assert [f for _, f in told] == sorted(f for _, f in told)
    assert [s for s, _ in told] == list(timing)

    def cancel(step: str, fraction: float) -> None:
        if step == "axis":
            raise CancelledError("cancelled by the operator")

    with pytest.raises(CancelledError):
        recognise(cloud, heading.profile, PARAMETERS, cancel)


def _sphere(radius: float) -> np.ndarray:
    v = np.random.default_rng(1).standard_normal((150_000, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True) * radius + [6.0, 0.0, 0.0]


def _room() -> np.ndarray:
    rng = np.random.default_rng(2)
    points = rng.uniform(-5.5, 5.5, (150_000, 3))
    side = rng.integers(0, 6, len(points))
    points[np.arange(len(points)), side % 3] = np.where(side < 3, -5.5, 5.5)
    return points + np.array([6.0, 0.0, 0.0])


NO_TUNNEL = {
    "random cube": lambda: np.random.default_rng(0).uniform(-7, 7, (200_000, 3)),
    "floor": lambda: np.random.default_rng(0).uniform((-5, -5, -2), (15, 5, -1.99), (100_000, 3)),
    "one wall": lambda: np.random.default_rng(0).uniform((0, 4.98, -3), (15, 5.02, 5), (100_000, 3)),
    "sphere of the profile's radius": lambda: _sphere(5.9),
    "larger sphere": lambda: _sphere(6.2),
    "square room": _room,
    "one place": lambda: np.zeros((100_000, 3)),
    "few points": lambda: np.random.default_rng(0).uniform(-5, 5, (500, 3)),
    "one point": lambda: np.zeros((1, 3)),
    "not finite": lambda: np.full((5000, 3), np.nan),
    "far away": lambda: np.random.default_rng(0).uniform((-5, 495, -5), (5, 505, 5), (100_000, 3)),
}


@pytest.mark.parametrize("name", NO_TUNNEL)
def test_refuses_a_cloud_without_a_tunnel(name: str) -> None:
    points = NO_TUNNEL[name]().astype(np.float32)
    cloud = Cloud(points[np.isfinite(points).all(axis=1)])
    with pytest.raises(RecognitionError, match="no tunnel found") as caught:
        recognise(cloud, CIRCLE, PARAMETERS)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("radius", [4.5, 5.4, 5.6, 6.3, 7.0])
def test_refuses_another_tunnels_profile(radius: float) -> None:
    recipe = RECIPES["no pocket, rough"]
    with pytest.raises(RecognitionError, match="profile"):
        recognise(Cloud(Heading(replace(recipe, rays=80_000)).cast()), circle(radius), PARAMETERS)


def test_only_sprayed_surface_leaves_nothing_to_spray() -> None:
    rng = np.random.default_rng(3)
    a, r = rng.uniform(np.radians(-20), np.radians(200), 200_000), 5.67 + 0.01 * rng.standard_normal(200_000)
    points = np.stack([rng.uniform(0, 14, len(a)), -r * np.cos(a), r * np.sin(a) - 1.8], axis=-1)
    surface = recognise(Cloud(points.astype(np.float32)), CIRCLE, PARAMETERS)
    assert surface.unsprayed[1] - surface.unsprayed[0] == 0.0
    assert not surface.arches and not surface.overbreak and not surface.bays
