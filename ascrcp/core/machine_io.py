"""What one control cycle reads from and writes to the machine. Plain floats: no arrays here."""

from dataclasses import dataclass, field

NEVER_NS = 1 << 62
"""Age of something never received."""


@dataclass(frozen=True, slots=True)
class MachineInputs:
    """The newest valid value of everything the bus told us, with its age, at one instant.

    Attributes:
        t_ns: Instant of this view [ns, monotonic].
        q: Joint vector as measured, SI (rad, m), NaN where never received. Joint 4 already has
            joint 2 taken off its inclinometer.
        age_ns: Age of each joint's newest valid frame [ns], NEVER_NS if none.
        in_range: Per joint, whether the newest raw value lies in the sensor's electrical range.
        estop: The mirrored state of the hard-wired emergency stop; True also when unknown.
        estop_age_ns: Age of the frame that carries it.
        controller_age_ns: Age of the motion controller's heartbeat.
        controller_enabled: Its echo of our enable bit.
        controller_tripped: Its watchdog has fired and it is neutral.
        oil_temp_c: Hydraulic oil temperature [deg C], NaN if unknown.
        pump_flow: Concrete flow as measured, fraction 0..1 of the pump's largest, NaN if unknown.
        pan: Pan head angle [rad], NaN if unknown.
        pan_age_ns: Age of the pan angle.
        bad_frames: Highest present end-to-end error counter over all frames (fault F3, F4).
        bus_ok: False after a bus error or when the adapter went away.
    """

    t_ns: int
    q: tuple[float, ...]
    age_ns: tuple[int, ...]
    in_range: tuple[bool, ...]
    estop: bool = True
    estop_age_ns: int = NEVER_NS
    controller_age_ns: int = NEVER_NS
    controller_enabled: bool = False
    controller_tripped: bool = False
    oil_temp_c: float = float("nan")
    pump_flow: float = float("nan")
    pan: float = float("nan")
    pan_age_ns: int = NEVER_NS
    bad_frames: int = 0
    bus_ok: bool = True


@dataclass(frozen=True, slots=True)
class Command:
    """What the platform wants the machine to do for the next cycle.

    Attributes:
        drive: Proportional valve drive per joint, fraction -1..1 of full opening.
        enable: Whether the controller may open valves at all.
        pump: Wanted concrete flow, fraction 0..1.
        accelerator: Wanted accelerator dose, fraction 0..1.
        air: Compressed air valve.
        pan_target: Pan head set-point [rad], None to leave it where it is.
    """

    drive: tuple[float, ...]
    enable: bool = False
    pump: float = 0.0
    accelerator: float = 0.0
    air: bool = False
    pan_target: float | None = field(default=None)


def neutral(joints: int) -> Command:
    """Return the command that moves nothing and sprays nothing."""
    return Command(drive=(0.0,) * joints)
