"""Read a machine file: YAML -> ArmDescription, by translate/rotate steps or by D-H rows."""

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Positive = Annotated[float, Meta(gt=0.0)]
NonNegative = Annotated[float, Meta(ge=0.0)]
Vector = tuple[float, float, float]

MACHINES = CONFIG / "machines"


class DhRow(Struct):
    """One row of a standard (distal) Denavit-Hartenberg table; the joint adds to theta or d."""

    a: float = 0.0
    alpha_deg: float = 0.0
    d: float = 0.0
    theta_deg: float = 0.0


class Joint(Struct):
    """What both kinds of joint share: its step of the chain and its weight.

    Attributes:
        name: English name.
        name_zh: Chinese name.
        translate: Fixed translation before the joint [m] (eq. 2-1).
        axis: Axis of the previous frame the joint turns about or slides along.
        dh: D-H row, in place of translate and axis.
        limit_sum: Joint numbers whose sum the range limits, this joint last; empty: itself.
        travel_weight: Cost of moving this joint; large near the base (thesis 2.2: "move the
            small joints much, the large ones little").
    """

    name: str
    name_zh: str
    travel_weight: Positive
    translate: Vector | None = None
    axis: Axis | None = None
    dh: DhRow | None = None
    limit_sum: tuple[int, ...] = ()


class Revolute(Joint, kw_only=True, tag_field="kind", tag="revolute"):  # type: ignore[call-arg]
    """A turning joint, in degrees at this edge."""

    range_deg: tuple[float, float]
    max_speed_deg_s: Positive
    max_acceleration_deg_s2: Positive
    max_jerk_deg_s3: Positive


class Prismatic(Joint, kw_only=True, tag_field="kind", tag="prismatic"):  # type: ignore[call-arg]
    """A sliding joint, in metres."""

    range_m: tuple[float, float]
    max_speed_m_s: Positive
    max_acceleration_m_s2: Positive
    max_jerk_m_s3: Positive


class Mount(Struct):
    """A frame fixed to the end of a joint: translation [m], then turns about x, y, z [deg]."""

    joint: Annotated[int, Meta(ge=1)]
    translate: Vector = (0.0, 0.0, 0.0)
    rotate_deg: Vector = (0.0, 0.0, 0.0)


class SagModel(Struct):
    """Static sag of the tip: `sag.py` states the law.

    Attributes:
        own_mm: Sag under the arm's own weight at the reference reach [mm].
        load_mm_per_kg: Further sag there per kilogram of concrete in the hose [mm/kg].
        reference_reach: Horizontal distance from the base origin where these hold [m].
        exponent: Growth with reach; 3 for a cantilever loaded at its tip.
        slope_ratio: Pitch of the tip times reach over sag; 1.5 for that cantilever.
    """

    own_mm: NonNegative
    load_mm_per_kg: NonNegative
    reference_reach: Positive
    exponent: Annotated[float, Meta(ge=0.0, le=5.0)]
    slope_ratio: Annotated[float, Meta(ge=0.0, le=3.0)]


class Calibration(Struct):
    """What `ascrcp calibrate` noted in the file it wrote, and what its fit says about the joint sensors.

    Attributes:
        machine: Machine file it began with.
        machine_sha256: Checksum of that file.
        survey: File of measured tip positions.
        survey_sha256: Checksum of that file.
        rows: Rows used.
        set_aside: Lines of the survey that fit nothing (blunders).
        before_mm: Mean miss of the machine file it began with [mm].
        after_mm: Mean miss on rows not fitted [mm].
        sensor_zero: To be added to what each joint's sensor reads, degrees and metres by joint kind; a
            joint with limit_sum has its sensor on that sum. Empty: all zero.
    """

    machine: str
    machine_sha256: str
    survey: str
    survey_sha256: str
    rows: int
    set_aside: list[int]
    before_mm: NonNegative
    after_mm: NonNegative
    sensor_zero: list[float] = []


class PathModel(Struct):
    """How a whole path is solved: `path.py` states the method.

    Attributes:
        roll_step_deg: Spacing of the candidates of the free roll theta1.
        yaw_candidates: Number of candidates of joint 5 over its range.
        telescope_candidates: Number of candidates of joint 6 over its range.
        key_spacing: Distance along the path between points of the layered graph [m].
        margin_fraction: Share of each joint's range kept free at both ends where possible.
        limit_weight: Cost of entering that margin, against travel.
        centre_weight: Cost of leaving the middle of the range, against travel.
        curvature_weight: Cost of bends of the joints' course [m], against travel.
        break_cost: Cost of a break in the joints' course, in squared seconds of travel per metre.
        smooth_rounds: Largest number of smoothing rounds.
        nozzle_speed: Speed along a pass the joint steps are judged by [m/s].
        far: Neighbouring points farther apart than this are not sprayed through [m].
        reroll_s: A step that takes longer than spraying it by this much is a break [s].
    """

    roll_step_deg: Annotated[float, Meta(ge=1.0, le=90.0)]
    yaw_candidates: Annotated[int, Meta(ge=1, le=31)]
    telescope_candidates: Annotated[int, Meta(ge=1, le=31)]
    key_spacing: Positive
    margin_fraction: Annotated[float, Meta(ge=0.0, le=0.4)]
    limit_weight: NonNegative
    centre_weight: NonNegative
    curvature_weight: NonNegative
    break_cost: Positive
    smooth_rounds: Annotated[int, Meta(ge=1, le=100)]
    nozzle_speed: Positive
    far: Positive
    reroll_s: Positive


