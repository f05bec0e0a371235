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
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
NotNegative = Annotated[float, Meta(ge=0.0, le=100.0)]
Controller = Literal["identified", "stick_slip", "position", "fuzzy", "segmented", "pulsed", "separated"]
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


class IdentifiedConfig(Struct):
    """The project's own controller: feed-forward through the drive's inverse, feedback on an estimate.

    Attributes:
        kp: Speed per error left when the drive takes effect [1/s].
        edge: Share of what a reading contradicts the estimate by that is taken over each cycle.
        centre: Share of what it differs by within half a step.
        learn: Drive learned per full-speed second of contradiction, times this.
        offset_max: Largest drive that is learned.
        offset_spread: How far the dead band may be from the one identified, one sigma of drive.
        factor_spread: How far the speed may be from the one identified, one sigma of its factor: load, reach.
        factor_max: Largest change of the factor that is learned; 0 learns none.
        zone: Error that is left alone at rest [steps of the sensor].
        rest_speed: Reference speed that counts as rest [steps of the sensor per second].
    """

    kp: Annotated[float, Meta(gt=0.0, le=20.0)] = 3.0
    edge: Share = 0.3
    centre: Share = 0.04
    learn: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.8
    offset_max: DeadBand = 0.1
    offset_spread: Fraction = 0.01
    factor_spread: Share = 0.15
    factor_max: Annotated[float, Meta(ge=0.0, le=0.6)] = 0.4
    zone: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.5
    rest_speed: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.2


class PositionConfig(Struct):
    """Classic position PID, eq. 5-1, and the integral-separated one: straight to the drive.

    Attributes:
        kp: Drive per error [1/deg or 1/mm].
        ti_s: Integration time, 0 switches the integral off.
        td_s: Derivative time.
        separation: Error beyond which the separated PID has no integral [deg or mm].
    """

    kp: Annotated[float, Meta(gt=0.0, le=100.0)] = 0.05
    ti_s: Seconds = 0.0
    td_s: Seconds = 0.0
    separation: Positive = 1.0


class FuzzyConfig(Struct):
    """Fuzzy PID (thesis 5.1.2); the spans are what the rules add at PB and take away at NB.

    Attributes:
        error: Error at which its fuzzy set is PB [deg or mm].
        rate: Rate of the error likewise [deg/s or mm/s].
        rate_share: Share of the newest difference in the filtered rate.
        kp: Drive per error [1/deg or 1/mm], and its span.
        ki: Drive per error and second, and its span.
        kd: Drive per rate of the error, and its span.
        integral_max: Largest drive of the integral.
    """

    error: Positive = 3.0
    rate: Positive = 3.0
    rate_share: Share = 0.1
    kp: NotNegative = 0.1
    kp_span: NotNegative = 0.05
    ki: NotNegative = 0.0
    ki_span: NotNegative = 0.0
    kd: NotNegative = 0.0
    kd_span: NotNegative = 0.0
    integral_max: Share = 0.1


class StickSlipConfig(Struct):
    """A joint that cannot turn slowly: motion in pieces (joints 7 and 8).

    Attributes:
        creep: Slowest speed at which it turns at all [deg/s or mm/s].
        drive: Drive of a piece; must break the joint away.
        drive_max: Drive to which pieces that move nothing are raised.
        drive_step: By how much they are raised.
        cycles: Cycles of the shortest piece: the valve needs that long to open at all.
        start_s: From the first drive of a piece to motion.
        stop_s: From its end to rest.
        tail_s: Time by which a piece turns longer than it is driven; learned from then on.
        tail_max_s: Largest that is learned.
        band: Half a tooth: error at which a piece begins, and beyond the target at which it ends [deg, mm].
        zone: Error that is left alone at rest [deg or mm].
        kp: Speed per error above the creep speed [1/s].
    """

    creep: Positive = 6.0
    drive: Fraction = 0.18
    drive_max: Fraction = 0.4
    drive_step: Fraction = 0.02
    cycles: Cycles = 2
    start_s: Seconds = 0.045
    stop_s: Seconds = 0.04
    tail_s: Annotated[float, Meta(ge=-0.2, le=0.2)] = 0.01
    tail_max_s: Seconds = 0.06
    band: Positive = 0.15
    zone: Positive = 0.1
    kp: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0


class JointConfig(Struct):
    """One joint, in its own unit: deg of a turning, mm of a sliding joint.

    Attributes:
        name: For messages.
        controller: Which of the controllers drives it.
        unit: Unit of every length or angle of this joint.
        full_speed: Speed at full drive, (up, down) [unit/s].
        dead_band: Drive at which the valve begins to open, (up, down).
        delay_s: From a command to the speed it gives: dead time and valve.
        oil_per_c: Relative change of speed per degree of the oil above `oil_c`.
        oil_c: Oil temperature at which `full_speed` holds.
        rides_on: Number of the joint whose angle the sensor also shows, 0 for none.
        lag_s: Time constant of the sensor; the age of its frame is known apart.
        play: Between what the sensor sees and what moves the arm, in all [unit].
        take_up: Speed at which it is passed through [unit/s].
        ramp: Largest change of drive per cycle (thesis 5.2.2).
        resolution: Step of the sensor; an error below 0.6 of it is none.
        settle: Error within which the joint has arrived.
        slow: Error at which the reference waits.
        integral_max: Largest speed the integral may add, fraction of full speed.
        segments: Gains by range.
        pulse: Pulsed jog, absent for joints that can be driven gently.
        identified: The project's own controller.
        stick_slip: The project's own controller of a joint that cannot turn slowly.
        position: Classic and integral-separated PID.
        fuzzy: Fuzzy PID.
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
    controller: Controller = "identified"
    delay_s: Annotated[float, Meta(ge=0.0, le=0.3)] = 0.06
    oil_per_c: Annotated[float, Meta(ge=0.0, le=0.02)] = 0.0
    oil_c: Annotated[float, Meta(ge=-40.0, le=150.0)] = 45.0
    rides_on: Annotated[int, Meta(ge=0, le=8)] = 0
    play: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    take_up: Positive = 0.3
    pulse: PulseConfig | None = None
    identified: IdentifiedConfig = IdentifiedConfig()
    stick_slip: StickSlipConfig = StickSlipConfig()
    position: PositionConfig = PositionConfig()
    fuzzy: FuzzyConfig = FuzzyConfig()

    def __post_init__(self) -> None:
        ends = [segment.to for segment in self.segments]
        if self.controller == "pulsed" and self.pulse is None:
            raise ConfigError(f"control: joint {self.name} is to be pulsed, but has no pulse settings")
        if not ends or ends != sorted(set(ends)):
            raise ConfigError(f"control: segments of joint {self.name} must be there and rise, got {ends}")

    @property
    def si(self) -> float:
        """Factor from the joint's unit to SI."""
        return math.pi / 180.0 if self.unit == "deg" else 1e-3


class TrackerConfig(Struct):
    """How a sequence is followed (thesis fig. 5-2).

    Attributes:
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
