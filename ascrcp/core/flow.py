"""The types that flow: Scan -> Cloud -> Surface -> SprayPath -> JointSequence. Frozen, arrays read-only.

Frames: base (joint 1; X into the tunnel, Y left, Z up) and tunnel (s along the axis from the
axis point nearest the base origin, y left, z up in the section plane). Metres and radians.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile


class _Frozen:
    """Makes the arrays of a dataclass read-only and checks their shapes and finiteness.

    Subclasses name shapes in SHAPES: "n" is free but the same everywhere in one object.
    MAY_BE_NAN lists arrays in which NaN means "not seen".
    """

    SHAPES: ClassVar[dict[str, tuple[int | str, ...]]] = {}
    MAY_BE_NAN: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, shape in self.SHAPES.items():
            array = np.asarray(getattr(self, name))
            who = f"{type(self).__name__}.{name}"
            if array.ndim != len(shape):
                raise InputError(f"{who} must have shape {shape}, not {array.shape}")
            for wanted, got in zip(shape, array.shape, strict=True):
                size = sizes.setdefault(wanted, got) if isinstance(wanted, str) else wanted
                if got != size:
                    raise InputError(f"{who} must have shape {shape} ({wanted} = {size}), not {array.shape}")
            if array.dtype.kind == "f" and name not in self.MAY_BE_NAN and not np.isfinite(array).all():
                raise InputError(f"{who} must be finite, but holds NaN or infinity")
            array = array.view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)


def _left_out() -> Array:
    """Stand in for an array nobody gave; `_fill` knows it by its length."""
    return np.zeros(0)


def _fill(owner: object, name: str, default: Array) -> None:
    if len(getattr(owner, name)) == 0:
        object.__setattr__(owner, name, default)


def _check_fraction(who: str, values: Array) -> None:
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(f"{who} must lie in 0..1")


@dataclass(frozen=True)
class Scan(_Frozen):
    """Raw lidar lines as they came over the wire, with the arm where it was measured.

    Attributes:
        ranges: Distances [m], NaN where nothing came back, shape (lines, beams).
        beam: Beam angle within the scan plane [rad], shape (beams,).
        pan: Pan angle measured at each line [rad], shape (lines,).
        q: Joint vector as measured while the arm stood still, SI, shape (joints,).
        complete: False if the lidar or the pan head failed before the sweep ended (fault F35, F36).
    """

    ranges: NDArray[np.float32]
    beam: Array
    pan: Array
    q: Array
    complete: bool = True

    SHAPES: ClassVar = {"ranges": ("lines", "beams"), "beam": ("beams",), "pan": ("lines",), "q": ("joints",)}
    MAY_BE_NAN: ClassVar = frozenset({"ranges"})


@dataclass(frozen=True)
class Cloud(_Frozen):
    """Points in the base frame.

    Attributes:
        points: Positions [m], shape (n, 3), float32.
        source: Where they came from, for messages.
    """

    points: NDArray[np.float32]
    source: str = ""

    SHAPES: ClassVar = {"points": ("n", 3)}


@dataclass(frozen=True)
class Axis(_Frozen):
    """The tunnel axis: the line the design profile is drawn around.

    Attributes:
        point: Axis point nearest the base origin [m], base frame, shape (3,); station 0.
        direction: Unit vector into the heading, base frame, shape (3,).
        direction_sigma_deg: One standard deviation of its direction [deg].
        position_sigma: One standard deviation of its lateral position [m].
        evidence: What it was fitted to, e.g. ("sprayed", "arches", "profile").
    """

    point: Array
    direction: Array
    direction_sigma_deg: float = 0.0
    position_sigma: float = 0.0
    evidence: tuple[str, ...] = ()

    SHAPES: ClassVar = {"point": (3,), "direction": (3,)}

    @property
    def T_base_tunnel(self) -> Array:  # noqa: N802, a transform's name (design.md section 1)
        """Tunnel frame in the base frame: columns s, left, up; shape (4, 4)."""
        s = self.direction
        left = np.cross([0.0, 0.0, 1.0], s)
        left = left / np.linalg.norm(left)
        T = np.eye(4)
        T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = s, left, np.cross(s, left), self.point
        return T


class Label(IntEnum):
    """What a point of the labelled cloud was taken for."""

    OTHER = 0
    SPRAYED = 1
    BAY = 2
    ARCH = 3
    OVERBREAK = 4
    GROUND = 5
    FACE = 6


@dataclass(frozen=True)
class Arch:
    """One steel arch: station of its middle at the crown [m], width [m], lean [deg], span [deg]."""

    station: float
    width: float
    lean_deg: float
    span_deg: tuple[float, float]


@dataclass(frozen=True)
class Overbreak:
    """One overbreak region: where it lies, how much is missing beyond the overbreak line."""

    station: tuple[float, float]
    angle_deg: tuple[float, float]
    area_m2: float
    volume_m3: float
    max_depth_m: float
    confidence: float


@dataclass(frozen=True)
class Bay:
    """The wall between two arches (or an arch and an end): stations [m], arches at its ends."""

    station: tuple[float, float]
    arch_before: int | None
    arch_after: int | None


@dataclass(frozen=True)
class Surface(_Frozen):
    """The recognised heading: axis, profile, findings, the unrolled wall and the labelled cloud.

    Attributes:
        axis: Fitted axis.
        profile: Design profile it was compared with.
        unsprayed: First and last station of the part to spray [m].
        arches: By rising station.
        overbreak: By falling volume.
        bays: By rising station; together with the arches they tile `unsprayed`.
        station: Station of the unrolled wall's rows [m], uniform step, shape (ns,).
        along: Arc length of its columns along the design line [m], uniform step, shape (na,).
        offset: Outward offset of the wall (rock or sprayed, arches removed) from the design
            line [m], NaN where unknown, shape (ns, na).
        filled: Cells of `offset` that were not seen but filled (behind arches), shape (ns, na).
        points: The tunnel's points after crop and voxel [m], base frame, shape (n, 3).
        labels: `Label` of each point, shape (n,).
    """

    axis: Axis
    profile: Profile
    unsprayed: tuple[float, float]
    arches: tuple[Arch, ...]
    overbreak: tuple[Overbreak, ...]
    bays: tuple[Bay, ...]
    station: Array
    along: Array
    offset: NDArray[np.float32]
    filled: NDArray[np.bool_]
    points: NDArray[np.float32]
    labels: NDArray[np.uint8]

    SHAPES: ClassVar = {
        "station": ("ns",),
        "along": ("na",),
        "offset": ("ns", "na"),
        "filled": ("ns", "na"),
        "points": ("n", 3),
        "labels": ("n",),
    }
    MAY_BE_NAN: ClassVar = frozenset({"offset"})


@dataclass(frozen=True)
class SprayPath(_Frozen):
    """Planned nozzle poses in spraying order: one row per planned point (thesis table 4-1).

    Attributes:
        position: Nozzle position [m], base frame, shape (n, 3).
        theta2: Tilt of the spray direction along the tunnel [rad], 90 deg square, shape (n,).
        theta3: Spray direction around the tunnel [rad], shape (n,). With R_base_tunnel,
            T = R Rot(x, theta3) Rot(z, theta2) Rot(x, theta1); theta1 is free (eq. 4-5).
        station: Station of the wall point [m], shape (n,).
        angle: Section angle of the wall point [rad], shape (n,).
        bay: Index of the bay, shape (n,).
        pass_index: Running number of the pass; the nozzle sprays along a pass, not between
            passes that are not neighbours, shape (n,).
        overbreak: Whether the point fills an overbreak region, shape (n,).
        speed: Nozzle speed wanted when leaving the point [m/s], shape (n,); 0 leaves it to the timing.
        flow: Pump flow wanted there, fraction 0..1 of the pump's largest, shape (n,); left out: 1.
        R_base_tunnel: Rotation of the tunnel frame, shape (3, 3).
    """

    position: Array
    theta2: Array
    theta3: Array
    station: Array
    angle: Array
    bay: NDArray[np.int64]
    pass_index: NDArray[np.int64]
    overbreak: NDArray[np.bool_]
    R_base_tunnel: Array = field(default_factory=lambda: np.eye(3))
    speed: Array = field(default_factory=_left_out)
    flow: Array = field(default_factory=_left_out)

    SHAPES: ClassVar = {
        "position": ("n", 3),
        "theta2": ("n",),
        "theta3": ("n",),
        "station": ("n",),
        "angle": ("n",),
        "bay": ("n",),
        "pass_index": ("n",),
        "overbreak": ("n",),
        "R_base_tunnel": (3, 3),
        "speed": ("n",),
        "flow": ("n",),
    }

    def __post_init__(self) -> None:
        _fill(self, "speed", np.zeros(len(self.position)))
        _fill(self, "flow", np.ones(len(self.position)))
        super().__post_init__()
        _check_fraction("SprayPath.flow", self.flow)
        if not (self.speed >= 0.0).all():
            raise InputError("SprayPath.speed must not be negative")

    def __len__(self) -> int:
        return len(self.position)

    @property
    def direction(self) -> Array:
        """Unit spray direction (tool +x), base frame, shape (n, 3)."""
        s2 = np.sin(self.theta2)
        d = np.stack([np.cos(self.theta2), s2 * np.cos(self.theta3), s2 * np.sin(self.theta3)], -1)
        return d @ self.R_base_tunnel.T


@dataclass(frozen=True)
class JointSequence(_Frozen):
    """Joints against time: what the tracker follows. Rows are dense enough to interpolate.

    Attributes:
        t: Time of each row from the start [s], strictly rising from 0, shape (m,).
        q: Joint vector, SI, shape (m, joints).
        position: Nozzle position wanted at that instant [m], base frame, shape (m, 3).
        direction: Unit spray direction wanted, shape (m, 3).
        point: Index of the planned point reached at this row, -1 between points, shape (m,).
        spraying: Whether concrete should flow while leaving this row, shape (m,).
        flow: Pump flow wanted when leaving this row, fraction 0..1 of the pump's largest, 0 where not
            spraying, shape (m,); left out: 1 wherever concrete flows.
    """

    t: Array
    q: Array
    position: Array
    direction: Array
    point: NDArray[np.int64]
    spraying: NDArray[np.bool_]
    flow: Array = field(default_factory=_left_out)

    SHAPES: ClassVar = {
        "t": ("m",),
        "q": ("m", "joints"),
        "position": ("m", 3),
        "direction": ("m", 3),
        "point": ("m",),
        "spraying": ("m",),
        "flow": ("m",),
    }

    def __post_init__(self) -> None:
        _fill(self, "flow", np.asarray(self.spraying, dtype=float))
        super().__post_init__()
        _check_fraction("JointSequence.flow", self.flow)
        if (self.flow[~self.spraying] > 0.0).any():
            raise InputError("JointSequence.flow must be 0 where the sequence does not spray")
        if len(self.t) < 1 or self.t[0] != 0.0 or not (np.diff(self.t) > 0).all():
            raise InputError("JointSequence.t must start at 0 and rise strictly")

    @property
    def duration(self) -> float:
        """Time of the last row [s]."""
        return float(self.t[-1])
