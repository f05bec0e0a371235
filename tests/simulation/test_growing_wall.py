"""The wall of the rig: it grows by what the pump delivers, and the lidar sees it."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rig_bench import Bench
from tunnel_case import LIDAR

from ascrcp.core.config import load
from ascrcp.core.geometry import Array, apply_transform, rotation
from ascrcp.core.paths import CONFIG
from ascrcp.devices.lidar import SickLidar
from ascrcp.simulation.deposition import DepositionConfig
from ascrcp.simulation.fresh import GrowthConfig
from ascrcp.simulation.growth import GrowingWall, NozzleRecord, SprayTruth
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar import LidarServer
from ascrcp.simulation.lidar_model import LidarConfig
from ascrcp.simulation.tunnel import TunnelConfig

PUMP = 20.0 / 3600.0
CYCLE = 0.02
OVERLAY = {"bodies": [], "pockets": {"count": 1}, "arches": {"count": 1}, "length": {"rear": -3.0}}
HOLDS = {"fall_wall_m": [9.0, 9.0], "fall_crown_m": [9.0, 9.0]}


@pytest.fixture(scope="module")
def heading() -> Heading:
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, OVERLAY)
    return build_heading(tunnel, np.random.default_rng(3))


def spray_truth(**overlay: Any) -> SprayTruth:
    growth = load(CONFIG / "simulation" / "growth.yaml", GrowthConfig, overlay)
    jet = load(CONFIG / "simulation" / "deposition.yaml", DepositionConfig)
    return SprayTruth(jet, growth, 0.15, PUMP)


def nozzle_at(heading: Heading, station: float, phi_deg: float, stand_off: float = 1.0) -> Array:
    """A nozzle square to the wall, its spray direction along the tool's x."""
    phi, radius = np.radians(phi_deg), 5.9 - stand_off
    outward = np.array([0.0, -np.cos(phi), np.sin(phi)])
    T = np.eye(4)
    R = heading.truth.axis.T_base_tunnel[:3, :3]
    T[:3, 0] = R @ outward
    T[:3, 3] = apply_transform(
        heading.truth.axis.T_base_tunnel, (np.array([station, 0, 0]) + radius * outward)[None]
    )[0]
    return T


def batches(record: NozzleRecord, poses: list[Array], flow: float | list[float]) -> list[Array]:
    """Record one pose a cycle, then let the pump stand."""
    flows = flow if isinstance(flow, list) else [flow] * len(poses)
    told = [record.add(i * CYCLE, T, f, CYCLE) for i, (T, f) in enumerate(zip(poses, flows, strict=True))]
    told.append(record.add(len(poses) * CYCLE, poses[-1], 0.0, CYCLE))
    return [batch for batch in told if batch is not None]


def sweep(heading: Heading, seconds: float, phi_deg: tuple[float, float] = (60.0, 80.0)) -> list[Array]:
    station = heading.truth.unsprayed[0] + 0.45
    count = round(seconds / CYCLE)
    return [nozzle_at(heading, station, phi) for phi in np.linspace(*phi_deg, count)]


@pytest.mark.parametrize("seconds", [0.5, 3.33, 7.0])
def test_a_record_loses_no_drop(heading: Heading, seconds: float) -> None:
    poses = sweep(heading, seconds)
    told = batches(NozzleRecord(spray_truth()), poses, 0.6)
    rows = np.concatenate(told)
    # what flowed in the last instant before the pump stood comes out with the next
    assert rows[:, 7].sum() == pytest.approx(0.6 * PUMP * seconds, abs=0.6 * PUMP * 0.1)
    assert (np.diff(rows[:, 0]) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:7], axis=1), 1.0, atol=1e-12)


def test_a_pump_that_stands_lays_nothing(heading: Heading) -> None:
    assert batches(NozzleRecord(spray_truth()), sweep(heading, 2.0), 0.0) == []
    told = batches(NozzleRecord(spray_truth(grows=False)), sweep(heading, 2.0), 1.0)
    assert sum(batch[:, 7].sum() for batch in told) == 0.0


def test_the_wall_grows_by_what_was_pumped_less_what_rebounds(heading: Heading) -> None:
    wall = GrowingWall(heading, spray_truth(**HOLDS), seed=1)
    for batch in batches(NozzleRecord(spray_truth()), sweep(heading, 12.0), 0.5):
        wall.lay(batch)
    found = wall.summary()
    assert found["pumped_m3"] == pytest.approx(12.0 * 0.5 * PUMP, rel=0.04), "within the pump's stray"
    assert 0.15 < found["rebound_m3"] / found["pumped_m3"] < 0.45
    assert found["fallen_m3"] == 0.0
    kept = sum(value for name, value in found.items() if name != "pumped_m3")
    assert kept == pytest.approx(found["pumped_m3"], rel=0.02), "every drop is somewhere"
    moved = np.linalg.norm(wall.heading().vertices - heading.vertices, axis=1)
    assert 0.01 < moved.max() < 0.3 and (moved > 0.0).mean() < 0.2, "and only where it was aimed"


