"""The simulated lidar: its model against analytic distances, its server through the real driver."""

import multiprocessing
import multiprocessing.spawn
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tunnel_case import CIRCLE, LIDAR, SMOOTH, TUNNEL

from ascrcp.core.config import load
from ascrcp.core.errors import DeviceError, InputError
from ascrcp.core.geometry import Array, rotation, transform
from ascrcp.core.paths import CONFIG
from ascrcp.devices import lidar_telegram as cola
from ascrcp.devices.lidar import LidarDeviceConfig, SickLidar
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar import LidarServer
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.lidar_pose import PoseBoard
from ascrcp.simulation.lidar_process import LidarNode
from ascrcp.simulation.tunnel import TunnelConfig

EXACT: dict[str, Any] = {
    "range_sigma": 0.0,
    "footprint_mrad": 0.0,
    "dropout": 0.0,
    "mixed": 0.0,
    "own_parts": [],
    "clear_range": 500.0,
}
POSE = transform(rotation("z", 0.1) @ rotation("y", -0.05), np.array([9.75, -0.2, 0.3]))
PANS = np.radians([-90.0, -40.0, 0.0, 33.0, 90.0])
TIMEOUT = 10.0  # generous: the machine that runs the tests may be busy


@pytest.fixture(scope="module")
def smooth() -> Heading:
    return build_heading(load(TUNNEL, TunnelConfig, SMOOTH), np.random.default_rng(1), CIRCLE)


@pytest.fixture(scope="module")
def rough() -> Heading:
    return build_heading(load(TUNNEL, TunnelConfig), np.random.default_rng(7), CIRCLE)


@pytest.fixture(scope="module")
def server(smooth: Heading) -> Iterator[LidarServer]:
    server = LidarServer(load(LIDAR, LidarConfig, EXACT), smooth, seed=3)
    yield server
    server.close()


@pytest.fixture
def driver(server: LidarServer) -> Iterator[SickLidar]:
    driver = SickLidar(server.host, server.port, TIMEOUT)
    driver.open()
    yield driver
    driver.close()


def directions(beam: Array, pan: float) -> Array:
    """The beam convention: Rot(z, pan) (cos b, 0, sin b) in the mount frame."""
    flat = np.cos(beam)
    return np.column_stack([flat * np.cos(pan), flat * np.sin(pan), np.sin(beam)])


def cylinder_ranges(
    heading: Heading, T: Array, beam: Array, pan: float, radius: float
) -> tuple[Array, Array]:
    """Distance to a cylinder round the axis, and the station where it is met."""
    axis = heading.truth.axis
    d = directions(beam, pan) @ T[:3, :3].T @ axis.T_base_tunnel[:3, :3]
    o = (T[:3, 3] - axis.point) @ axis.T_base_tunnel[:3, :3]
    a, b, c = (d[:, 1:] ** 2).sum(1), d[:, 1:] @ o[1:], o[1:] @ o[1:] - radius**2
    t = (-b + np.sqrt(b**2 - a * c)) / a
    return t, o[0] + t * d[:, 0]


def test_ranges_over_loopback_match_the_cylinder(
    server: LidarServer, driver: SickLidar, smooth: Heading
) -> None:
    start, end = smooth.truth.unsprayed
    compared = 0
    for pan in PANS:
        server.set_pose(POSE, float(pan))
        line = driver.read_line()
        assert line.status == 0 and len(line.ranges) == 1081
        up = np.sin(line.beam) > 0.1
        for radius, low, high in ((5.92, start + 0.1, end - 0.05), (5.67, start - 6.0, start - 0.1)):
            t, s = cylinder_ranges(smooth, POSE, line.beam, float(pan), radius)
            there = up & (s > low) & (s < high)
            np.testing.assert_allclose(line.ranges[there], t[there], atol=3e-3)
            compared += int(there.sum())
    assert compared > 1500


def test_scan_counter_rises_by_one_and_nothing_is_missed(driver: SickLidar) -> None:
    lines = [driver.read_line() for _ in range(5)]
    assert np.diff([line.scan_counter for line in lines]).tolist() == [1] * 4
    assert [line.missed for line in lines] == [0] * 5
    assert "SIM" in driver.ident  # a simulator can be told from a machine (fault F44)


@pytest.mark.parametrize(
    ("fault", "telegrams", "says"),
    [
        ("corrupt", 1, "checksum"),
        ("truncate", 1, "no new scan"),
        ("silent", 1, "no new scan"),
        ("freeze", 10**6, "no new scan"),
    ],
)
def test_f35_lidar_fault_is_one_line_and_reopening_cures_it(
    server: LidarServer, fault: str, telegrams: int, says: str
) -> None:
    driver = SickLidar(server.host, server.port, timeout=0.4)
    driver.open()
    driver.read_line()
    server.inject(fault, telegrams)
    with pytest.raises(DeviceError, match=says) as caught:
        driver.read_line()
    assert "\n" not in str(caught.value)
    with pytest.raises(DeviceError, match="not open"):
        driver.read_line()
    server.inject(fault, 0)
    again = SickLidar(server.host, server.port, TIMEOUT)
    again.open()
    assert again.read_line().status == 0
    again.close()


