"""Tracker and gate on the simulated rig over CAN, in lockstep: the rig's true nozzle is the judge."""

import time
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from arc import arc_sequence
from run import CONTROL, SAFETY

from ascrcp.control.move import plan_move
from ascrcp.control.tracker import Tracker, TrackerOutput
from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import angle_between
from ascrcp.devices.bus import Bus
from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import DBC, MachineLink, load_can_config
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.safety.gate import Gate, GateState, Verdict
from ascrcp.safety.limit import Limits
from ascrcp.simulation.rig import Fault, Rig, load_rig_config

ARM = load_arm("kc")
CODEC = Codec(DBC)
CAN = load_can_config()
_channel = count()


def sagging(sequence: JointSequence, load_kg: float) -> JointSequence:
    """The pose wanted is where gravity takes the nozzle, as the solver plans it."""
    T = sagged_forward(ARM, sequence.q, load_kg)
    return replace(sequence, position=T[:, :3, 3], direction=T[:, :3, 0])


class Cell:
    """Rig, link, tracker and gate, one cycle after the other."""

    def __init__(self, overlay: dict | None = None, load_kg: float = 0.0) -> None:
        channel = f"tracker-test-{next(_channel)}"
        self.buses = [Bus(CAN.bus, channel) for _ in range(2)]
        self.rig = Rig(load_rig_config(overlay), ARM, self.buses[0], 1, load_kg, CODEC)
        self.link = MachineLink(self.buses[1], CODEC, CAN)
        self.tracker = Tracker(ARM, CONTROL)
        self.gate = Gate(Limits.of_arm(ARM.joints, ARM.max_speed), SAFETY)
        self.now_ns = 0
        self.drives: list[tuple[float, ...]] = []
        self.mm: list[float] = []
        self.deg: list[float] = []
        for k in range(8):
            self.cycle(reset=k == 5)

    def cycle(self, **buttons: bool) -> tuple[TrackerOutput, Verdict]:
        self.now_ns += CYCLE_NS
        self.rig.step(self.now_ns)
        self.inputs = self.link.receive(self.now_ns)
        out = self.tracker.update(self.inputs)
        error = out.error_q if out.state == "follow" else None
        verdict = self.gate.check(self.inputs, out.command, error_q=error, **buttons)
        self.link.send(verdict.command)
        self.drives.append(verdict.command.drive)
        if out.spraying:
            T = self.rig.true_nozzle()
            self.mm.append(float(np.linalg.norm(T[:3, 3] - out.position)) * 1e3)
            self.deg.append(float(np.degrees(angle_between(T[:3, 0], out.direction))))
        return out, verdict

    def follow(self, sequence: JointSequence) -> TrackerOutput:
        self.tracker.follow(sequence)
        out, _ = self.cycle(start=True)
        while out.state == "follow":
            out, _ = self.cycle()
        return out

    def go_to(self, q: np.ndarray) -> None:
        out = self.follow(plan_move(ARM, self.inputs.q, q, CONTROL))
        assert out.state == "finished", out.reason

    def close(self) -> None:
        for bus in self.buses:
            bus.close()


@pytest.fixture
def make_cell():
    cells: list[Cell] = []

    def make(*arguments: object) -> Cell:
        cells.append(Cell(*arguments))  # type: ignore[arg-type]
        return cells[-1]

    yield make
    for cell in cells:
        cell.close()


def detuned(gain: float, dead_band: float, lag_s: float) -> dict:
    joints = load_rig_config().arm.joints
    tree = {}
    for number in range(1, 9):
        joint = getattr(joints, f"j{number}")
        tree[f"j{number}"] = {
            "speed": [v * gain for v in joint.speed],
            "valve": {"dead_band": [dead_band] * 2},
        }
        if number in (2, 4):
            tree[f"j{number}"]["sensor"] = {"lag_s": lag_s}
    return {"arm": {"joints": tree}}


@pytest.mark.parametrize(
    "overlay, load_kg",
    [
        ({}, 0.0),
        ({}, 181.0),
        (detuned(1.3, 0.03, 0.15), 0.0),
        (detuned(0.7, 0.08, 0.15), 181.0),
    ],
    ids=["default", "loaded", "fast, late sensors", "weak, late sensors, loaded"],
)
def test_true_nozzle_stays_within_100_mm_and_5_deg(make_cell, overlay, load_kg):
    cell = make_cell(overlay, load_kg)
    sequence = sagging(arc_sequence(ARM), load_kg)
    cell.go_to(ARM.zero_pose)
    cell.go_to(sequence.q[0])
    out = cell.follow(sequence)
    assert out.state == "finished", out.reason
    assert out.reached == (sequence.point >= 0).sum() and out.skipped == 0
    assert max(cell.mm) < 100.0 and max(cell.deg) < 2.5
    assert np.mean(cell.mm) < 40.0


def test_two_runs_are_bit_identical(make_cell):
    sequence = arc_sequence(ARM, from_deg=60.0, to_deg=75.0)
    logs = []
    for _ in range(2):
        cell = make_cell()
        cell.go_to(sequence.q[0])
        cell.follow(sequence)
        logs.append(cell.drives)
    assert logs[0] == logs[1]


def moving(cell: Cell) -> None:
    """Bring the arm into motion."""
    cell.tracker.follow(plan_move(ARM, cell.inputs.q, cell.inputs.q + np.array([0.5] + [0.0] * 7), CONTROL))
    cell.cycle(start=True)
    for _ in range(150):
        cell.cycle()
    assert abs(cell.drives[-1][0]) > 0.2


@pytest.mark.parametrize(
    "plant, cycles",
    [
        (lambda rig: rig.press_estop(), 2),
        (lambda rig: rig.inject(Fault("range", "JointPosition1")), 2),
        (lambda rig: rig.inject(Fault("drop", "JointPosition3")), 4),
        (lambda rig: rig.inject(Fault("repeat", "JointPosition3")), 4),
        (lambda rig: rig.inject(Fault("corrupt", "JointPosition3")), 4),
        (lambda rig: rig.inject(Fault("drop", "ControllerStatus")), 4),
        (lambda rig: rig.inject(Fault("drop", "MachineStatus")), 4),
    ],
    ids=["F20 e-stop", "F6 range", "F1 drop", "F2 repeat", "F3 corrupt", "F25 heartbeat", "F20 mirror lost"],
)
def test_fault_on_the_wire_zeroes_the_command_in_time(make_cell, plant, cycles):
    cell = make_cell()
    moving(cell)
    plant(cell.rig)
    for _ in range(cycles):
        _, verdict = cell.cycle()
    assert verdict.state is GateState.STOPPED and not any(cell.drives[-1]) and not verdict.command.enable
    for _ in range(100):
        cell.cycle(start=True)
        assert not any(cell.drives[-1])


def test_lockstep_control_costs_little(make_cell):
    """Tracker and gate together take a small part of the 1 ms that 20 times real time leaves."""
    cell = make_cell()
    sequence = arc_sequence(ARM, from_deg=60.0, to_deg=75.0)
    cell.go_to(sequence.q[0])
    cell.tracker.follow(sequence)
    inputs, spent = cell.inputs, []
    for _ in range(200):
        began = time.perf_counter()
        out = cell.tracker.update(replace(inputs, controller_enabled=True))
        cell.gate.check(inputs, out.command, error_q=out.error_q)
        spent.append(time.perf_counter() - began)
    assert np.median(spent) < 0.5e-3
