"""What a session is put together from; the composition root fills it in for machine or rig."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from ascrcp.control.config import ControlConfig
from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.tracker import Tracker
from ascrcp.core.config import Struct
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.devices.lidar import Lidar, SweepConfig
from ascrcp.kinematics.arm import Arm
from ascrcp.perception.parameter import PerceptionParameters
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.safety.gate import Gate
from ascrcp.session.cycle import Link, Stick
from ascrcp.session.driver import Plant


class ReportConfig(Struct):
    """When a job counts as done: config/job.yaml.

    Attributes:
        sprayed_share: Least share of the planned points that must have been reached, and of these within
            the rule of 100 mm and 5 deg.
        covered_share: Share of the wall within tolerance at which no further spraying is offered.
    """

    sprayed_share: Annotated[float, Meta(ge=0.0, le=1.0)]
    covered_share: Annotated[float, Meta(ge=0.0, le=1.0)]


@dataclass(frozen=True)
class Setup:
    """The parts of one session.

    Attributes:
        arm: Kinematics of the machine.
        machine: Its name or the path of its YAML, for the compute process.
        link: The machine on its bus.
        tracker: Follows joint sequences.
        gate: The last word on every command.
        lidar: The line scanner.
        sweep: How the pan head carries it.
        profile: Design profile of the tunnel.
        perception: Parameters of recognition.
        planning: Parameters of path and timing.
        control: Parameters of control, for moves between poses.
        payload_kg: Concrete in the hose the solver reckons with [kg].
        cloud: Use this cloud in place of a scan, None to scan.
        plant: The rig, None on a machine.
        truth: The rig's true nozzle pose, None on a machine.
        lockstep: Virtual time as fast as it goes (rig only), or the processor's clock.
        steer: Settings of the joystick's steering.
        stick: The operator's joystick and what follows it.
        report: What a finished job must have reached.
        reopen: Opens the bus anew after its adapter failed; only on the operator's reset (fault F33).
        concrete: The rig's truth about the concrete laid so far [m3], empty on a machine.
        resprays: So many further sprayings are planned at most; None for as many as are asked for.
        manifest: What the round was made with, for the record.
        close: Releases bus, lidar and rig.
    """

    arm: Arm
    machine: str
    link: Link
    tracker: Tracker
    gate: Gate
    lidar: Lidar
    sweep: SweepConfig
    profile: Profile
    perception: PerceptionParameters
    planning: PlanningParameters
    control: ControlConfig
    payload_kg: float
    cloud: Path | None
    plant: Plant | None
    truth: Callable[[], Array] | None
    lockstep: bool
    steer: SteerConfig
    stick: Stick
    report: ReportConfig
    reopen: Callable[[], None]
    concrete: Callable[[], dict[str, float]]
    resprays: int | None
    manifest: dict[str, Any]
    close: Callable[[], None]
