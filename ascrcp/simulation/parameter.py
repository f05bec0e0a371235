"""Parameters of the simulated arm and its CAN nodes: config/simulation/arm.yaml and bus.yaml.

Angles, lengths and speeds of a joint are in its own unit (deg or mm), as a fitter would measure them.
"""

from typing import Annotated, Literal

import msgspec

from ascrcp.core.config import Struct

Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Celsius = Annotated[float, msgspec.Meta(ge=-40.0, le=150.0)]


class ValveConfig(Struct):
    """One proportional valve.

    Attributes:
        dead_band: Spool travel without flow, as a fraction of full drive, (negative, positive).
        frequency_hz: Natural frequency of the spool.
        damping: Damping ratio of the spool.
        dead_time_s: Delay between command and spool.
    """

    dead_band: tuple[Fraction, Fraction]
    frequency_hz: Annotated[float, msgspec.Meta(ge=0.5, le=50.0)]
    damping: Annotated[float, msgspec.Meta(ge=0.2, le=2.0)] = 0.8
    dead_time_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0

    def __post_init__(self) -> None:
        if max(self.dead_band) >= 0.5:
            raise ValueError(f"dead_band {self.dead_band} must stay below 0.5")


class LoadConfig(Struct):
    """How gravity loads a joint: share of the supply pressure it takes, positive when it pulls back.

    Attributes:
        kind: What the share is scaled with: the nozzle's horizontal reach, the cosine of the lance's
            inclination, or the sine of the boom's or the lance's inclination.
        share: Share of the arm's own weight at scale 1.
        payload_share: Further share of a hose full of concrete (thesis 5.2.2: 181 kg).
    """

    kind: Literal["none", "reach", "lance", "boom_slope", "lance_slope"] = "none"
    share: Fraction = 0.0
    payload_share: Fraction = 0.0


class StictionConfig(Struct):
    """Stick-slip of a hydraulic motor with little inertia behind it (joints 7 and 8).

    Attributes:
        breakaway: Spool opening beyond which a resting joint starts.
        hold: Spool opening below which a moving joint stops again.
        creep_speed: Slowest speed at which it turns at all [unit/s].
    """

    breakaway: Fraction = 0.0
    hold: Fraction = 0.0
    creep_speed: NotNegative = 0.0


class TransducerConfig(Struct):
    """One joint sensor as built, independent of how the platform believes it is wired.

    Attributes:
        zero: Reading at joint position 0 [wire unit].
        per_unit: Reading per joint unit [wire unit / joint unit].
        contains_joint: Number of the joint whose position is contained in the reading, 0 for none.
        lag_s: First-order lag.
        noise: Standard deviation of white noise [wire unit].
        bias: Standard deviation of the zero error left after calibration, drawn once [wire unit].
        resolution: Step of the reading [wire unit].
    """

    resolution: Positive
    zero: float = 0.0
    per_unit: float = 1.0
    contains_joint: Annotated[int, msgspec.Meta(ge=0, le=8)] = 0
    lag_s: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.0
    noise: NotNegative = 0.0
    bias: NotNegative = 0.0


class JointConfig(Struct):
    """One hydraulic joint.

    Attributes:
        name: For messages.
        unit: Joint unit of everything below.
        stops: Mechanical end stops (low, high) [unit].
        start: Where it stands when the rig is switched on [unit].
        speed: Speed at full drive without load at reference oil temperature, (negative, positive)
            [unit/s]; the ratio of the two is the area ratio of a differential cylinder.
        flow_lpm: Oil it takes at that speed [l/min].
    """

    name: str
    unit: Literal["deg", "mm"]
    stops: tuple[float, float]
    start: float
    speed: tuple[Positive, Positive]
    flow_lpm: Positive
    valve: ValveConfig
    sensor: TransducerConfig
    load: LoadConfig = LoadConfig()
    stiction: StictionConfig = StictionConfig()

    def __post_init__(self) -> None:
        if not self.stops[0] <= self.start <= self.stops[1]:
            raise ValueError(f"{self.name}: start {self.start} must lie between the stops {self.stops}")


class JointTable(Struct):
    """The eight joints by name, so that an overlay can change one figure of one joint."""

    j1: JointConfig
    j2: JointConfig
    j3: JointConfig
    j4: JointConfig
    j5: JointConfig
    j6: JointConfig
    j7: JointConfig
    j8: JointConfig

    @property
    def rows(self) -> tuple[JointConfig, ...]:
        """The joints in order."""
        return (self.j1, self.j2, self.j3, self.j4, self.j5, self.j6, self.j7, self.j8)


