"""Settings of the joystick's steering; config/control/steer.yaml fills them."""

import math
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.paths import CONFIG

Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Fraction = Annotated[float, Meta(gt=0.0, le=1.0)]


class SteerConfig(Struct):
    """How the stick moves the nozzle.

    Attributes:
        speed_m_s: Nozzle speed at full deflection.
        turn_deg_s: Turning of the spray direction at full deflection.
        acceleration_m_s2: Largest acceleration along the surface.
        jerk_m_s3: Largest jerk.
        joint_share: Share of each joint's largest speed that may be asked for.
        dead_zone: Deflection that counts as neutral.
        snap_deg: How near to along or across a direction is taken for it.
        step_m: Mesh of the steering surface along a pass.
        row_gap_m: Passes farther apart are no neighbours.
        branch_rad: Largest difference of turning joints between neighbouring poses of one branch.
        branch_m: The same of sliding joints.
        clearance_m: Nearer to the surroundings a jog goes no nearer (fault F18).
        clearance_every: Cycles between two looks at a jog's clearance.
        rejoin_mm: How far off the surface the nozzle may stand when steering begins.
        rejoin_deg: How far a turning joint may.
        jog_m_s: Nozzle speed of the free jog.
        jog_share: Share of a joint's largest speed in the single-joint jog.
    """

    speed_m_s: Annotated[float, Meta(gt=0.0, le=1.0)]
    turn_deg_s: Annotated[float, Meta(gt=0.0, le=60.0)]
    acceleration_m_s2: Positive
    jerk_m_s3: Positive
    joint_share: Fraction
    dead_zone: Annotated[float, Meta(gt=0.0, lt=0.5)]
    snap_deg: Annotated[float, Meta(ge=0.0, le=45.0)]
    step_m: Annotated[float, Meta(ge=0.02, le=0.5)]
    row_gap_m: Positive
    branch_rad: Positive
    branch_m: Positive
    clearance_m: Annotated[float, Meta(ge=0.05, le=2.0)]
    clearance_every: Annotated[int, Meta(ge=1, le=5)]
    rejoin_mm: Positive
    rejoin_deg: Positive
    jog_m_s: Annotated[float, Meta(gt=0.0, le=0.25)]
    jog_share: Annotated[float, Meta(gt=0.0, le=0.5)]

    @property
    def turn_m(self) -> float:
        """Way of the nozzle [m] that counts like turning the spray direction by one radian."""
        return self.speed_m_s / math.radians(self.turn_deg_s)


def load_steer_config(path: Path | None = None) -> SteerConfig:
    """Read the steering's settings.

    Raises:
        ConfigError: A key is missing, unknown or outside its range.
    """
    return load(path or CONFIG / "control" / "steer.yaml", SteerConfig)
