"""What the screen sees: one immutable snapshot of the job, taken whole at one control cycle."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.steer import SteerStatus
from ascrcp.core.event import Reaction
from ascrcp.core.flow import JointSequence, Surface
from ascrcp.core.geometry import Array
from ascrcp.core.machine_io import MachineInputs
from ascrcp.devices.joystick import LOST, StickState
from ascrcp.session.alarm_history import Alarm
from ascrcp.session.state import JobState


@dataclass(frozen=True)
class Lateness:
    """How late the control cycle began after its deadline [ms], and how many it missed whole."""

    p50: float = 0.0
    p99_9: float = 0.0
    max: float = 0.0
    missed: int = 0


@dataclass(frozen=True)
class Announcement:
    """One line for the operator: number, (English, Chinese), whether it reports a failure."""

    number: int
    text: tuple[str, str]
    failure: bool = False


@dataclass(frozen=True)
class Snapshot:
    """The job at one instant.

    Attributes:
        t_s: Job time [s] since start (virtual in lockstep).
        job: State machine's state.
        stage: What the active step is doing, (English, Chinese), empty at rest.
        progress: Fraction of the active step, 0..1.
        remaining_s: Estimated time the active step still needs [s], NaN if unknown.
        announcements: The last lines for the operator, newest last.
        reaction: Hardest reaction now in force.
        causes: Codes of core.event.EVENTS now active or latched, first cause first.
        estop: Mirror of the hard-wired emergency stop.
        q: Joints as measured, SI, NaN if unknown.
        q_target: Joints wanted, SI, NaN if the arm is to stay where it is.
        drive: Valve drives on the wire, -1..1.
        age_ms: Age of each joint's newest valid frame [ms].
        tip: Nozzle position measured [m], base frame.
        tip_direction: Spray direction measured.
        tip_target: Nozzle position wanted [m], NaN if none.
        tip_error_mm: Distance of the two [mm], NaN if none.
        tip_error_deg: Angle between the two spray directions [deg], NaN if none.
        point: Index of the planned point being approached, -1 if none.
        points: Number of planned points.
        reached: How many were reached within tolerance.
        skipped: How many were skipped.
        spraying: Whether concrete flows.
        oil_temp_c: Oil temperature [deg C].
        lateness: Control cycle lateness.
        realtime_factor: Job time per wall time.
        stick: The joystick.
        screen_stick: Whether the screen is to draw it.
        steer: What the operator is told while the stick has the arm, None else.
        armed: Whether the gate lets drives through.
        active_causes: Those of the causes that are there now.
        pump: Concrete flow on the wire, fraction.
        simulated: True on the rig: the screen says so in a banner.
        round_dir: Folder of the round.
        lockstep: Virtual time: it stands still while nothing moves.
        alarms: Causes that came, newest last, and when they went.
        inputs: Everything the machine said in the newest cycle, None before the first.
        frames: Identifier and data of that cycle's CAN frames, received before sent.
    """

    t_s: float
    job: JobState
    stage: tuple[str, str] = ("", "")
    progress: float = 0.0
    remaining_s: float = float("nan")
    announcements: tuple[Announcement, ...] = ()
    reaction: Reaction = Reaction.PROTECT
    causes: tuple[str, ...] = ()
    estop: bool = False
    q: tuple[float, ...] = ()
    q_target: tuple[float, ...] = ()
    drive: tuple[float, ...] = ()
    age_ms: tuple[float, ...] = ()
    tip: tuple[float, float, float] = (float("nan"),) * 3
    tip_direction: tuple[float, float, float] = (float("nan"),) * 3
    tip_target: tuple[float, float, float] = (float("nan"),) * 3
    tip_error_mm: float = float("nan")
    tip_error_deg: float = float("nan")
    point: int = -1
    points: int = 0
    reached: int = 0
    skipped: int = 0
    spraying: bool = False
    oil_temp_c: float = float("nan")
    lateness: Lateness = field(default_factory=Lateness)
    realtime_factor: float = float("nan")
    stick: StickState = LOST
    screen_stick: bool = False
    steer: SteerStatus | None = None
    armed: bool = False
    active_causes: tuple[str, ...] = ()
    pump: float = 0.0
    simulated: bool = True
    round_dir: str = ""
    lockstep: bool = False
    alarms: tuple[Alarm, ...] = ()
    inputs: MachineInputs | None = None
    frames: tuple[tuple[int, bytes], ...] = ()


@dataclass(frozen=True)
class WallLayer:
    """Values on the unrolled wall.

    Attributes:
        station: Of the rows [m], shape (ns,).
        along: Arc lengths of the columns [m], shape (na,).
        values: [m], NaN unknown, shape (ns, na).
        figures: What they come to, by the keys of plan.json or achieved.json; empty if nobody knows.
    """

    station: Array
    along: Array
    values: NDArray
    figures: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """What the 3-D view draws besides the arm; replaced whole when a stage finishes.

    Attributes:
        version: Rises by one with every change.
        points: A level of detail of the cloud [m], base frame, shape (n, 3), n <= 100,000.
        labels: `core.flow.Label` of each point, shape (n,).
        path: Planned nozzle positions [m], base frame, in spraying order, shape (m, 3).
        path_direction: Spray direction at each planned point, shape (m, 3); empty while nobody knows.
        path_pass: Pass of each planned point, shape (m,): lines join points of one pass.
        solved: Whether each planned point has joints, shape (m,).
        clearance: Distance to the surroundings at each planned point [m], NaN unknown, shape (m,) or empty.
        surface: The recognised surface, None before.
        sequence: The loaded joint sequence, None before: for the dry run on the screen.
        predicted: Layer the plan will lay, None while nobody knows.
        achieved: Layer that was laid, None while nobody knows.
    """

    version: int = 0
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    labels: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    path: Array = field(default_factory=lambda: np.zeros((0, 3)))
    path_pass: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    solved: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    surface: Surface | None = None
    path_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    clearance: Array = field(default_factory=lambda: np.zeros(0))
    sequence: JointSequence | None = None
    predicted: WallLayer | None = None
    achieved: WallLayer | None = None
