"""The machine at the other end of the CAN bus: frames -> MachineInputs, Command -> frames, each cycle."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.machine_io import NEVER_NS, Command, MachineInputs, neutral
from ascrcp.core.paths import CONFIG, RESOURCES
from ascrcp.devices.bus import ChannelConfig, FrameBus
from ascrcp.devices.codec import Codec, Layout
from ascrcp.devices.e2e import COUNTERS, Check, Receiver, protect
from ascrcp.devices.sensor import SensorArray, SensorConfig

DBC = RESOURCES / "ascrcp.dbc"
CONFIG_FILE = CONFIG / "devices" / "can.yaml"

_REASONS = {Check.REPEATED: "repeated", Check.BAD_CRC: "crc", Check.BAD_COUNTER: "counter"}


class E2eConfig(Struct):
    """How strictly frames are judged (faults F3, F4)."""

    max_delta: Annotated[int, msgspec.Meta(ge=1, le=7)]
    error_limit: Annotated[int, msgspec.Meta(ge=1, le=20)]


class CanConfig(Struct):
    """The CAN bus of one machine: config/devices/can.yaml."""

    bus: ChannelConfig
    e2e: E2eConfig
    range_margin: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)]
    sensors: Annotated[list[SensorConfig], msgspec.Meta(min_length=1, max_length=8)]


def load_can_config(path: Path = CONFIG_FILE, overlay: object = None) -> CanConfig:
    """Read the CAN configuration, with an optional tree laid over it."""
    return load(path, CanConfig, overlay)


@dataclass(slots=True)
class _Mailbox:
    """The newest valid value of one frame."""

    layout: Layout
    receiver: Receiver
    values: tuple[float, ...]
    stamp_ns: int = -1

    def age_ns(self, now_ns: int) -> int:
        return now_ns - self.stamp_ns if self.stamp_ns >= 0 else NEVER_NS


class MachineLink:
    """Mailboxes, error counters and the command frames of one machine.

    Attributes:
        received: (identifier, data) of every frame of the last receive(), good or bad.
        sent: The same of the last send().
        counters: Frames not used so far by reason: "unknown", "foreign" (somebody else sends our
            commands, fault F32), "length", "crc", "counter", "repeated"; "refused" counts commands
            that were not fit to be sent.
    """

    def __init__(self, bus: FrameBus, codec: Codec, config: CanConfig, joints: int = 8) -> None:
        """Bind the link to an open bus.

        Raises:
            ConfigError: DBC, sensors and number of joints do not fit together.
        """
        if len(config.sensors) != joints:
            raise ConfigError(f"can.yaml: {len(config.sensors)} sensors for an arm of {joints} joints")
        self._bus = bus
        self._joints = joints
        self._sensors = SensorArray(config.sensors, config.range_margin)
        self._boxes: dict[int, _Mailbox] = {}
        self._joint_boxes = [self._box(codec, f"JointPosition{i + 1}", config.e2e) for i in range(joints)]
        for box, sensor in zip(self._joint_boxes, config.sensors, strict=True):
            if box.layout.field("Position").unit != sensor.unit:
                raise ConfigError(f"can.yaml: {box.layout.name} is in {box.layout.field('Position').unit}")
        self._controller = self._box(codec, "ControllerStatus", config.e2e)
        self._machine = self._box(codec, "MachineStatus", config.e2e)
        self._pan = self._box(codec, "PanPosition", config.e2e)
        self._valves = [codec.layout("ValveCommand1"), codec.layout("ValveCommand2")]
        self._spray = codec.layout("SprayCommand")
        self._pan_command = codec.layout("PanCommand")
        own = (*self._valves, self._spray, self._pan_command)
        self._own_ids = frozenset(layout.can_id for layout in own)
        self._readings = [math.nan] * joints
        self._counter = COUNTERS - 1
        self._neutral = neutral(joints)
        self.received: list[tuple[int, bytes]] = []
        self.sent: list[tuple[int, bytes]] = []
        self.counters = dict.fromkeys(
            ("unknown", "foreign", "length", "crc", "counter", "repeated", "refused"), 0
        )

    def _box(self, codec: Codec, name: str, e2e: E2eConfig) -> _Mailbox:
        layout = codec.layout(name)
        receiver = Receiver(layout.seed, e2e.max_delta, e2e.error_limit)
        box = _Mailbox(layout, receiver, (math.nan,) * len(layout.fields))
        self._boxes[layout.can_id] = box
        return box

    def receive(self, now_ns: int) -> MachineInputs:
        """Drain the bus into the mailboxes and return what is known at this instant.

        Frames are stamped with now_ns: the drain is their receipt, at most one cycle after they
        reached the adapter.

        Args:
            now_ns: Present instant of the monotonic clock [ns].
        """
        frames = self._bus.drain()
        self.received = frames
        for can_id, data in frames:
            box = self._boxes.get(can_id)
            if box is None:
                self.counters["foreign" if can_id in self._own_ids else "unknown"] += 1
            elif len(data) != box.layout.length:
                self.counters["length"] += 1
                box.receiver.reject(Check.BAD_CRC)
            else:
                self._take(box, data, now_ns)
        return self._view(now_ns)

    def _take(self, box: _Mailbox, data: bytes, now_ns: int) -> None:
        verdict = box.receiver.check(data)
        if verdict is Check.NEW:
            box.values = box.layout.decode(data)
            box.stamp_ns = now_ns
        else:
            self.counters[_REASONS[verdict]] += 1

    def _view(self, now_ns: int) -> MachineInputs:
        in_range = []
        for i, box in enumerate(self._joint_boxes):
            status, reading = box.values
            good = self._sensors.is_in_range(i, reading, status)
            if good:
                # an impossible reading is reported, but never becomes an angle
                self._readings[i] = reading
            in_range.append(good)
        stop, oil, flow = self._machine.values
        enabled, tripped, _mode, _echo, _errors = self._controller.values
        pan_status, pan = self._pan.values
        return MachineInputs(
            t_ns=now_ns,
            q=self._sensors.to_joints(self._readings),
            age_ns=tuple(box.age_ns(now_ns) for box in self._joint_boxes),
            in_range=tuple(in_range),
            estop=stop != 0.0,  # pressed, error, unavailable and never received
            estop_age_ns=self._machine.age_ns(now_ns),
            controller_age_ns=self._controller.age_ns(now_ns),
            controller_enabled=enabled == 1.0,
            controller_tripped=tripped == 1.0,
            oil_temp_c=oil,
            pump_flow=flow / 100.0,
            pan=math.radians(pan) if pan_status == 0.0 else math.nan,
            pan_age_ns=self._pan.age_ns(now_ns),
            bad_frames=max(box.receiver.errors for box in self._boxes.values()),
            bus_ok=self._bus.ok,
        )

    @property
    def command_echo(self) -> tuple[int, int]:
        """Counter last sent and counter the controller last accepted (fault F26); -1 if unknown."""
        echo = self._controller.values[3]
        return self._counter, int(echo) if echo == echo else -1

    def send(self, command: Command) -> bool:
        """Send one cycle's command frames; what is not finite or out of range goes out as neutral.

        Returns:
            Whether the command itself was sent.
        """
        fit = self._is_fit(command)
        if not fit:
            self.counters["refused"] += 1
            command = self._neutral
        self._counter = (self._counter + 1) % COUNTERS
        self.sent = []
        percent = [100.0 * drive for drive in command.drive] + [0.0] * (8 - self._joints)
        enable = 1.0 if command.enable else 0.0
        self._send(self._valves[0], (enable, *percent[:4]))
        self._send(self._valves[1], (enable, *percent[4:]))
        air = 1.0 if command.air else 0.0
        self._send(self._spray, (air, 100.0 * command.pump, 100.0 * command.accelerator))
        target = command.pan_target
        self._send(self._pan_command, (0.0, 0.0) if target is None else (1.0, math.degrees(target)))
        return fit and self._bus.ok

    def _is_fit(self, command: Command) -> bool:
        # written so that NaN fails every comparison
        return (
            len(command.drive) == self._joints
            and all(abs(drive) <= 1.0 for drive in command.drive)
            and 0.0 <= command.pump <= 1.0
            and 0.0 <= command.accelerator <= 1.0
            and (command.pan_target is None or abs(command.pan_target) <= math.pi)
        )

    def _send(self, layout: Layout, values: tuple[float, ...]) -> None:
        frame = layout.encode(values)
        protect(frame, layout.seed, self._counter)
        data = bytes(frame)
        if self._bus.send(layout.can_id, data):
            self.sent.append((layout.can_id, data))
