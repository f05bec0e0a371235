"""Settings of the joint controllers, the moves and the tracker; config/control/*.yaml fills them."""

import math
from typing import Annotated, Literal

from msgspec import Meta

from ascrcp.core.config import Struct
from ascrcp.core.errors import ConfigError

Seconds = Annotated[float, Meta(ge=0.0, le=60.0)]
Positive = Annotated[float, Meta(gt=0.0, le=10_000.0)]
Fraction = Annotated[float, Meta(gt=0.0, le=1.0)]
DeadBand = Annotated[float, Meta(ge=0.0, le=0.3)]
Cycles = Annotated[int, Meta(ge=1, le=500)]


class BandConfig(Struct):
    """Gains while the error is below a bound (thesis 5.1.3: segments by error).

    Attributes:
        below: Largest error of the band [deg or mm]; bands stand in rising order.
        kp: Speed per error [1/s], Kp of eq. 5-1 before the drive characteristic.
        ti_s: Integration time of eq. 5-5, 0 switches the integral off.
        td_s: Derivative time of eq. 5-1.
    """

    below: Positive
    kp: Annotated[float, Meta(gt=0.0, le=50.0)]
    ti_s: Seconds = 0.0
    td_s: Seconds = 0.0


class SegmentConfig(Struct):
    """One part of a joint's range (thesis 5.1.3: segments by range).

    Attributes:
        to: Upper end of the part [deg or mm]; parts stand in rising order.
        offset: Constant drive `a` of eq. 5-6 for gravity and load.
        bands: Gains by error.
    """

    to: float
    bands: list[BandConfig]
    offset: Annotated[float, Meta(ge=-0.5, le=0.5)] = 0.0

    def __post_init__(self) -> None:
        bounds = [band.below for band in self.bands]
        if not bounds or bounds != sorted(set(bounds)):
            raise ConfigError(
                f"control: bands of the segment to {self.to} must rise, at least one; got {bounds}"
            )


class PulseConfig(Struct):
    """Pulsed jog of joints that cannot be driven gently (thesis 5.1.3, table 5-9).

    Attributes:
        below: Error below which the joint is pulsed [deg or mm].
        speed_below: Reference speed below which it is pulsed [deg/s or mm/s].
        zone: Error that is left alone: half of the smallest movement [deg or mm].
        drive: Drive of the first pulse.
        drive_max: Drive to which pulses that move nothing are raised.
        drive_step: By how much they are raised; by half of it they are lowered again.
        cycles: Length of the shortest pulse: the valve needs that long to open at all.
        cycles_max: Length of the longest.
        rest_cycles: Pause after a pulse, so that the joint stands and the sensor tells.
    """

    below: Positive
    speed_below: Positive
    zone: Positive
    drive: Fraction
    drive_max: Fraction
    drive_step: Fraction
    cycles: Cycles
    cycles_max: Cycles
    rest_cycles: Cycles


class JointConfig(Struct):
    """One joint, in its own unit: deg of a turning, mm of a sliding joint.

    Attributes:
        name: For messages.
        unit: Unit of every length or angle of this joint.
        full_speed: Speed at full drive, (up, down) [unit/s].
        dead_band: Drive at which the valve begins to open, (up, down).
        lag_s: Time constant of the sensor; the age of its frame is known apart.
        ramp: Largest change of drive per cycle (thesis 5.2.2).
        resolution: Step of the sensor; an error below 0.6 of it is none.
        settle: Error within which the joint has arrived.
        slow: Error at which the reference waits.
        integral_max: Largest speed the integral may add, fraction of full speed.
        segments: Gains by range.
        pulse: Pulsed jog, absent for joints that can be driven gently.
    """

    name: str
    unit: Literal["deg", "mm"]
    full_speed: tuple[Positive, Positive]
    dead_band: tuple[DeadBand, DeadBand]
    lag_s: Seconds
    ramp: Fraction
    resolution: Positive
    settle: Positive
    slow: Positive
    integral_max: Fraction
    segments: list[SegmentConfig]
    pulse: PulseConfig | None = None

    def __post_init__(self) -> None:
        ends = [segment.to for segment in self.segments]
        if not ends or ends != sorted(set(ends)):
            raise ConfigError(f"control: segments of joint {self.name} must be there and rise, got {ends}")

    @property
    def si(self) -> float:
        """Factor from the joint's unit to SI."""
        return math.pi / 180.0 if self.unit == "deg" else 1e-3


class TrackerConfig(Struct):
    """How a sequence is followed (thesis fig. 5-2).

    Attributes:
        lead_s: How far ahead the reference speed is fed forward: valve and bus.
        ideal_mm: Ideal nozzle error at a planned point.
        ideal_deg: Ideal error of the spray direction.
        tolerance_factor: Tolerance over ideal (thesis 5.2.1: 1.5).
        safe_mm: Nozzle error up to which a point may be skipped; beyond, the run fails (F17).
        safe_deg: The same for the direction.
        settle_s: Time a point, or the end, is given to settle.
        slow_from: Share of tolerance at which the reference begins to slow down.
        slow_to: Share at which it stands.
        scale_rate: Largest change of the time scale [1/s].
        scale_rise: Largest rise of the time scale [1/s].
        scale_ease_s: Time constant with which it follows tolerable errors.
        stall_s: Time without progress after which the run fails.
        start_deg: Largest error of a turning joint at which a sequence may begin.
        start_mm: The same for a sliding joint.
        arrived_cycles: Cycles within `settle` that make an arrival.
        coupled: Near and far joint, numbered from 1, that do not move together on large errors.
        coupled_deg: What a large error is.
        accelerator: Accelerator dose at the pump's full flow, fraction of its largest; follows the pump.
        pump_scale_min: Time scale below which no concrete flows.
    """

    lead_s: Seconds
    ideal_mm: Positive
    ideal_deg: Positive
    tolerance_factor: Annotated[float, Meta(ge=1.0, le=5.0)]
    safe_mm: Positive
    safe_deg: Positive
    settle_s: Seconds
    slow_from: Positive
    slow_to: Positive
    scale_rate: Positive
    scale_rise: Positive
    scale_ease_s: Seconds
    stall_s: Seconds
    start_deg: Positive
    start_mm: Positive
    arrived_cycles: Cycles
    coupled: tuple[int, int]
    coupled_deg: Positive
    accelerator: Annotated[float, Meta(ge=0.0, le=1.0)]
    pump_scale_min: Fraction

    def __post_init__(self) -> None:
        if not self.slow_from < self.slow_to:
            raise ConfigError(f"control: slow_from {self.slow_from} must be below slow_to {self.slow_to}")
        for unit in ("mm", "deg"):
            tolerance = getattr(self, f"ideal_{unit}") * self.tolerance_factor
            if not tolerance <= getattr(self, f"safe_{unit}"):
                raise ConfigError(f"control: safe_{unit} must be at least the tolerance, {tolerance:g}")


class MoveConfig(Struct):
    """Joint moves between poses.

    Attributes:
        speed: Share of each joint's largest speed.
        acceleration: Share of each joint's largest acceleration and jerk.
        row_s: Time between the rows of the sequence.
        coupled_deg: Travel of both coupled joints beyond which they move one after the other.
    """

    speed: Fraction
    acceleration: Fraction
    row_s: Annotated[float, Meta(ge=0.01, le=1.0)]
    coupled_deg: Positive


class ControlConfig(Struct):
    """All of a machine's control: joints in order, tracker, moves."""

    joints: list[JointConfig]
    tracker: TrackerConfig
    move: MoveConfig
