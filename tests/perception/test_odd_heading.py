"""Headings of other shapes: narrow and converging arches, wire mesh, bare rock with several arches."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from ascrcp.cli.heading_verdict import Verdict, judge
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.recognise import recognise
from ascrcp.simulation.variety import Kind, Sample, draw_sample, load_variety

VARIETY = load_variety()
POINTS = (0.5, 0.5)  # millions of beams
KINDS: dict[str, tuple[int, dict[str, Any]]] = {
    "narrow": (
        710001,
        {"profile": "horseshoe", "arches": {"width": 0.16, "depth": 0.12, "lean_deg": [-4, 4]}},
    ),
    "converging": (
        3,
        {
            "arches": {"stations": [11.2, 11.85], "lean_deg": [-3.0, 3.0]},
            "length": {"unsprayed_start": [10.3, 10.3]},
        },
    ),
    # the feet of two arches stand in one place
    "touching": (
        770003,
        {
            "profile": "five-centre",
            "arches": {"count": 3, "width": 0.25, "lean_deg": [-5.0, 5.0], "spacing": [0.7, 0.9]},
        },
    ),
    "mesh": (710001, {"net": {"present": True}, "bolts": {"count": 40}}),
}


def made(tunnel: dict[str, Any], seed: int, see: Any = "all") -> Sample:
    return draw_sample(VARIETY, Kind(name="odd", points=POINTS, see=see, tunnel=tunnel), seed)


@cache
def verdict(name: str) -> Verdict:
    seed, tunnel = KINDS[name]
    sample = made(tunnel, seed)
    return judge(recognise(sample.cloud, sample.heading.truth.profile, load_parameters()), sample)


@pytest.mark.parametrize("name", KINDS)
def test_arches_and_pockets_are_found_and_nothing_else(name: str) -> None:
    v = verdict(name)
    assert len(v.station_mm) == (3 if name == "touching" else 2)
    assert not v.missed_arches and not v.false_arches
    assert not v.missed_pockets and not v.false_regions
    assert all(abs(e) <= 20.0 for e in v.station_mm)
    assert v.axis_deg <= min(0.1, 3.0 * v.sigma_deg)
    assert abs(v.volume / v.volume_true - 1.0) <= 0.10


@pytest.mark.parametrize("seed", [720000, 720001])
def test_bare_rock_with_four_arches_gives_a_good_axis_and_its_true_uncertainty(seed: int) -> None:
    tunnel = {"length": {"unsprayed_length": [4.8, 5.2]}, "arches": {"count": 4, "lean_deg": [-3.0, 3.0]}}
    sample = made(tunnel, seed, "unsprayed")
    v = judge(recognise(sample.cloud, sample.heading.truth.profile, load_parameters()), sample)
    assert v.bare and len(v.station_mm) == 4
    assert v.axis_deg <= 0.3 and v.axis_deg <= 3.0 * v.sigma_deg
    assert 0.05 < v.sigma_deg < 0.6


def test_bare_rock_without_arches_is_not_led_astray_by_bumps_at_the_arch_line() -> None:
    bumps = {"count": 4, "half_length": [0.15, 0.45], "half_arc": [0.4, 1.3], "depth": [0.0, 0.04]}
    sample = made({"arches": {"count": 0}, "bumps": bumps}, 720000, "unsprayed")
    v = judge(recognise(sample.cloud, sample.heading.truth.profile, load_parameters()), sample)
    assert v.bare and not v.false_arches
    assert v.axis_deg <= 1.5 and v.axis_deg <= 3.0 * v.sigma_deg
    assert not np.isnan(v.sigma_deg)
