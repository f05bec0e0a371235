"""What a further scan says of the layer: within noise what was laid, whatever the sensors say of the pose."""

from dataclasses import replace

import numpy as np
import pytest
from scanned_site import CONFIGURED, Site, build_site

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Label
from ascrcp.core.geometry import apply_transform, rotation
from ascrcp.perception.survey import load_survey
from ascrcp.planning.respray import find_respray
from ascrcp.session.achieved import Achieved, carry_labels, measure_achieved


@pytest.fixture(scope="module")
def site() -> Site:
    return build_site()


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
