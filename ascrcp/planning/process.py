"""The spraying process in numbers: jet, rebound, wanted surface, layers, dose; config/deposition.yaml."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG

Share = Annotated[float, Meta(ge=0.0, le=0.9)]
PumpStep = Annotated[float, Meta(gt=0.0, le=1.0)]
Speed = Annotated[float, Meta(ge=0.01, le=2.0)]
Layer = Annotated[float, Meta(ge=0.02, le=0.5)]


class SprayParameters(Struct):
    """The jet and the pump.

    Attributes:
        radius_m: Radius of the footprint at 1 m stand-off; it grows with the distance.
        beta: Shape of the footprint, density (1 - (r/R)^2)^(beta - 1).
        pump_m3_h: Flow at fraction 1.
        pump_steps: Low, middle and high flow, fractions.
        pump_lag_s: By how much the flow at the nozzle lags behind what the pump is told.
        pump_least: Least fraction the pump can hold; below it stands.
    """

    radius_m: Annotated[float, Meta(ge=0.05, le=1.0)]
    beta: Annotated[float, Meta(ge=1.0, le=20.0)]
    pump_m3_h: Annotated[float, Meta(ge=0.5, le=60.0)]
    pump_steps: tuple[PumpStep, PumpStep, PumpStep]
    pump_lag_s: Annotated[float, Meta(ge=0.0, le=5.0)]
    pump_least: Annotated[float, Meta(gt=0.0, le=0.5)]

    def __post_init__(self) -> None:
        low, middle, high = self.pump_steps
        if not self.pump_least <= low < middle < high:
            raise ConfigError(
                f"pump_steps {list(self.pump_steps)} must rise from at least pump_least {self.pump_least}"
            )

    @property
    def pump_m3_s(self) -> float:
        """Flow at fraction 1 [m3/s]."""
        return self.pump_m3_h / 3600.0


class ReboundParameters(Struct):
    """Share of the concrete that does not stick: by place, angle and distance."""

    wall: Share
    crown: Share
    angle: Annotated[float, Meta(ge=0.0, le=5.0)]
    distance: Annotated[float, Meta(ge=0.0, le=2.0)]
    best_m: Annotated[float, Meta(ge=0.3, le=3.0)]


class TargetParameters(Struct):
    """The surface wanted.

    Attributes:
        line_m: Its offset from the design line where rock lies outside it.
        cover_rock_m: Least layer over rock.
        cover_arch_m: Least layer over arches.
        tolerance_m: Finish aimed at.
        patch_m: Edge of the patches over which it is averaged.
        corner_m: Not judged so near to the ends of the unsprayed part.
    """

    line_m: Annotated[float, Meta(ge=-1.0, le=1.0)]
    cover_rock_m: Annotated[float, Meta(ge=0.0, le=0.5)]
    cover_arch_m: Annotated[float, Meta(ge=0.0, le=0.5)]
    tolerance_m: Annotated[float, Meta(ge=0.002, le=0.2)]
    patch_m: Annotated[float, Meta(ge=0.1, le=1.0)]
    corner_m: Annotated[float, Meta(ge=0.0, le=0.5)]


class LayerParameters(Struct):
    """Thickest layer laid at once, on walls and overhead."""

    wall_m: Layer
    crown_m: Layer


class DoseParameters(Struct):
    """How passes are laid for the dose, and how the dose is chosen; see config/deposition.yaml."""

    cell_m: Annotated[float, Meta(ge=0.03, le=0.15)]
    pass_spacing_m: Annotated[float, Meta(ge=0.05, le=1.0)]
    edge_m: Annotated[float, Meta(ge=0.0, le=0.5)]
    point_spacing_m: Annotated[float, Meta(ge=0.05, le=0.6)]
    near_stand_off_m: Annotated[float, Meta(ge=0.3, le=3.0)]
    face_tilt_deg: Annotated[float, Meta(ge=60.0, le=120.0)]
    speed_m_s: tuple[Speed, Speed]
    hold_back: Annotated[float, Meta(ge=0.0, le=0.3)]
    hold_back_slope: Annotated[float, Meta(ge=0.0, le=0.5)]
    hold_back_guess: Annotated[float, Meta(ge=0.0, le=1.0)]
    reserve: Annotated[float, Meta(ge=0.0, le=0.5)]
    over_weight: Annotated[float, Meta(ge=1.0, le=100.0)]
    fine: Annotated[float, Meta(ge=0.0, le=10.0)]
    smooth: Annotated[float, Meta(ge=0.0, le=10.0)]
    iterations: Annotated[int, Meta(ge=5, le=1000)]

    def __post_init__(self) -> None:
        if not self.speed_m_s[0] < self.speed_m_s[1]:
            raise ConfigError(f"speed_m_s {list(self.speed_m_s)} must rise")


class ProcessParameters(Struct):
    """config/deposition.yaml as a whole."""

    spray: SprayParameters
    rebound: ReboundParameters
    target: TargetParameters
    layer: LayerParameters
    dose: DoseParameters

    def __post_init__(self) -> None:
        if not self.dose.pass_spacing_m <= 2.0 * self.spray.radius_m:
            raise ConfigError(
                f"pass_spacing_m {self.dose.pass_spacing_m} must not exceed twice radius_m "
                f"{self.spray.radius_m}, or wall stays bare between the passes"
            )


def load_process(path: Path = CONFIG / "deposition.yaml") -> ProcessParameters:
    """Read the process.

    Raises:
        ConfigError: Unreadable, or a value outside its range; the message names both.
    """
    return load(path, ProcessParameters)
