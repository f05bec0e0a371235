"""The composition root: configuration -> real devices or simulated rig -> session."""

import itertools
import os
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import to_builtins

from ascrcp import __version__
from ascrcp.control.config import ControlConfig
from ascrcp.control.steer_config import load_steer_config
from ascrcp.control.steer_tracker import SteerTracker
from ascrcp.control.tracker import Tracker
from ascrcp.core.clock import CYCLE_S, NS
from ascrcp.core.config import convert, load, merge, read_yaml
from ascrcp.core.errors import ConfigError, DeviceError, InputError
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Profile, load_profile
from ascrcp.devices.bus import Bus
from ascrcp.devices.codec import Codec
from ascrcp.devices.joystick import Joystick, JoystickConfig, SetStick
from ascrcp.devices.joystick_can import CanJoystick
from ascrcp.devices.joystick_usb import UsbJoystick
from ascrcp.devices.lidar import Lidar, LidarDeviceConfig, SickLidar
from ascrcp.devices.machine_link import DBC, CanConfig, MachineLink, load_can_config
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.parameter import find_sensor_zero
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.parameter import load_parameters as load_planning
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.gate import Gate
from ascrcp.safety.limit import Limits
from ascrcp.session.cycle import Cycle, Stick
from ascrcp.session.replay import ReplayBus
from ascrcp.session.round import Round, open_round
from ascrcp.session.session import Session
from ascrcp.session.setup import ReportConfig, Setup
from ascrcp.session.steering import KernelMaker
from ascrcp.session.store import write_json
from ascrcp.session.surroundings import find_obstacles
from ascrcp.simulation.deposition import DepositionConfig
from ascrcp.simulation.fresh import GrowthConfig
from ascrcp.simulation.growth import NozzleRecord, SprayTruth
from ascrcp.simulation.heading import build_heading
from ascrcp.simulation.lidar import LidarServer
from ascrcp.simulation.lidar_model import LidarConfig
from ascrcp.simulation.rig import FOLDER, Fault, FaultKind, Rig, RigConfig
from ascrcp.simulation.tunnel import TunnelConfig

RIG_KEYS = ("arm", "bus", "tunnel", "lidar", "deposition", "growth")
LOCKSTEP_LIDAR_S = 30.0  # time stands still meanwhile; a busy computer must not look like a silent lidar
_CHANNELS = itertools.count(1)


@dataclass(frozen=True)
class Options:
    """What a front door may choose (design.md section 9).

    Attributes:
        machine: Name of an arm in config/machines, or a YAML.
        rig: File laid over the simulation's parameters.
        seed: Seed of everything random.
        load_kg: Concrete in the hose [kg].
        cloud: A cloud in place of the scan.
        profile: Design profile; the simulated tunnel's own if None.
        planner: Planner in place of the configured one.
        control: Control parameters as a tuning wrote them; those shipped for the machine if None.
        lockstep: Virtual time.
        joystick: A stick in place of the configured one.
        resprays: So many further sprayings at most; None for as many as the operator asks for.
    """

    machine: str = "kc"
    rig: Path | None = None
    seed: int = 1
    load_kg: float = 0.0
    cloud: Path | None = None
    profile: Path | None = None
    planner: str | None = None
    control: Path | None = None
    lockstep: bool = True
    joystick: Joystick | None = None
    resprays: int | None = None


@dataclass(frozen=True)
class Simulation:
    """Every parameter of the simulated site, checked."""

    rig: RigConfig
    tunnel: TunnelConfig
    lidar: LidarConfig
    jet: DepositionConfig
    growth: GrowthConfig


def load_simulation(overlay: Path | None) -> Simulation:
    """Read config/simulation/*.yaml with an overlay file.

    Raises:
        ConfigError: An unknown key or a value outside its range.
    """
    tree = {name: read_yaml(FOLDER / f"{name}.yaml") for name in RIG_KEYS}
    where = "simulation"
    if overlay is not None:
        laid = read_yaml(overlay)
        where = str(overlay)
        if not isinstance(laid, dict):
            raise ConfigError(f"{overlay}: must map {', '.join(RIG_KEYS)} to what is laid over them")
        unknown = sorted(str(key) for key in set(laid) - set(RIG_KEYS))
        if unknown:
            raise ConfigError(f"{overlay}: unknown key {unknown[0]}, allowed {', '.join(RIG_KEYS)}")
        tree = merge(tree, laid)
    return Simulation(
        rig=convert({"arm": tree["arm"], "bus": tree["bus"]}, RigConfig, where),
        tunnel=convert(tree["tunnel"], TunnelConfig, f"{where}: tunnel"),
        lidar=convert(tree["lidar"], LidarConfig, f"{where}: lidar"),
        jet=convert(tree["deposition"], DepositionConfig, f"{where}: deposition"),
        growth=convert(tree["growth"], GrowthConfig, f"{where}: growth"),
    )


