"""Settings of the safety gate: times, margins and drive limits; config/safety.yaml fills them."""

from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct
from ascrcp.core.errors import ConfigError

Millis = Annotated[int, Meta(ge=1, le=60_000)]
Count = Annotated[int, Meta(ge=1, le=1000)]
Degrees = Annotated[float, Meta(gt=0.0, le=30.0)]
Millimetres = Annotated[float, Meta(gt=0.0, le=500.0)]
Fraction = Annotated[float, Meta(gt=0.0, le=1.0)]


class SafetyConfig(Struct):
    """What the gate allows. Fault numbers are those of the fault catalogue.

    Attributes:
        stale_ms: Oldest joint value still trusted (F1).
        estop_stale_ms: Oldest e-stop mirror still trusted (F20).
        controller_stale_ms: Oldest heartbeat of the motion controller (F25).
        echo_cycles: Cycles the controller may contradict our enable bit (F26).
        bad_frames: End-to-end error counter at which the bus is given up (F3, F4).
        late_cycle_ms: A cycle that begins this long after the last one is late (F28).
        stop_cycle_ms: One such gap stops the motion (F28).
        suspended_ms: A gap that means the computer was asleep (F42).
        late_count: Late cycles within `late_window` cycles that stop the motion (F28).
        late_window: Number of cycles looked back on, at most 64.
        jump_factor: How many times its largest speed a joint may appear to move (F7).
        jump_noise_deg: What noise and resolution may add to that.
        jump_noise_mm: The same for prismatic joints.
        jump_count: New values beyond it, one after the other, that are a fault.
        jump_settle: New values close together after which a jumped sensor is steady again.
        soft_slack_deg: How far past its limit a joint may be driven before outward is blocked (F12).
        soft_slack_mm: The same for prismatic joints.
        hard_margin_deg: How far past its limit a joint counts as out of bounds (F13).
        hard_margin_mm: The same for prismatic joints.
        brake_s: Time in which a joint surely stops: dead time, valve and ramp (F12).
        dead_band: Drive that surely moves no joint.
        recovery_drive: Largest drive while a joint is brought back inside (F13).
        following_min_deg: Following error allowed at standstill (F11).
        following_max_deg: Following error allowed at full drive.
        following_min_mm: The same for prismatic joints.
        following_max_mm: The same for prismatic joints.
        following_cycles: Cycles beyond it that are a fault.
        stop_cycles: Cycles in which a controlled stop reaches zero (R2).
        drive_limit: Largest drive per joint, fraction of full opening.
        ramp: Largest change of drive per cycle and joint.
    """

    stale_ms: Millis
    estop_stale_ms: Millis
    controller_stale_ms: Millis
    echo_cycles: Count
    bad_frames: Count
    late_cycle_ms: Millis
    stop_cycle_ms: Millis
    suspended_ms: Millis
    late_count: Count
    late_window: Annotated[int, Meta(ge=1, le=64)]
    jump_factor: Annotated[float, Meta(ge=1.0, le=10.0)]
    jump_noise_deg: Degrees
    jump_noise_mm: Millimetres
    jump_count: Count
    jump_settle: Count
    soft_slack_deg: Degrees
    soft_slack_mm: Millimetres
    hard_margin_deg: Degrees
    hard_margin_mm: Millimetres
    brake_s: Annotated[float, Meta(gt=0.0, le=5.0)]
    dead_band: Annotated[float, Meta(ge=0.0, le=0.2)]
    recovery_drive: Fraction
    following_min_deg: Degrees
    following_max_deg: Degrees
    following_min_mm: Millimetres
    following_max_mm: Millimetres
    following_cycles: Count
    stop_cycles: Count
    drive_limit: list[Fraction]
    ramp: list[Fraction]

    def __post_init__(self) -> None:
        if len(self.drive_limit) != len(self.ramp):
            raise ConfigError(
                f"safety: drive_limit names {len(self.drive_limit)} joints, ramp {len(self.ramp)}"
            )
        for joint, (limit, ramp) in enumerate(zip(self.drive_limit, self.ramp, strict=True), 1):
            if not ramp * self.stop_cycles >= limit * (1.0 - 1e-9):
                raise ConfigError(
                    f"safety: ramp of joint {joint} is {ramp}, allowed at least drive_limit / stop_cycles"
                    f" = {limit / self.stop_cycles:g}"
                )
        for unit in ("deg", "mm"):
            slack, margin = getattr(self, f"soft_slack_{unit}"), getattr(self, f"hard_margin_{unit}")
            if not slack < margin:
                raise ConfigError(
                    f"safety: soft_slack_{unit} {slack} must be below hard_margin_{unit} {margin}"
                )