class OilConfig(Struct):
    """Hydraulic supply and oil.

    Attributes:
        supply_lpm: Flow the pump delivers to all joints together [l/min].
        start_c: Oil temperature at the start.
        ambient_c: Where it cools to.
        reference_c: Temperature at which the joint speeds hold.
        gain_per_c: Relative change of speed per degree above the reference (thinner oil is faster).
        time_constant_s: Of cooling.
        heating_c: Rise above ambient with the supply fully used.
        pressure_margin: Smallest share of pressure left under any load.
    """

    supply_lpm: Positive
    start_c: Celsius
    ambient_c: Celsius
    reference_c: Celsius
    gain_per_c: Annotated[float, msgspec.Meta(ge=0.0, le=0.02)]
    time_constant_s: Positive
    heating_c: NotNegative
    pressure_margin: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]


class ModeConfig(Struct):
    """One bending mode of the boom, seen at the end of the lance.

    Attributes:
        frequency_hz: Natural frequency at the reference reach without payload.
        damping: Damping ratio.
        participation: Share of the lance end's acceleration that excites it.
    """

    frequency_hz: Annotated[float, msgspec.Meta(ge=0.2, le=10.0)]
    damping: Annotated[float, msgspec.Meta(ge=0.005, le=0.9)]
    participation: NotNegative


class FlexureConfig(Struct):
    """Sag and vibration of the boom.

    Attributes:
        reference_reach: Horizontal reach at which the figures hold [m].
        sag_mm: Sag of the empty arm there.
        payload_sag_mm: Further sag under the full hose there.
        exponent: Power of the reach with which sag grows.
        frequency_exponent: Power of the reach with which the modes' frequency falls.
        slope: Tip rotation for one unit of deflection over reach (1.5: cantilever, force at its end).
        effective_mass_kg: Mass moving in the mode; payload lowers the frequency against it.
        pump_shake: Amplitude of the acceleration from the concrete pump's strokes at full flow [m/s2].
        pump_stroke_hz: Strokes of the concrete pump per second at full flow.
    """

    reference_reach: Positive
    sag_mm: NotNegative
    payload_sag_mm: NotNegative
    exponent: Annotated[float, msgspec.Meta(ge=0.0, le=4.0)]
    frequency_exponent: Annotated[float, msgspec.Meta(ge=0.0, le=3.0)]
    slope: NotNegative
    effective_mass_kg: Positive
    vertical: ModeConfig
    lateral: ModeConfig
    pump_shake: NotNegative
    pump_stroke_hz: Positive


class PanConfig(Struct):
    """Pan head of the lidar: a servo with limited speed.

    Attributes:
        limits_deg: End stops.
        speed_deg: Largest speed [deg/s].
        time_constant_s: Of its position loop.
        resolution_deg: Step of its encoder.
        zero_error_deg: True angle minus reading.
    """

    limits_deg: tuple[float, float]
    speed_deg: Positive
    time_constant_s: Positive
    resolution_deg: Positive
    zero_error_deg: float


class SprayConfig(Struct):
    """Concrete pump: first-order lag of the flow."""

    time_constant_s: Positive


class HoseConfig(Struct):
    """Concrete in the hose beside the payload a run begins with.

    Attributes:
        fill_kg: What flowing concrete adds once the hose is full.
        fill_s: Time constant of filling at full flow; without flow nothing changes.
        surge_kg: Amplitude with which the pump's strokes make the load swing at full flow.
    """

    fill_kg: Annotated[float, msgspec.Meta(ge=0.0, le=300.0)]
    fill_s: Positive
    surge_kg: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)]


class BumpConfig(Struct):
    """Knocks against the boom: hose, rebound, contact (thesis 5.2.2).

    Attributes:
        interval_s: Mean time between two; they come by chance.
        speed: One sigma of the speed each gives the swinging boom [m/s].
    """

    interval_s: Positive
    speed: NotNegative


class ArmConfig(Struct):
    """The simulated arm.

    Attributes:
        substep_s: Integration step of valves and cylinders.
        payload_reference_kg: Payload for which payload shares and sag hold.
        backlash_deg: Play of the slew drive behind its encoder.
    """

    substep_s: Annotated[float, msgspec.Meta(ge=0.0005, le=0.005)]
    payload_reference_kg: Positive
    backlash_deg: NotNegative
    joints: JointTable
    oil: OilConfig
    flexure: FlexureConfig
    pan: PanConfig
    spray: SprayConfig
    hose: HoseConfig
    bump: BumpConfig


class BusConfig(Struct):
    """The CAN nodes of the rig.

    Attributes:
        watchdog_s: Age of the newest valid command at which the controller goes neutral.
        max_delta: Largest step of the command counter the controller accepts.
        error_limit: Bad command frames in balance at which it goes neutral.
        loss_probability: Chance that a frame of the rig is lost on the way.
        corrupt_probability: Chance that one bit of it flips.
    """

    watchdog_s: Annotated[float, msgspec.Meta(ge=0.02, le=0.5)]
    max_delta: Annotated[int, msgspec.Meta(ge=1, le=7)]
    error_limit: Annotated[int, msgspec.Meta(ge=1, le=20)]
    loss_probability: Fraction = 0.0
    corrupt_probability: Fraction = 0.0
