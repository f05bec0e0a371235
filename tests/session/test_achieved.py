"""What a further scan says of the layer: within noise what was laid, whatever the sensors say of the pose."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ascrcp.core.config import load
from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Cloud, Label, Scan, Surface
from ascrcp.core.geometry import Array, apply_transform, rotation
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics import load_arm
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.perception.project import project
from ascrcp.perception.recognise import recognise
from ascrcp.perception.survey import load_survey
from ascrcp.planning.parameter import load_parameters
from ascrcp.planning.respray import find_respray
from ascrcp.session.achieved import Achieved, carry_labels, measure_achieved
from ascrcp.simulation.bare_wall import Bare, grow_heading, lay_bare
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import TunnelConfig

ARM = load_arm("kc")
CONFIGURED = load_parameters()
OVERLAY = {
    "bodies": [],
    "length": {"rear": -3.0, "unsprayed_length": [1.6, 1.7]},
    "arches": {"count": 1, "first": [0.7, 0.8]},
    "pockets": {"count": 1, "angle_deg": [40.0, 140.0]},
    "bumps": {"count": 0},
}
PAN_STEP_DEG = 0.5  # a sixth of the machine's points would do; coarser leaves cells empty


@dataclass(frozen=True)
class Site:
    """A small heading, scanned and recognised."""

    heading: Heading
    bare: Bare
    surface: Surface

    def scan(self, rock: Array, flange: Array, number: int) -> np.ndarray:
        """Scan the heading with a layer on, with noise of its own; points in the base frame."""
        return look(grow_heading(self.heading, self.bare, rock, flange), number)

    def measure(self, points: np.ndarray) -> Achieved:
        return measure_achieved(points, self.surface, None, CONFIGURED, load_survey())


def look(heading: Heading, number: int) -> np.ndarray:
    config = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)
    lidar, rng = LidarModel(config, heading), np.random.default_rng([9, number])
    mount, pan = ARM.lidar(ARM.zero_pose), np.radians(np.arange(-90.0, 90.0, PAN_STEP_DEG))
    ranges = np.array([lidar.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
    return project(Scan(ranges, config.beam, pan, ARM.zero_pose), mount).points


@pytest.fixture(scope="module")
def site() -> Site:
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, OVERLAY)
    heading = build_heading(tunnel, np.random.default_rng(12))
    points = look(heading, 0)
    surface = recognise(Cloud(points), heading.truth.profile, load_perception())
    return Site(heading, lay_bare(heading, 0.05, 0.15), surface)


@pytest.fixture(scope="module")
def even(site: Site) -> Achieved:
    """50 mm on the rock and 20 mm on the arches."""
    rock = np.full(site.bare.rock.shape, 0.05)
    return site.measure(site.scan(rock, np.full(rock.shape, 0.02), 1))


def on_rock(found: Achieved) -> np.ndarray:
    """Cells of rock away from arches, ends and feet."""
    target = found.target
    middle = (target.along > 2.0) & (target.along < target.along[-1] - 2.0)
    near = np.zeros_like(target.arch)
    for lid in target.arches:
        near |= np.abs(target.station[:, None] - lid.station) < lid.half + 0.1
    return target.inside & ~near & middle & np.isfinite(found.layer)


def test_an_even_layer_is_found_even(even: Achieved) -> None:
    layer = even.layer[on_rock(even)]
    assert np.median(layer) == pytest.approx(0.05, abs=0.004)
    assert np.quantile(np.abs(layer - 0.05), 0.8) < 0.012
    assert even.figures["noise_mm"] < 10.0 and abs(even.figures["bias_mm"]) < 3.0


def test_the_volume_is_that_of_the_layer(even: Achieved) -> None:
    target = even.target
    seen = np.isfinite(even.layer) & target.inside
    laid = np.where(target.arch, 0.02, 0.05)
    found = (even.layer * target.area)[seen].sum()
    assert found == pytest.approx((laid * target.area)[seen].sum(), rel=0.08)


def test_an_unsprayed_wall_has_no_layer_and_is_as_thin_as_before(site: Site) -> None:
    none = np.zeros(site.bare.rock.shape)
    found = site.measure(site.scan(none, none, 2))
    assert abs(np.median(found.layer[on_rock(found)])) < 0.003
    assert found.figures["within_tolerance"] < 0.5
    assert found.figures["too_thin"] > 0.4


def test_a_pose_told_wrongly_is_taken_out(site: Site, even: Achieved) -> None:
    rock = np.full(site.bare.rock.shape, 0.05)
    points = site.scan(rock, np.full(rock.shape, 0.02), 3)
    T = np.eye(4)
    T[:3, :3] = rotation("z", np.radians(0.08)) @ rotation("y", np.radians(-0.06))
    T[:3, 3] = 0.006, -0.008, 0.01
    told = apply_transform(T, points.astype(float)).astype(np.float32)
    found = site.measure(told)
    both = on_rock(found) & on_rock(even)
    assert np.median(found.layer[both]) == pytest.approx(np.median(even.layer[both]), abs=0.003)


def test_the_wall_comes_nearer_for_what_moves_next(site: Site, even: Achieved) -> None:
    before, after = site.surface.offset, even.surface.offset
    inside = (site.surface.station > site.surface.unsprayed[0] + 0.3) & (
        site.surface.station < site.surface.unsprayed[1] - 0.3
    )
    known = np.isfinite(before[inside])
    assert np.median((before - after)[inside][known]) == pytest.approx(0.05, abs=0.01)
    assert (np.nan_to_num(before - after) >= 0.0).all(), "never further than it was"
    behind = site.surface.station < site.surface.unsprayed[0] - 0.1
    np.testing.assert_array_equal(np.nan_to_num(before[behind]), np.nan_to_num(after[behind]))


def test_what_lacks_concrete_is_what_the_next_spraying_sprays(site: Site) -> None:
    """Spray the left half to the target: the thin cells that remain are those of the right half."""
    bare = site.bare
    left = bare.along > site.surface.profile.length / 2
    wanted = np.minimum(0.0, bare.rock - 0.03)
    rock = np.where(left, np.maximum(bare.rock - wanted, 0.0), 0.0)
    flange = np.where(left, 0.02, 0.0) * np.ones(rock.shape)
    found = site.measure(site.scan(rock, flange, 4))
    thin = find_respray(found.target, found.after, site.surface.unsprayed, CONFIGURED.process).thin
    mine = found.target.along > site.surface.profile.length / 2 + 0.3
    assert thin[:, ~mine].sum() > 4 * thin[:, mine].sum()


def test_bodies_that_have_come_are_no_wall(site: Site) -> None:
    points = np.concatenate([site.surface.points, np.array([[9.0, 0.0, -0.5], [9.1, 0.0, -0.5]], np.float32)])
    labels = carry_labels(points, site.surface)
    assert (labels[-2:] == Label.OTHER).all()
    assert (labels[:-2] == site.surface.labels).mean() > 0.97


def test_another_place_is_refused(site: Site) -> None:
    elsewhere = site.surface.points + np.array([0.0, 3.0, 2.0], np.float32)
    with pytest.raises(RecognitionError):
        measure_achieved(elsewhere, replace(site.surface), None, CONFIGURED, load_survey())