def test_f35_status_byte_reaches_the_caller(server: LidarServer, driver: SickLidar) -> None:
    server.inject("status")
    assert driver.read_line().status == 1
    assert driver.read_line().status == 0


def test_process_sends_the_same_bytes_as_its_node_and_its_end_is_an_error(rough: Heading) -> None:
    config = load(LIDAR, LidarConfig)
    server = LidarServer(config, rough, seed=5)
    board = PoseBoard(multiprocessing.get_context("spawn"))
    twin = LidarNode(config, LidarModel(config, rough), board, 5)
    with socket.create_connection((server.host, server.port), TIMEOUT) as client:
        for pan in PANS:
            server.set_pose(POSE, float(pan))
            board.write(POSE, float(pan))
            wanted = twin.answer(cola.READ)
            client.sendall(cola.encode_frame(cola.READ))
            assert client.recv(len(wanted), socket.MSG_WAITALL) == wanted
    driver = SickLidar(server.host, server.port, TIMEOUT)
    driver.open()
    server.close()
    with pytest.raises(DeviceError, match="connection"):
        driver.read_line()
    server.close()


def test_process_that_cannot_start_is_an_error_and_no_wait_for_ever(smooth: Heading) -> None:
    python = multiprocessing.spawn.get_executable()
    multiprocessing.set_executable("/bin/false")
    try:
        server = LidarServer(load(LIDAR, LidarConfig), smooth, seed=1)
    finally:
        multiprocessing.set_executable(python)
    with pytest.raises(DeviceError, match="ended before it was ready"):
        _ = server.port
    server.close()


def test_unknown_names_and_values_are_refused(server: LidarServer, smooth: Heading) -> None:
    with pytest.raises(InputError, match="seed -1"):
        LidarServer(load(LIDAR, LidarConfig), smooth, seed=-1)
    with pytest.raises(DeviceError, match="unknown fault"):
        server.inject("lightning")
    with pytest.raises(DeviceError, match="finite"):
        server.set_pose(np.full((4, 4), np.nan), 0.0)
    with pytest.raises(DeviceError, match="finite"):
        server.set_pose(np.eye(4), float("nan"))


def node(heading: Heading, seed: int, board: PoseBoard) -> LidarNode:
    config = load(LIDAR, LidarConfig)
    return LidarNode(config, LidarModel(config, heading), board, seed)


def test_same_seed_and_polls_give_the_same_bytes(rough: Heading) -> None:
    board = PoseBoard(multiprocessing.get_context("spawn"))
    a, b, c = node(rough, 1, board), node(rough, 1, board), node(rough, 2, board)
    for pan in PANS:
        board.write(POSE, float(pan))
        first = a.answer(cola.READ)
        assert first == b.answer(cola.READ)
        assert first != c.answer(cola.READ)


def test_unknown_command_is_answered_with_a_sopas_error(smooth: Heading) -> None:
    answer = node(smooth, 1, PoseBoard(multiprocessing.get_context("spawn"))).answer(b"sMN Reboot")
    with pytest.raises(DeviceError, match="error 2"):
        cola.decode_scan(answer[8:-1])


def test_pose_board_returns_what_was_written() -> None:
    board = PoseBoard(multiprocessing.get_context("spawn"))
    for pan in PANS:
        board.write(POSE, float(pan))
        T, got = board.read()
        np.testing.assert_array_equal(T, POSE)
        assert got == pan


def sweep(heading: Heading, overlay: Any = None, step_deg: float = 1.0) -> Array:
    """Points of a sweep in the base frame, NaN lines and all, shape (n, 3)."""
    config = load(LIDAR, LidarConfig, overlay)
    model, rng = LidarModel(config, heading), np.random.default_rng(0)
    points = []
    for pan in np.radians(np.arange(-90.0, 90.1, step_deg)):
        ranges = model.measure(POSE, float(pan), rng)
        points.append((directions(config.beam, float(pan)) * ranges[:, None]) @ POSE[:3, :3].T + POSE[:3, 3])
    return np.concatenate(points)


def test_sweep_covers_the_unsprayed_wall(rough: Heading) -> None:
    points = sweep(rough)
    assert np.isfinite(points[:, 0]).mean() > 0.95
    points = points[np.isfinite(points[:, 0])]
    axis = rough.truth.axis
    T = axis.T_base_tunnel
    local = (points - T[:3, 3]) @ T[:3, :3]
    along, offset = CIRCLE.locate(local[:, 1:])
    start, end = rough.truth.unsprayed
    wall = (local[:, 0] > start) & (local[:, 0] < end) & (np.abs(offset) < 0.7) & (local[:, 2] > -1.3)
    cell = 0.15
    i, j = ((local[wall, 0] - start) / cell).astype(int), (along[wall] / cell).astype(int)
    rows, columns = int((end - start) / cell), int(CIRCLE.length / cell)
    seen = np.zeros((rows + 1, columns + 1), bool)
    seen[np.minimum(i, rows), np.minimum(j, columns)] = True
    height = CIRCLE.point(np.arange(columns + 1) * cell)[:, 1]
    # arches throw shadows: some cells right behind them stay dark
    assert 0.80 < seen[:, height > -1.1].mean() <= 1.0


