"""The sweep refuses what it cannot trust: an unwell lidar, lost lines, a joint without a value (F35, F36)."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.config import load
from ascrcp.core.errors import DeviceError
from ascrcp.core.machine_io import MachineInputs
from ascrcp.core.paths import CONFIG
from ascrcp.devices.lidar import LidarDeviceConfig, LidarLine
from ascrcp.session.scanner import MISSED_RUN, Scanner

SWEEP = load(CONFIG / "devices" / "lidar.yaml", LidarDeviceConfig).sweep


class Head:
    """A lidar and a pan head that do as they are told, until `spoil` says otherwise."""

    def __init__(self) -> None:
        self.angle = 0.0
        self.count = 0
        self.spoil = {}

    def point_pan(self, angle: float | None) -> None:
        if angle is not None:
            self.angle = angle

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def read_line(self) -> LidarLine:
        self.count += 1
        change = self.spoil.get(self.count, {})
        return LidarLine(
            ranges=np.ones(5, np.float32),
            beam=np.linspace(-1, 1, 5),
            scan_counter=self.count,
            status=change.get("status", 0),
            missed=change.get("missed", 0),
        )


Joints = Callable[[int], tuple[float, ...]]


def still(k: int) -> tuple[float, ...]:
    return (0.0,) * 8


def sweep(head: Head, q: Joints = still) -> Scanner:
    scanner = Scanner(head, SWEEP, head)
    for k in range(3000):
        inputs = MachineInputs(
            t_ns=k * CYCLE_NS,
            q=q(k),
            age_ns=(0,) * 8,
            in_range=(True,) * 8,
            pan=head.angle,
            pan_age_ns=0,
        )
        scanner.on_cycle(inputs)
        if scanner.done:
            return scanner
    pytest.fail("the sweep never ended")


def test_a_sound_sweep_is_complete() -> None:
    head = Head()
    head.spoil = {1: {"missed": 500}, 50: {"missed": 2}, 300: {"missed": MISSED_RUN}}
    scan = sweep(head).scan()
    assert scan.complete and len(scan.ranges) >= 720


@pytest.mark.parametrize("line", [1, 2, 400])
def test_f35_status_ends_the_scan(line: int) -> None:
    head = Head()
    head.spoil = {line: {"status": 3}}
    with pytest.raises(DeviceError, match="status 3"):
        sweep(head)
    assert head.count == line


def test_f35_lines_lost_in_a_row_end_the_scan() -> None:
    head = Head()
    head.spoil = {200: {"missed": MISSED_RUN + 1}}
    with pytest.raises(DeviceError, match="missed 4 of 720"):
        sweep(head)


def test_f35_many_single_lines_lost_end_the_scan() -> None:
    head = Head()
    head.spoil = {k: {"missed": 1} for k in range(2, 700, 20)}
    with pytest.raises(DeviceError, match="missed 15 of 720"):
        sweep(head)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_joint_without_a_value_ends_the_scan(joint: int, value: float) -> None:
    q = [0.0] * 8
    q[joint] = value
    with pytest.raises(DeviceError, match=f"joint sensor {joint + 1}"):
        sweep(Head(), lambda k: tuple(q))


def test_f35_readings_that_flicker_at_rest_are_no_motion() -> None:
    rng = np.random.default_rng(4)
    step, noise = math.radians(0.1), math.radians(0.04)  # twice the noise of the rig's inclinometers

    def read(k: int) -> tuple[float, ...]:
        boom, lance = np.round((0.0005 + rng.normal(0.0, noise, 2)) / step) * step
        return (0.0, boom, 0.0, lance - boom, 0.0, 0.0, 0.0, 0.0)

    assert sweep(Head(), read).scan().complete


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("speed", [math.radians(0.02), 1.0])
def test_f35_an_arm_that_moves_ends_the_scan(joint: int, speed: float) -> None:
    """Whether it creeps [rad/s or m/s] from the start, or starts late."""
    start = 0 if speed < 1.0 else 700

    def read(k: int) -> tuple[float, ...]:
        q = [0.0] * 8
        q[joint] = speed * max(0, k - start) * CYCLE_NS / 1e9
        return tuple(q)

    with pytest.raises(DeviceError, match="stand still"):
        sweep(Head(), read)