class Site:
    """The simulated machine in its heading: what the session calls the plant."""

    def __init__(self, rig: Rig, lidar: LidarServer | None, record: NozzleRecord) -> None:
        self.rig = rig
        self._lidar = lidar
        self._record = record

    def step(self, now_ns: int) -> None:
        """Advance the rig by one cycle, carry the lidar along, let the wall grow."""
        self.rig.step(now_ns)
        if self._lidar is None:
            return
        self._lidar.set_pose(self.rig.T_base_mount(), self.rig.pan)
        batch = self._record.add(now_ns / NS, self.rig.true_nozzle(), self.rig.flow, CYCLE_S)
        if batch is not None:
            self._lidar.lay(batch)

    def concrete(self) -> dict[str, float]:
        """Return what became of the concrete so far [m3]; empty where no wall is, or nobody to tell."""
        try:
            return {} if self._lidar is None else self._lidar.concrete()
        except DeviceError:  # it says so itself, to whom it matters: at the next scan
            return {}

    def plant_fault(self, kind: FaultKind, frame: str, value: float) -> None:
        """Plant a fault in the rig, from the next cycle on."""
        self.rig.inject(Fault(kind, frame, value))

    def clear_faults(self) -> None:
        """Take all planted faults away and release the emergency stop."""
        self.rig.clear_faults()
        self.rig.release_estop()

    def press_estop(self) -> None:
        """Press the rig's hard-wired emergency stop."""
        self.rig.press_estop()

    def release_estop(self) -> None:
        """Release it."""
        self.rig.release_estop()


def find_profile(options: Options, tunnel: TunnelConfig) -> Profile:
    """Return the design profile asked for, or the simulated tunnel's own."""
    if options.profile is not None:
        return load_profile(options.profile)
    named = CONFIG / "profiles" / f"{tunnel.profile}.yaml"
    return load_profile(named if named.exists() else Path(tunnel.profile))


def open_session(options: Options, folder: Path | None, rounds: Path) -> Session:
    """Put a session together on the simulated rig.

    Args:
        options: What the front door chose.
        folder: Round folder, None for the next numbered one.
        rounds: Where numbered round folders are.

    Raises:
        InputError: Bad configuration or options; nothing has been started or written then.
        DeviceError: The configured joystick cannot be opened; the message says what is missing.
    """
    if options.cloud is not None and not options.cloud.is_file():
        raise InputError(f"{options.cloud}: no such file")
    arm = load_arm(options.machine)
    simulation = load_simulation(options.rig)
    profile = find_profile(options, simulation.tunnel)
    can = calibrated_can(load_can_config(), arm)
    control = load_control(arm, options.control)
    device = load(CONFIG / "devices" / "lidar.yaml", LidarDeviceConfig)
    perception, planning = load_perception(), load_planning(planner=options.planner)
    gate, tracker = open_gate(arm), Tracker(arm, control)
    codec = Codec(DBC)
    _check_bus(can)
    steer, report = load_steer_config(), load(CONFIG / "job.yaml", ReportConfig)
    joystick_config = load(CONFIG / "devices" / "joystick.yaml", JoystickConfig)
    with ExitStack() as opened:
        joystick = options.joystick or open_joystick(joystick_config)
        opened.callback(joystick.close)
        round_ = open_round(folder, rounds)
        opened.enter_context(round_.lock())
        round_.check_machine(options.machine)
        spray = _spray_truth(simulation, planning)
        server = None
        if options.cloud is None:
            server = opened.enter_context(closing(_open_heading(options, simulation, profile, spray, round_)))
        machine, rig, ours = _open_rig(arm, can, codec, simulation.rig, options, opened)
        timeout_s = LOCKSTEP_LIDAR_S if options.lockstep else device.timeout_s
        lidar: Lidar = SickLidar(server.host, server.port, timeout_s) if server else _NoLidar()
        opened.callback(lidar.close)
        site = Site(rig, server, NozzleRecord(spray))
        kernels = KernelMaker(arm, steer, options.load_kg)
        kept = ExitStack()
        session = Session(
            Setup(
                arm=arm,
                machine=options.machine,
                link=machine,
                tracker=tracker,
                gate=gate,
                lidar=lidar,
                sweep=device.sweep,
                profile=profile,
                perception=perception,
                planning=planning,
                control=control,
                payload_kg=options.load_kg,
                cloud=options.cloud,
                plant=site,
                truth=rig.true_nozzle,
                lockstep=options.lockstep,
                steer=steer,
                stick=Stick(joystick, SteerTracker(control, steer, arm.n), kernels),
                report=report,
                reopen=ours.reopen,
                concrete=site.concrete,
                resprays=options.resprays,
                manifest=_manifest(options, profile),
                close=kept.close,
            ),
            round_,
        )
        kept.push(opened.pop_all())  # from here on the session closes it all
        return session