def test_what_hangs_too_thick_falls_and_what_has_set_stays(heading: Heading) -> None:
    station = heading.truth.unsprayed[0] + 0.45
    still = [nozzle_at(heading, station, 90.0)] * round(6.0 / CYCLE)
    config = spray_truth(fall_crown_m=[0.10, 0.10], set_s=[60.0, 60.0])
    at_once, slowly = (GrowingWall(heading, config, seed=1) for _ in range(2))
    for number in range(4):
        for batch in batches(NozzleRecord(config), still, 0.5):
            at_once.lay(batch)
            later = batch.copy()
            later[:, 0] += 600.0 * number
            slowly.lay(later)
    fell, held = at_once.summary(), slowly.summary()
    assert fell["fallen_m3"] > 0.2 * fell["on_rock_m3"]
    assert held["fallen_m3"] == 0.0
    for found in (fell, held):
        kept = sum(value for name, value in found.items() if name != "pumped_m3")
        assert kept == pytest.approx(found["pumped_m3"], rel=0.03)


def test_same_seed_same_wall_whatever_the_pieces(heading: Heading) -> None:
    told = batches(NozzleRecord(spray_truth()), sweep(heading, 3.0), 0.7)
    one, two = (GrowingWall(heading, spray_truth(), seed=4) for _ in range(2))
    for wall in (one, two):
        for batch in told:
            wall.lay(batch)
    assert one.heading().vertices.tobytes() == two.heading().vertices.tobytes()
    assert one.summary() == two.summary()


@pytest.fixture
def server(heading: Heading) -> Iterator[LidarServer]:
    exact = {"range_sigma": 0.0, "footprint_mrad": 0.0, "dropout": 0.0, "mixed": 0.0, "own_parts": []}
    config = load(LIDAR, LidarConfig, {**exact, "clear_range": 500.0})
    server = LidarServer(config, heading, 3, spray_truth(**HOLDS))
    yield server
    server.close()


def test_the_lidar_sees_what_has_been_laid_and_says_what_became_of_it(
    server: LidarServer, heading: Heading
) -> None:
    T = heading.truth.axis.T_base_tunnel
    station = heading.truth.unsprayed[0] + 0.45
    # across the axis: the scan plane cuts the place that is sprayed
    pose = np.eye(4)
    pose[:3, :3] = T[:3, :3] @ rotation("z", np.pi / 2)
    pose[:3, 3] = apply_transform(T, np.array([[station, 0.0, 0.0]]))[0]
    server.set_pose(pose, 0.0)
    driver = SickLidar(server.host, server.port, 10.0)
    driver.open()
    line = driver.read_line()
    before, crown = line.ranges, np.abs(line.beam - np.pi / 2) < 0.01
    assert server.concrete()["pumped_m3"] == 0.0
    still = [nozzle_at(heading, station, 90.0)] * round(5.0 / CYCLE)
    for batch in batches(NozzleRecord(spray_truth()), still, 0.5):
        server.lay(batch)
    after = driver.read_line().ranges
    driver.close()
    nearer = before - after
    assert 0.05 < np.nanmedian(nearer[crown]) < 0.5, "the wall has come nearer where the jet met it"
    assert np.nanmedian(np.abs(nearer)) < 2e-3, "and nowhere else"
    found = server.concrete()
    assert found["on_rock_m3"] + found["on_arches_m3"] > 0.5 * found["pumped_m3"] > 0.0


def delivered(bench: Bench, record: NozzleRecord, seconds: float, **command: Any) -> float:
    """Live on for some time; return what came out of the nozzle [m3]."""
    volume = 0.0
    for _ in range(round(seconds / CYCLE)):
        bench.step(**command)
        batch = record.add(bench.now_ns * 1e-9, bench.rig.true_nozzle(), bench.rig.flow, CYCLE)
        volume += 0.0 if batch is None else float(batch[:, 7].sum())
    return volume


def test_only_a_pump_that_is_told_and_enabled_delivers() -> None:
    with Bench().ready() as bench:
        record = NozzleRecord(spray_truth())
        assert delivered(bench, record, 2.0) == 0.0, "not told"
        assert delivered(bench, record, 2.0, enable=False, pump=0.6) == 0.0, "told, but not enabled"
        bench.ready()
        flowing = delivered(bench, record, 10.0, pump=0.6) + delivered(bench, record, 6.0, pump=0.0)
        assert flowing == pytest.approx(10.0 * 0.6 * PUMP, rel=0.03), "what the lag holds back it gives later"


@pytest.mark.parametrize("how", ["estop", "silence", "disabled", "off"])
def test_whatever_halts_the_pump_nothing_grows_once_the_hose_has_run_out(how: str) -> None:
    with Bench().ready() as bench:
        record = NozzleRecord(spray_truth())
        delivered(bench, record, 4.0, pump=0.6)
        if how == "estop":
            bench.rig.press_estop()
        command = {
            "estop": {"pump": 0.6},
            "silence": {"silent": True},
            "disabled": {"enable": False, "pump": 0.6},
            "off": {"pump": 0.0},
        }[how]
        tail = delivered(bench, record, 6.0, **command)
        assert tail < 2.0 * 0.6 * PUMP, "a batch not yet full, and the time constant of pump and hose"
        assert delivered(bench, record, 5.0, **command) == 0.0
