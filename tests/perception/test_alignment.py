"""The pan zero from the lance in the cloud, on lines of the simulated lidar (thesis 3.2)."""

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from ascrcp.core.config import load
from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Scan
from ascrcp.core.paths import CONFIG
from ascrcp.perception.alignment import align
from ascrcp.perception.survey import load_survey
from ascrcp.simulation.lidar_model import LidarConfig, _enter_boxes

PARAMETERS = load_survey().alignment
LIDAR = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)


@dataclass
class Room:
    """A tube round the mount with the lance in it, seen by the scanner's own geometry and noise."""

    zero_deg: float = 0.0
    seed: int = 0
    lance: bool = True
    dust: float = 0.002
    start_deg: float = -90.0
    stop_deg: float = 90.0

    def scan(self) -> Scan:
        config = msgspec.structs.replace(LIDAR, pan_zero_deg=self.zero_deg)
        rng = np.random.default_rng(self.seed)
        pan = np.radians(np.arange(self.start_deg, self.stop_deg + 0.01, 0.25))
        beam = config.beam
        true = pan + np.radians(config.pan_zero_deg)
        d = np.stack(
            [
                np.cos(beam) * np.cos(true)[:, None],
                np.cos(beam) * np.sin(true)[:, None],
                np.broadcast_to(np.sin(beam), (len(pan), len(beam))),
            ],
            axis=-1,
        ).reshape(-1, 3)
        wall = 4.0 / np.maximum(np.hypot(d[:, 1], d[:, 2]), 0.05)
        own = np.full(len(d), np.inf)
        if self.lance:
            low = np.array([p.low for p in config.own_parts]).reshape(-1, 1, 3)
            high = np.array([p.high for p in config.own_parts]).reshape(-1, 1, 3)
            own = _enter_boxes(d, low, high)
        t = np.minimum(wall, own) + config.range_sigma * rng.standard_normal(len(d))
        t = np.where(rng.random(len(d)) < self.dust, t * rng.random(len(d)), t)
        mixed = rng.random(len(d)) < 0.01
        t = np.where(mixed & np.isfinite(own), np.minimum(own, 50.0) * 0.5 + wall * 0.5, t)
        t = np.where(rng.random(len(d)) < config.dropout, np.nan, t)
        ranges = np.where((t > config.min_range) & (t < config.max_range), t, np.nan)
        return Scan(ranges.reshape(len(pan), -1).astype(np.float32), beam, pan, np.zeros(8))


@pytest.mark.parametrize("zero_deg", [-2.0, -1.1, -0.3, 0.0, 0.05, 0.7, 2.0])
def test_the_pan_zero_is_found_within_a_twentieth_of_a_degree(zero_deg: float) -> None:
    for seed in (1, 2):
        found = align(Room(zero_deg, seed).scan(), PARAMETERS)
        assert np.degrees(found.pan_zero) == pytest.approx(-zero_deg, abs=0.05)
        assert found.residual < 0.01 and found.length > 1.2 and found.points > 200
        assert np.degrees(found.sigma) < 0.05


def test_half_a_sweep_and_much_dust_are_enough() -> None:
    found = align(Room(1.5, 5, dust=0.1, start_deg=-30.0, stop_deg=20.0).scan(), PARAMETERS)
    assert np.degrees(found.pan_zero) == pytest.approx(-1.5, abs=0.05)


def test_without_a_lance_nothing_is_invented() -> None:
    with pytest.raises(RecognitionError, match="alignment"):
        align(Room(lance=False, dust=0.05).scan(), PARAMETERS)
    with pytest.raises(RecognitionError, match="alignment"):
        align(Room(lance=False, dust=0.0).scan(), PARAMETERS)


def test_a_head_turned_too_far_is_refused() -> None:
    with pytest.raises(RecognitionError, match="deg"):
        align(Room(9.0).scan(), PARAMETERS)