def _open_heading(
    options: Options, simulation: Simulation, profile: Profile, spray: SprayTruth, round_: Round
) -> LidarServer:
    """Draw the heading, note its truth in the round, and put the lidar before it."""
    heading = build_heading(simulation.tunnel, np.random.default_rng([options.seed, 1]), profile)
    write_json(round_.folder / "truth.json", heading.truth.to_dict())
    return LidarServer(simulation.lidar, heading, options.seed, spray)


def open_replay(round_: Round, bus: ReplayBus) -> Cycle:
    """Put a fresh control cycle together as the round's was, on recorded frames."""
    arm = load_arm(str(round_.manifest().get("machine", "kc")))
    can = calibrated_can(load_can_config(), arm)
    link = MachineLink(bus, Codec(DBC), can, joints=arm.n)
    tuned = round_.manifest().get("control")
    control, steer = load_control(arm, Path(str(tuned)) if tuned else None), load_steer_config()
    planning, payload_kg = load_planning(), float(round_.manifest().get("load_kg", 0.0))
    kernels = KernelMaker(
        arm, steer, payload_kg, lambda scan: find_obstacles(Round(round_.folder / scan), arm, planning)
    )
    stick = Stick(None, SteerTracker(control, steer, arm.n), kernels)
    return Cycle(link, Tracker(arm, control), open_gate(arm), arm.forward, stick=stick)


def open_joystick(config: JoystickConfig) -> Joystick:
    """Open the configured joystick.

    Raises:
        DeviceError: It cannot be opened; the message says what is missing.
    """
    if config.source == "usb":
        return UsbJoystick(config.usb, config.stale_ms.usb)
    if config.source == "can":
        return CanJoystick(config.can, config.stale_ms.can)
    return SetStick(config.stale_ms.screen)


def calibrated_can(can: CanConfig, arm: Arm) -> CanConfig:
    """Shift the sensors' zeros by what a calibration found."""
    tree = to_builtins(can)
    for sensor, known, zero in zip(tree["sensors"], can.sensors, find_sensor_zero(arm), strict=True):
        sensor["zero"] = known.zero - float(zero) / known.si_per_unit
    return convert(tree, CanConfig, f"machine {arm.name}: calibrated sensors")


def load_control(arm: Arm, tuned: Path | None = None) -> ControlConfig:
    """Read the machine's control parameters: as shipped, or as a tuning wrote them."""
    return load(tuned or CONFIG / "control" / f"{arm.name}.yaml", ControlConfig)


def open_gate(arm: Arm) -> Gate:
    """Build the gate for an arm."""
    limits = Limits.of_arm(arm.joints, arm.max_speed.tolist())
    return Gate(limits, load(CONFIG / "safety.yaml", SafetyConfig))


def _spray_truth(simulation: Simulation, planning: PlanningParameters) -> SprayTruth:
    """Put together what the site knows about the spraying; its pump is the one the plan reckons with."""
    depth = simulation.tunnel.arches.depth
    return SprayTruth(simulation.jet, simulation.growth, depth, planning.process.spray.pump_m3_s)


def _check_bus(can: CanConfig) -> None:
    if can.bus.interface != "virtual":
        raise ConfigError(
            "config/devices/can.yaml: the simulated rig needs bus interface virtual (fault F44)"
        )


def _open_rig(
    arm: Arm, can: CanConfig, codec: Codec, config: RigConfig, options: Options, opened: ExitStack
) -> tuple[MachineLink, Rig, Bus]:
    channel = f"{can.bus.channel}-{os.getpid()}-{next(_CHANNELS)}"
    ours = opened.enter_context(closing(Bus(can.bus, channel)))
    theirs = opened.enter_context(closing(Bus(can.bus, channel)))
    rig = Rig(config, arm, theirs, seed=options.seed, load_kg=options.load_kg, codec=codec)
    return MachineLink(ours, codec, can, joints=arm.n), rig, ours


def _manifest(options: Options, profile: Profile) -> dict[str, Any]:
    return {
        "version": __version__,
        "simulated": True,
        "machine": options.machine,
        "profile": profile.name,
        "seed": options.seed,
        "load_kg": options.load_kg,
        "rig": str(options.rig) if options.rig else None,
        "cloud": str(options.cloud) if options.cloud else None,
        "control": str(options.control) if options.control else None,
    }


class _NoLidar:
    """Stands where a scan is replaced by a cloud file: nobody may scan."""

    def open(self) -> None:
        raise InputError("this session works on a cloud file and has no lidar")

    def read_line(self) -> Any:
        raise InputError("this session works on a cloud file and has no lidar")

    def close(self) -> None:
        """Nothing is open."""
