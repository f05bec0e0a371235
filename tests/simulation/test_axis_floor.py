"""The bound on the axis of bare rock: falls with more arches, farther apart, better set out."""

from typing import Any

import numpy as np

from ascrcp.core.config import load, merge
from ascrcp.core.paths import CONFIG
from ascrcp.simulation.axis_floor import direction_floor_deg
from ascrcp.simulation.heading import build_heading
from ascrcp.simulation.tunnel import TunnelConfig


def floor(**arches: Any) -> float:
    length = {"unsprayed_start": [10.0, 10.0], "unsprayed_length": [5.0, 5.0]}
    overlay = merge({"length": length, "mesh": {"step": 0.2, "step_behind": 0.5}}, {"arches": arches})
    config = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, overlay)
    return direction_floor_deg(build_heading(config, np.random.default_rng(1)).truth, config)


def test_more_arches_farther_apart_and_truer_ones_say_more_of_the_axis() -> None:
    two = floor(stations=[11.0, 12.0])
    assert floor(stations=[11.0, 12.0, 13.0]) < two
    assert floor(stations=[11.0, 14.0]) < 0.6 * two
    assert floor(stations=[11.0, 12.0], radial_error=0.002) < two
    assert floor(stations=[11.0, 12.0], radial_error=0.0) < 0.1 * two
    assert floor(stations=[11.0, 12.0], count=0) == two  # stations given outright count
    assert 0.05 < two < 0.5
