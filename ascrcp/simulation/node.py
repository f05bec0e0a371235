"""CAN nodes of the rig: motion controller with watchdog, machine status, joint sensors, pan head."""

from ascrcp.devices.codec import Codec
from ascrcp.simulation.parameter import BusConfig, PanConfig, SprayConfig
from ascrcp.simulation.wire import CommandReceiver, Sender

NS = 1_000_000_000
MODE_NEUTRAL, MODE_ENABLED, MODE_ESTOP = 0.0, 1.0, 2.0


class Controller:
    """The motion controller: opens valves only for fresh, whole, enabled commands (fault F27).

    After power-up, a watchdog trip or an emergency stop it stays neutral until the platform has
    taken its enable bit away and set it again.

    Attributes:
        estop: State of the hard-wired emergency stop line; it acts here whatever the platform says.
        tripped: The watchdog has fired.
        enabled: Whether the valves follow the commands now.
    """

    def __init__(self, codec: Codec, config: BusConfig) -> None:
        self._config = config
        self._limit_ns = round(config.watchdog_s * NS)
        names = ("ValveCommand1", "ValveCommand2", "SprayCommand")
        self._receivers = {
            codec.layout(name).can_id: CommandReceiver(
                codec.layout(name), config.max_delta, config.error_limit
            )
            for name in names
        }
        self._first, self._second, self._spray = self._receivers.values()
        self._status = Sender(codec.layout("ControllerStatus"))
        self.estop = False
        self.tripped = True
        self.enabled = False
        self._armed = False  # an enable bit of 0 was seen since the last trip

    def take(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Receive one frame; frames for others are not looked at."""
        receiver = self._receivers.get(can_id)
        if receiver is not None:
            receiver.accept(data, now_ns)

    def decide(self, now_ns: int) -> tuple[float, ...]:
        """Work out the drives of this cycle, -1..1, all zero unless everything is in order."""
        valves = (self._first, self._second)
        fresh = all(valve.is_fresh(now_ns, self._limit_ns) for valve in valves)
        sound = all(valve.errors < self._config.error_limit for valve in valves)
        wanted = all(valve.values[0] == 1.0 for valve in valves)
        if not (fresh and sound):
            self.tripped, self._armed = True, False
        elif not wanted:
            self.tripped = False
            self._armed = not self.estop
        if self.estop:
            self._armed = False
        self.enabled = wanted and self._armed and not self.tripped and not self.estop
        if not self.enabled:
            return (0.0,) * 8
        return tuple(percent / 100.0 for valve in valves for percent in valve.values[1:])

    def pump(self, now_ns: int) -> float:
        """Return the concrete flow the pump is told, fraction 0..1: none unless the valves are enabled."""
        if not self.enabled or not self._spray.is_fresh(now_ns, self._limit_ns):
            return 0.0
        return self._spray.values[1] / 100.0

    def status(self) -> tuple[int, bytes]:
        """Return the heartbeat frame."""
        mode = MODE_ESTOP if self.estop else MODE_ENABLED if self.enabled else MODE_NEUTRAL
        errors = max(receiver.errors for receiver in self._receivers.values())
        values = (float(self.enabled), float(self.tripped), mode, float(self._first.counter), float(errors))
        return self._status.layout.can_id, self._status.encode(values)


class MachineNode:
    """Emergency stop line, oil temperature and concrete flow.

    Attributes:
        flow: Concrete flow, fraction 0..1.
    """

    def __init__(self, codec: Codec, config: SprayConfig) -> None:
        self._sender = Sender(codec.layout("MachineStatus"))
        self._config = config
        self.flow = 0.0

    def advance(self, wanted: float, step_s: float) -> None:
        """Let the concrete flow follow what the pump is told."""
        self.flow += (wanted - self.flow) * min(1.0, step_s / self._config.time_constant_s)

    def status(self, estop: bool, oil_c: float) -> tuple[int, bytes]:
        """Return the machine status frame."""
        return self._sender.layout.can_id, self._sender.encode((float(estop), oil_c, 100.0 * self.flow))


class SensorNode:
    """One joint sensor on the bus."""

    def __init__(self, codec: Codec, number: int) -> None:
        self._sender = Sender(codec.layout(f"JointPosition{number}"))
        position = self._sender.layout.field("Position")
        self._low, self._high = position.minimum, position.maximum

    def status(self, reading: float) -> tuple[int, bytes]:
        """Return the frame of one reading; what does not fit the field goes out as a fault."""
        fits = self._low <= reading <= self._high
        values = (0.0, reading) if fits else (2.0, self._high)
        return self._sender.layout.can_id, self._sender.encode(values)


class PanHead:
    """The lidar's pan head: goes to the last set-point with limited speed."""

    def __init__(self, codec: Codec, config: PanConfig, bus: BusConfig) -> None:
        layout = codec.layout("PanCommand")
        self.command_id = layout.can_id
        self._receiver = CommandReceiver(layout, bus.max_delta, bus.error_limit)
        self._sender = Sender(codec.layout("PanPosition"))
        self._config = config
        self._shaft_deg = 0.0
        self._target_deg = 0.0

    @property
    def angle_deg(self) -> float:
        """True angle [deg]: what the encoder shows plus the zero error it does not see."""
        return self._shaft_deg + self._config.zero_error_deg

    def take(self, data: bytes, now_ns: int) -> None:
        """Receive one command frame."""
        if self._receiver.accept(data, now_ns):
            move, target = self._receiver.values
            low, high = self._config.limits_deg
            self._target_deg = max(low, min(high, target)) if move else self._shaft_deg

    def advance(self, step_s: float) -> None:
        """Turn for one cycle."""
        limit = self._config.speed_deg * step_s
        step = (self._target_deg - self._shaft_deg) * min(1.0, step_s / self._config.time_constant_s)
        self._shaft_deg += max(-limit, min(limit, step))

    def status(self) -> tuple[int, bytes]:
        """Return the frame with the encoder's angle."""
        steps = round(self._shaft_deg / self._config.resolution_deg)
        return self._sender.layout.can_id, self._sender.encode((0.0, steps * self._config.resolution_deg))
