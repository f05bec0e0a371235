"""The heading that this project's own generators did not make: ../shared/data/round_a.ply with its truth."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_heading import Truth
from verdict import axis_error

from ascrcp.core.flow import Surface
from ascrcp.core.profile import load_profile
from ascrcp.perception.features import build_features
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.reader import read_cloud
from ascrcp.perception.recognise import recognise

DATA = Path(__file__).parents[3] / "shared" / "data"

pytestmark = pytest.mark.skipif(not (DATA / "round_a.ply").exists(), reason="../shared/data is not there")


@pytest.fixture(scope="module")
def found() -> tuple[Surface, dict[str, Any]]:
    cloud = read_cloud(DATA / "round_a.ply")
    timing: dict[str, float] = {}
    profile = load_profile(DATA / "round_a.profile.yaml")
    surface = recognise(cloud, profile, load_parameters(), timing=timing)
    return surface, json.loads(json.dumps(build_features(surface, len(cloud.points), timing)))


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    return json.loads((DATA / "round_a.json").read_text())


def test_both_arches_and_nothing_else(found: tuple[Surface, dict[str, Any]], truth: dict[str, Any]) -> None:
    stations = [a["station"] for a in found[1]["arches"]]
    assert stations == pytest.approx([a["station"] for a in truth["arches"]], abs=0.010)
    assert [a["lean_deg"] for a in found[1]["arches"]] == pytest.approx([0.0, 0.0], abs=0.2)
    assert [a["width"] for a in found[1]["arches"]] == pytest.approx([0.2, 0.2], abs=0.01)


def test_all_pockets_and_nothing_else(found: tuple[Surface, dict[str, Any]], truth: dict[str, Any]) -> None:
    regions = found[1]["overbreak"]
    assert len(regions) == len(truth["overbreak"]) == 3
    for pocket in truth["overbreak"]:
        assert any(
            region["angle_deg"][0] < pocket["angle_deg"] < region["angle_deg"][1]
            and region["station"][0] - 0.2 < pocket["station"] < region["station"][1] + 0.2
            for region in regions
        )


def test_axis_and_unsprayed_part(found: tuple[Surface, dict[str, Any]], truth: dict[str, Any]) -> None:
    features = found[1]
    point, direction = (np.array(truth["axis"][k]) for k in ("point", "direction"))
    first, last = truth["unsprayed"]
    angle, lateral = axis_error(features, Truth(point, direction, (first, last)))
    assert angle <= 0.1
    assert lateral <= 10.0
    assert np.linalg.norm(np.array(features["axis"]["point"]) - point) <= 0.010
    assert features["unsprayed"] == pytest.approx([first, last], abs=0.02)


def test_volume_seen_is_near_the_visible_truth(
    found: tuple[Surface, dict[str, Any]], truth: dict[str, Any]
) -> None:
    seen = found[1]["overbreak_volume_m3"]
    assert seen == pytest.approx(truth["overbreak_volume_visible_m3"], rel=0.03)
    assert seen + found[1]["overbreak_volume_shadow_m3"] <= truth["overbreak_volume_m3"]


def test_keeps_at_most_half_a_million_points(found: tuple[Surface, dict[str, Any]]) -> None:
    assert found[1]["points"]["in"] == 1_000_000
    assert found[1]["points"]["kept"] == len(found[0].points) <= 500_000
