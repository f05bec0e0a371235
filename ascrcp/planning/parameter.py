"""Parameters of planning with their allowed ranges, read from config/planning.yaml."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from ascrcp.core.config import Struct, convert, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG
from ascrcp.planning.process import ProcessParameters, load_process

Fraction = Annotated[float, Meta(ge=0.05, le=1.0)]


class PlanningParameters(Struct):
    """How the nozzle's path is laid over the wall (thesis 4.2).

    Attributes:
        stand_off_m: Nozzle to wall along the spray direction.
        spray_radius_m: Distance of neighbouring passes.
        edge_distance_m: Outermost pass to the arch or the end of the bay.
        point_spacing_m: Largest distance of neighbouring points along the wall's arc.
        tilt_deg: Spray direction along the tunnel in the bay, theta2.
        tilt_outer_deg: theta2 beside an arch, on its side toward the sprayed part.
        tilt_inner_deg: theta2 beside an arch, on its side toward the next arch.
        seam_deg: Section angle at which passes are parted, None to leave them whole.
        position_smooth_m: One sigma of the window that averages the wall's roughness.
        normal_smooth_m: The same for the wall's normal.
        normal_limit_deg: Largest angle between the normal used and the design line's.
        bridge_m: Wall further than this from anything seen is left out.
        floor_clearance_m: Lowest nozzle above the floor.
        floor_tilt_deg: By how much a jet may point down where its nozzle would be lower.
        arch_clearance_m: Nearest nozzle to an arch's inner flange.
    """

    stand_off_m: Annotated[float, Meta(ge=0.3, le=3.0)]
    spray_radius_m: Annotated[float, Meta(ge=0.05, le=1.0)]
    edge_distance_m: Annotated[float, Meta(ge=0.0, le=1.0)]
    point_spacing_m: Annotated[float, Meta(ge=0.05, le=1.0)]
    tilt_deg: Annotated[float, Meta(ge=60.0, le=120.0)]
    tilt_outer_deg: Annotated[float, Meta(ge=60.0, le=90.0)]
    tilt_inner_deg: Annotated[float, Meta(ge=90.0, le=120.0)]
    seam_deg: Annotated[float, Meta(ge=-90.0, le=270.0)] | None
    position_smooth_m: Annotated[float, Meta(ge=0.0, le=0.5)]
    normal_smooth_m: Annotated[float, Meta(ge=0.05, le=1.0)]
    normal_limit_deg: Annotated[float, Meta(ge=0.0, le=60.0)]
    bridge_m: Annotated[float, Meta(ge=0.0, le=2.0)]
    floor_clearance_m: Annotated[float, Meta(ge=0.0, le=3.0)]
    floor_tilt_deg: Annotated[float, Meta(ge=0.0, le=45.0)]
    arch_clearance_m: Annotated[float, Meta(ge=0.0, le=1.0)]

    def __post_init__(self) -> None:
        if not self.edge_distance_m <= self.spray_radius_m:
            raise ConfigError(
                f"edge_distance_m {self.edge_distance_m} must not exceed spray_radius_m "
                f"{self.spray_radius_m}, or the wall beside the arches stays unsprayed"
            )


class TimingParameters(Struct):
    """How fast the path is travelled.

    Attributes:
        nozzle_speed_m_s: Nozzle speed along a pass.
        nozzle_acceleration_m_s2: Nozzle acceleration at the ends of a stroke.
        speed_fraction: Share of a joint's largest speed used on a stroke.
        acceleration_fraction: Share of a joint's largest acceleration used on a stroke.
        move_fraction: Share of speed, acceleration and jerk used between strokes.
        settle_s: Rest between a move and the stroke after it, for the boom to stop swinging.
        gap_m: Nozzle points further apart than this are joined by a move without spraying.
        row_s: Longest time between rows.
    """

    nozzle_speed_m_s: Annotated[float, Meta(ge=0.01, le=2.0)]
    nozzle_acceleration_m_s2: Annotated[float, Meta(ge=0.01, le=5.0)]
    speed_fraction: Fraction
    acceleration_fraction: Fraction
    move_fraction: Fraction
    settle_s: Annotated[float, Meta(ge=0.02, le=10.0)]
    gap_m: Annotated[float, Meta(ge=0.05, le=3.0)]
    row_s: Annotated[float, Meta(ge=0.02, le=0.5)]


class SolveParameters(Struct):
    """What the joints are solved against.

    Attributes:
        bodies: Whether vehicles, people and muck in the scan are kept clear of like the rest; without,
            they are taken to have left.
    """

    bodies: bool


class CheckParameters(Struct):
    """What the dry run lets pass."""

    speed_tolerance: Annotated[float, Meta(ge=0.0, le=0.2)]
    limit_tolerance_deg: Annotated[float, Meta(ge=0.0, le=1.0)]
    limit_tolerance_mm: Annotated[float, Meta(ge=0.0, le=10.0)]
    step_deg: Annotated[float, Meta(ge=0.1, le=45.0)]
    step_mm: Annotated[float, Meta(ge=1.0, le=500.0)]
    pose_mm: Annotated[float, Meta(ge=1.0, le=500.0)]
    pose_deg: Annotated[float, Meta(ge=0.1, le=45.0)]


class Parameters(Struct):
    """config/planning.yaml as a whole, and config/deposition.yaml as its process.

    Attributes:
        planner: "coverage" doses the concrete so that the wanted surface is reached; "thesis" lays the
            thesis's path (chapter 4) at constant nozzle speed and pump flow.
    """

    planner: Literal["coverage", "thesis"]
    process: ProcessParameters
    path: PlanningParameters
    solve: SolveParameters
    timing: TimingParameters
    check: CheckParameters

    def __post_init__(self) -> None:
        for name, spacing in (
            ("path", self.path.point_spacing_m),
            ("dose", self.process.dose.point_spacing_m),
        ):
            if not self.timing.gap_m > spacing:
                raise ConfigError(
                    f"timing: gap_m {self.timing.gap_m} must exceed point_spacing_m {spacing} of {name}, "
                    "or no two points are joined by spraying"
                )


def load_parameters(path: Path = CONFIG / "planning.yaml", planner: str | None = None) -> Parameters:
    """Read the planning configuration; `planner` in place of the configured one.

    Raises:
        ConfigError: Unreadable, or a value outside its range; the message names both.
    """
    found = load(path, Parameters, {"process": msgspec.to_builtins(load_process())})
    return found if planner is None else check_parameters(change(found, planner=planner))


S = TypeVar("S", bound=Struct)


def change(parameters: S, **values: object) -> S:
    """Return parameters with some fields changed; `check_parameters` them before use."""
    frozen: Any = parameters  # msgspec declares replace for its own class only, not for those made from it
    changed: S = msgspec.structs.replace(frozen, **values)
    return changed


def check_parameters(parameters: S) -> S:
    """Check parameters that were built or changed in code against the ranges of their fields.

    Raises:
        ConfigError: Naming the field and what is allowed.
    """
    return convert(msgspec.to_builtins(parameters), type(parameters), type(parameters).__name__)