class Capsule(Struct):
    """A link's shape: all points within `radius` of a segment fixed to the end of a joint.

    Attributes:
        name: What a message calls it.
        joint: Joint after which it moves, from 1; 0: it stands still in the base frame.
        start: One end of the segment in that joint's frame [m].
        end: The other end.
        radius: Of the capsule [m].
    """

    name: str
    joint: Annotated[int, Meta(ge=0)]
    start: Vector
    end: Vector
    radius: Positive


class Box(Struct):
    """A part of the carrier: a box along the base frame's axes between two corners [m]."""

    name: str
    low: Vector
    high: Vector


class ClearanceModel(Struct):
    """How far the arm keeps from everything: `clearance.py` measures it, `feedback.py` restores it.

    Attributes:
        wanted: Clearance kept wherever the task allows [m].
        least: Clearance below which a point is not driven to [m].
        soft: Clearance from which solving a path begins to push away [m].
        weight: Cost of a squared metre below that, against travel.
        cell: Spacing of the distance field [m].
        tilt_step_deg: Steps in which the nozzle is tilted, and the largest difference of neighbours.
        tilt_limit_deg: Largest tilt from the planned direction.
    """

    wanted: Annotated[float, Meta(ge=0.0, le=2.0)]
    least: Annotated[float, Meta(ge=0.0, le=2.0)]
    soft: Annotated[float, Meta(ge=0.0, le=3.0)]
    weight: NonNegative
    cell: Annotated[float, Meta(ge=0.03, le=0.5)]
    tilt_step_deg: Annotated[float, Meta(ge=0.5, le=10.0)]
    tilt_limit_deg: Annotated[float, Meta(ge=0.0, le=45.0)]


class ArmDescription(Struct):
    """One machine: its joints from base to tool, its tool and what is known about it."""

    name: str
    title: str
    title_zh: str
    source: str
    joints: list[Revolute | Prismatic]
    tool: Vector
    lidar: Mount | None = None
    zero_pose: list[float] | None = None
    sag: SagModel | None = None
    calibration: Calibration | None = None
    path: PathModel | None = None
    capsules: list[Capsule] = []
    carrier: list[Box] = []
    self_pairs: list[tuple[str, str]] = []
    clearance: ClearanceModel | None = None

    def __post_init__(self) -> None:
        if not self.joints:
            raise ConfigError(f"machine {self.name}: joints must hold at least one joint")
        for number, joint in enumerate(self.joints, start=1):
            self._check_joint(number, joint)
        if self.lidar is not None and self.lidar.joint > len(self.joints):
            raise ConfigError(
                f"machine {self.name}: lidar.joint {self.lidar.joint}, allowed 1..{len(self.joints)}"
            )
        if self.calibration is not None and len(self.calibration.sensor_zero) not in (0, len(self.joints)):
            raise ConfigError(
                f"machine {self.name}: sensor_zero must hold {len(self.joints)} values [deg, m]"
            )
        if self.zero_pose is not None and len(self.zero_pose) != len(self.joints):
            raise ConfigError(f"machine {self.name}: zero_pose must hold {len(self.joints)} values [deg, m]")

        self._check_shapes()

    def _check_shapes(self) -> None:
        """Check that shapes belong to the machine's joints and pairs to its shapes."""
        names = [capsule.name for capsule in self.capsules]
        if len(set(names)) != len(names):
            raise ConfigError(f"machine {self.name}: two capsules of one name among {names}")
        for capsule in self.capsules:
            if capsule.joint > len(self.joints):
                raise ConfigError(
                    f"machine {self.name}: capsule {capsule.name} joint {capsule.joint}, "
                    f"allowed 0..{len(self.joints)}"
                )
        for box in self.carrier:
            if not all(low < high for low, high in zip(box.low, box.high, strict=True)):
                raise ConfigError(f"machine {self.name}: carrier {box.name} low must lie below high")
        for pair in self.self_pairs:
            if not set(pair) <= set(names) or pair[0] == pair[1]:
                raise ConfigError(f"machine {self.name}: self_pairs {pair} must name two of {names}")
        model = self.clearance
        if model is not None and not model.least <= model.wanted <= model.soft:
            raise ConfigError(f"machine {self.name}: clearance needs least <= wanted <= soft")

    def _check_joint(self, number: int, joint: Revolute | Prismatic) -> None:
        who = f"machine {self.name}: joint {number} {joint.name}"
        steps = joint.translate is not None and joint.axis is not None
        if steps == (joint.dh is not None) or (joint.dh and (joint.translate or joint.axis)):
            raise ConfigError(f"{who}: give either translate and axis, or dh")
        low, high = joint.range_deg if isinstance(joint, Revolute) else joint.range_m
        if not low < high:
            raise ConfigError(f"{who}: range {low}..{high} must rise")
        if joint.limit_sum and (
            joint.limit_sum[-1] != number or any(not 1 <= other < number for other in joint.limit_sum[:-1])
        ):
            raise ConfigError(f"{who}: limit_sum {joint.limit_sum} must name joints before it, then {number}")


def list_machines() -> tuple[str, ...]:
    """Return the names of the machines that come with the program."""
    return tuple(sorted(path.stem for path in MACHINES.glob("*.yaml")))


def find_machine(name_or_path: str | Path) -> Path:
    """Find the file of a machine by its name, or take a path to a YAML file as it is.

    Raises:
        ConfigError: No machine of this name.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or text.endswith((".yaml", ".yml")) or "/" in text:
        return Path(name_or_path)
    known = list_machines()
    if text not in known:
        raise ConfigError(
            f"no machine named {text!r}; known are {', '.join(known)}, or a path to a YAML file"
        )
    return MACHINES / f"{text}.yaml"


def load_description(name_or_path: str | Path) -> ArmDescription:
    """Read and check a machine file."""
    return load(find_machine(name_or_path), ArmDescription)
