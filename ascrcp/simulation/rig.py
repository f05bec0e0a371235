"""The simulated machine: eight hydraulic joints, their sensors and controllers, on a CAN bus.

The platform meets it only through frames. The truth (true_q, true_nozzle) is for judging a run and for
the simulated lidar, which hangs on the same arm.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ascrcp.core.clock import CYCLE_S
from ascrcp.core.config import Struct, convert, merge, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG, RESOURCES
from ascrcp.devices.bus import Bus
from ascrcp.devices.codec import Codec
from ascrcp.kinematics import Arm
from ascrcp.simulation.burden import Burden
from ascrcp.simulation.flexure import Flexure
from ascrcp.simulation.hydraulics import DEG, Hydraulics
from ascrcp.simulation.node import Controller, MachineNode, PanHead, SensorNode
from ascrcp.simulation.parameter import ArmConfig, BusConfig
from ascrcp.simulation.transducer import Backlash, TransducerArray

FOLDER = CONFIG / "simulation"
DBC = RESOURCES / "ascrcp.dbc"
JOINTS = 8
BURDEN = 3  # stream of chance of its own: what knocks the boom changes no other draw
BATCH = 512  # random numbers drawn at once for losses on the bus


class RigConfig(Struct):
    """Everything about the simulated machine that may be overlaid (--rig)."""

    arm: ArmConfig
    bus: BusConfig


def load_rig_config(overlay: dict[str, Any] | None = None) -> RigConfig:
    """Read config/simulation/arm.yaml and bus.yaml with a tree {"arm": ..., "bus": ...} laid over."""
    tree = {name: read_yaml(FOLDER / f"{name}.yaml") for name in ("arm", "bus")}
    return convert(merge(tree, overlay or {}), RigConfig, "rig")


FaultKind = Literal["drop", "repeat", "corrupt", "freeze", "shift", "range"]


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault to plant in the rig.

    Attributes:
        kind: "drop" sends nothing, "repeat" the last frame again, "corrupt" flips a bit of it,
            "freeze" holds a joint's reading, "shift" adds value to it [wire unit], "range" makes it
            impossible.
        frame: Message name in the DBC, e.g. "JointPosition3", "ControllerStatus".
        value: For "shift".
    """

    kind: FaultKind
    frame: str
    value: float = 0.0