def test_noise_has_the_size_it_is_asked_for(smooth: Heading) -> None:
    config = load(LIDAR, LidarConfig, {**EXACT, "range_sigma": 0.006})
    model, rng = LidarModel(config, smooth), np.random.default_rng(0)
    true, _ = model.cast(POSE, 0.0)
    error = np.array([model.measure(POSE, 0.0, rng) - true for _ in range(40)])
    up = np.sin(config.beam) > 0.2
    assert np.nanstd(error[:, up]) == pytest.approx(0.006, rel=0.05)
    assert abs(np.nanmean(error[:, up])) < 2e-4


def test_lost_beams_dust_and_weak_echoes(smooth: Heading) -> None:
    quiet = LidarModel(load(LIDAR, LidarConfig, EXACT), smooth)
    rng = np.random.default_rng(0)
    base = np.isfinite(quiet.measure(POSE, 0.0, rng)).mean()
    lossy = LidarModel(load(LIDAR, LidarConfig, {**EXACT, "dropout": 0.3}), smooth)
    lost = np.mean([np.isfinite(lossy.measure(POSE, 0.0, rng)).mean() for _ in range(20)])
    assert lost == pytest.approx(0.7 * base, abs=0.02)
    weak = LidarModel(load(LIDAR, LidarConfig, {**EXACT, "clear_range": 4.0}), smooth)
    assert np.isfinite(weak.measure(POSE, 0.0, rng)).mean() < 0.7 * base
    dusty = build_heading(
        load(TUNNEL, TunnelConfig, {**SMOOTH, "air": {"dust_per_m": 0.1, "drips": 0}}),
        np.random.default_rng(1),
        CIRCLE,
    )
    model = LidarModel(load(LIDAR, LidarConfig, EXACT), dusty)
    true, _ = model.cast(POSE, 0.0)
    up = np.sin(load(LIDAR, LidarConfig).beam) > 0.5
    short = np.mean([(model.measure(POSE, 0.0, rng) < true - 0.01)[up].mean() for _ in range(20)])
    assert short == pytest.approx(1.0 - np.exp(-0.1 * true[up]).mean(), rel=0.1)


def test_falling_water_returns_short(smooth: Heading) -> None:
    air = {"dust_per_m": 0.0, "drips": 30, "drip_radius": 0.05, "drip_chance": 1.0}
    heading = build_heading(
        load(TUNNEL, TunnelConfig, {**SMOOTH, "air": air}), np.random.default_rng(1), CIRCLE
    )
    model, rng = LidarModel(load(LIDAR, LidarConfig, EXACT), heading), np.random.default_rng(0)
    hits = []
    for pan in np.radians(np.arange(-90.0, 90.0, 1.0)):
        true, _ = model.cast(POSE, float(pan))
        got = model.measure(POSE, float(pan), rng)
        short = got < true - 0.01
        ray = directions(load(LIDAR, LidarConfig).beam, float(pan)) @ POSE[:3, :3].T
        hits.append((ray * got[:, None] + POSE[:3, 3])[short])
    points = np.concatenate(hits)
    assert len(points) > 100
    aside = np.linalg.norm(points[:, None, :2] - heading.drips[None, :, :2], axis=-1).min(axis=1)
    assert aside.max() <= 0.051


def test_the_lance_is_seen_where_it_is(smooth: Heading) -> None:
    part = {"low": [-4.4, -0.1, -0.12], "high": [-0.5, 0.1, 0.12]}
    model = LidarModel(load(LIDAR, LidarConfig, {**EXACT, "own_parts": [part]}), smooth)
    config = load(LIDAR, LidarConfig)
    distance, _ = model.cast(POSE, 0.0)
    back = np.isclose(config.beam, np.pi)
    np.testing.assert_allclose(distance[back], 0.5, atol=1e-6)
    ahead = np.isclose(config.beam, 0.0)
    assert distance[ahead] > 2.0


def test_pan_zero_error_turns_the_scan_plane(smooth: Heading) -> None:
    straight = LidarModel(load(LIDAR, LidarConfig, EXACT), smooth)
    turned = LidarModel(load(LIDAR, LidarConfig, {**EXACT, "pan_zero_deg": 2.0}), smooth)
    np.testing.assert_allclose(turned.cast(POSE, 0.0)[0], straight.cast(POSE, np.radians(2.0))[0], rtol=1e-6)


def test_device_configuration_loads_and_sweeps_all_directions() -> None:
    config = load(CONFIG / "devices" / "lidar.yaml", LidarDeviceConfig)
    pan = config.sweep.pan
    assert len(pan) == 721
    np.testing.assert_allclose(np.degrees(pan[[0, 360, -1]]), [-90.0, 0.0, 90.0], atol=1e-9)
