"""Numbers of planning inside ducts: config/duct.yaml -> structs with bounds."""

from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.duct_bend import Bend
from ascrcp.kinematics.duct_body import BodyParameters
from ascrcp.kinematics.gradient_projection import ProjectionParameters

Positive = Annotated[float, Meta(gt=0.0)]
Count = Annotated[int, Meta(ge=1, le=10_000)]


class SweepParameters(Struct):
    """The acceleration function (eq. 11, 12).

    Attributes:
        alpha: Share of a joint's largest acceleration that is left alone.
        sweeps: Most steps of descent.
        rate: Of a step, as a share of the excess; 1/16 is the largest that is stable.
    """

    alpha: Annotated[float, Meta(gt=0.0, lt=1.0)]
    sweeps: Annotated[int, Meta(ge=0, le=10_000)]
    rate: Annotated[float, Meta(gt=0.0, le=0.0625)]


class ProgramParameters(Struct):
    """The ring as quadratic programs.

    Attributes:
        rounds: Programs solved.
        trust: Size of the first trust region [rad, m].
        tilt_deg: Tilt of the spray that costs as much as a joint's largest acceleration.
        roll_deg: The same for a turn about the spray direction.
        watch: Clearance over the margin from which a sphere is a constraint [m].
        surplus: Clearance over the margin aimed at [m].
        overstep: Clearance below the margin allowed on the way [m].
    """

    rounds: Count
    trust: Positive
    tilt_deg: Positive
    roll_deg: Positive
    watch: Positive
    surplus: Annotated[float, Meta(ge=0.0, le=0.05)]
    overstep: Annotated[float, Meta(gt=0.0, le=0.05)]


class RingParameters(Struct):
    """How a ring is planned; config/duct.yaml says each number's source.

    Attributes:
        count: Poses of a ring.
        stand_off: Gun to wall [m].
        dt: Time from pose to pose [s].
        margin: Clearance wanted [m].
        tilt_step_deg: Largest difference of neighbours' tilts (alpha and beta of 3.2).
        tilt_limit_deg: Largest tilt the process allows (3.2).
        lever_surplus: How much farther a lever carries than wanted [m].
        left_right, up_down: Joints that move what follows sideways, and up or down, from 1 (eq. 7).
        pose_rounds: Most changes of weights at one pose.
        ring_rounds: Most rounds of the ring.
        starts: Random starts tried for the first pose.
        start_spread: Their spread as a share of the ranges.
        start_relax: Self-motion steps towards least strain at the first pose.
        between: Parts a move between poses is checked in.
        bend, ring_z: The duct of the trials, and where its ring lies [m].
    """

    count: Annotated[int, Meta(ge=8, le=1000)]
    stand_off: Positive
    dt: Positive
    margin: Annotated[float, Meta(ge=0.0, le=0.5)]
    tilt_step_deg: Positive
    tilt_limit_deg: Annotated[float, Meta(gt=0.0, le=60.0)]
    lever_surplus: Annotated[float, Meta(ge=0.0, le=0.1)]
    left_right: list[int]
    up_down: list[int]
    pose_rounds: Count
    ring_rounds: Count
    starts: Count
    start_spread: Annotated[float, Meta(gt=0.0, le=1.0)]
    start_relax: Annotated[int, Meta(ge=0, le=1000)]
    between: Annotated[int, Meta(ge=2, le=100)]
    bend: Bend
    ring_z: float
    sweep: SweepParameters
    program: ProgramParameters
    projection: ProjectionParameters
    body: BodyParameters


def load_ring_parameters() -> RingParameters:
    """Read config/duct.yaml."""
    return load(CONFIG / "duct.yaml", RingParameters)