class Rig:
    """The machine on the other end of the wires."""

    def __init__(
        self,
        config: RigConfig,
        arm: Arm,
        bus: Bus,
        seed: int = 0,
        load_kg: float = 0.0,
        codec: Codec | None = None,
    ) -> None:
        """Switch the machine on, standing where its configuration says, everything neutral.

        Args:
            config: Parameters.
            arm: Kinematics of the true arm, eight joints.
            bus: The rig's own connection to the CAN bus.
            seed: Of everything random.
            load_kg: Concrete in the hose [kg].
            codec: Frames, read from the shipped DBC if not given.

        Raises:
            ConfigError: The arm does not have eight joints, or the load is absurd.
        """
        if len(arm.joints) != JOINTS:
            raise ConfigError(f"the rig has {JOINTS} joints, the arm {len(arm.joints)}")
        load_kg = _checked_load(load_kg)
        codec = codec or Codec(DBC)
        self._arm = arm
        self._bus = bus
        a = config.arm
        self._rng = np.random.default_rng(seed)
        self._hydraulics = Hydraulics(a, load_kg)
        self._flexure = Flexure(a.flexure, a.payload_reference_kg, load_kg)
        self._burden = Burden(a.hose, a.bump, load_kg, np.random.default_rng([seed, BURDEN]))
        self._slew = Backlash(a.backlash_deg * DEG, self._hydraulics.q[0])
        self._transducers = TransducerArray(a.joints.rows, self._rng)
        self._controller = Controller(codec, config.bus)
        self._machine = MachineNode(codec, a.spray)
        self._sensors = [SensorNode(codec, i + 1) for i in range(JOINTS)]
        self._pan = PanHead(codec, a.pan, config.bus)
        self._names = {layout.can_id: name for name, layout in codec.by_name.items()}
        self._loss = (config.bus.loss_probability, config.bus.corrupt_probability)
        self._luck: list[list[float]] = []
        self._faults: dict[str, Fault] = {}
        self._sent: dict[int, bytes] = {}
        self._readings = [0.0] * JOINTS
        self._drive: tuple[float, ...] = (0.0,) * JOINTS
        self._settle()
        self._bend()

    def _settle(self) -> None:
        """Compute the pose the machine stands in."""
        q = self._hydraulics.q
        self._q = (self._slew.advance(q[0]), *q[1:])
        self._T_rigid = self._arm.forward(self._q)
        self._T_mount = self._arm.lidar(self._q)
        x, y = self._T_rigid[:2, 3].tolist()
        self._reach = math.hypot(x, y)

    def step(self, now_ns: int) -> None:
        """Live through one 20 ms cycle that ends now: obey the commands that came, move, report.

        Args:
            now_ns: Present instant [ns, monotonic].
        """
        for can_id, data in self._bus.drain():
            if can_id == self._pan.command_id:
                self._pan.take(data, now_ns)
            else:
                self._controller.take(can_id, data, now_ns)
        self._drive = self._controller.decide(now_ns)
        self._hydraulics.advance(self._drive, self._reach, CYCLE_S)
        self._machine.advance(self._controller.pump(now_ns), CYCLE_S)
        self._pan.advance(CYCLE_S)
        self._settle()
        self._weigh()
        x, y, z = self._T_mount[:3, 3].tolist()
        self._flexure.advance((x, y, z), self._machine.flow, CYCLE_S)
        self._bend()
        self._publish()

    def _weigh(self) -> None:
        """Let payload and knocks act."""
        flexure, burden = self._flexure, self._burden
        before = burden.kg
        up, aside = burden.advance(self._machine.flow, flexure.stroke, CYCLE_S)
        if burden.kg != before:
            flexure.load(burden.kg)
            self._hydraulics.load(burden.kg)
        if up or aside:
            flexure.vertical.push(up)
            flexure.lateral.push(aside)

    def _bend(self) -> None:
        """Compute where sag and vibration put nozzle and lidar."""
        self._T_nozzle = self._flexure.bend(self._T_rigid)
        self._T_lidar = self._flexure.bend(self._T_mount)

    def _publish(self) -> None:
        readings = self._transducers.read(self._hydraulics.q, CYCLE_S)
        for i, sensor in enumerate(self._sensors):
            fault = self._faults.get(f"JointPosition{i + 1}")
            reading = readings[i]
            if fault is not None:
                if fault.kind == "freeze":
                    reading = self._readings[i]
                elif fault.kind == "shift":
                    reading += fault.value
                elif fault.kind == "range":
                    reading = float("inf")
            if fault is None or fault.kind != "freeze":
                self._readings[i] = reading
            self._put(*sensor.status(reading))
        self._put(*self._controller.status())
        oil_c = self._hydraulics.oil.temperature_c
        self._put(*self._machine.status(self._controller.estop, oil_c))
        self._put(*self._pan.status())

    def _put(self, can_id: int, data: bytes) -> None:
        """Send a frame, unless a planted fault or bad luck has it otherwise."""
        fault = self._faults.get(self._names[can_id]) if self._faults else None
        if fault is not None:
            if fault.kind == "drop":
                return
            if fault.kind == "repeat":
                data = self._sent.get(can_id, data)
            elif fault.kind == "corrupt":
                data = bytes((data[0], data[1], data[2] ^ 0x01, *data[3:]))
        if self._loss != (0.0, 0.0):
            if not self._luck:
                self._luck = self._rng.random((BATCH, 3)).tolist()
            lost, flipped, bit = self._luck.pop()
            if lost < self._loss[0]:
                return
            if flipped < self._loss[1]:
                place = int(bit * 8 * len(data))
                broken = bytearray(data)
                broken[place // 8] ^= 1 << place % 8
                data = bytes(broken)
        self._sent[can_id] = data
        self._bus.send(can_id, data)

    def inject(self, fault: Fault) -> None:
        """Plant a fault from the next cycle on; a second one on the same frame replaces it.

        Raises:
            ConfigError: No such frame.
        """
        if fault.frame not in self._names.values():
            raise ConfigError(f"no frame {fault.frame}, only {', '.join(sorted(self._names.values()))}")
        self._faults[fault.frame] = fault

    def set_load(self, payload_kg: float) -> None:
        """Hang another payload on [kg], from the next cycle on.

        Raises:
            ConfigError: It is absurd.
        """
        self._burden.set(_checked_load(payload_kg))

    def clear_faults(self) -> None:
        """Take all planted faults away."""
        self._faults.clear()

    def press_estop(self) -> None:
        """Press the hard-wired emergency stop: the valves close without anybody's command."""
        self._controller.estop = True

    def release_estop(self) -> None:
        """Release it; the controller stays neutral until it has been enabled anew."""
        self._controller.estop = False

    @property
    def drive(self) -> tuple[float, ...]:
        """Drives the valves got in the last cycle, -1..1; zero while the controller is neutral."""
        return self._drive

    @property
    def flow(self) -> float:
        """True concrete flow, fraction 0..1."""
        return self._machine.flow

    @property
    def pan(self) -> float:
        """True angle of the pan head [rad]."""
        return self._pan.angle_deg * DEG

    def true_q(self) -> Array:
        """Return the true joint vector, SI, shape (8,), backlash included."""
        return np.array(self._q)

    def true_nozzle(self) -> Array:
        """Return T_base_tool as it really is, shape (4, 4): with sag and vibration."""
        return self._T_nozzle

    def T_base_mount(self) -> Array:  # noqa: N802, a transform's name (design.md section 1)
        """Return the pose of the lidar's mount as it really is, shape (4, 4)."""
        return self._T_lidar


def _checked_load(load_kg: float) -> float:
    if not 0.0 <= load_kg <= 500.0:
        raise ConfigError(f"load_kg is {load_kg}, allowed 0..500 kg")
    return load_kg
