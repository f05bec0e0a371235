"""Describe a simulated tunnel heading: YAML -> TunnelConfig, from which `heading` draws one from a seed.

A pair [low, high] is drawn uniformly from the seed; two equal numbers fix it. Stations count
along the axis from the axis point nearest the base origin, offsets outward from the design line.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ascrcp.core.config import Struct
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Profile, load_profile

Range = tuple[float, float]
Metre = Annotated[float, msgspec.Meta(ge=0.0, le=100.0)]
Step = Annotated[float, msgspec.Meta(ge=0.01, le=1.0)]
Count = Annotated[int, msgspec.Meta(ge=0, le=50)]


class Octave(Struct):
    """One scale of roughness.

    Attributes:
        wavelength: Distance between independent bumps [m].
        rms: Root mean square height [m].
        faceted: Straight between bumps, as broken rock is, instead of smooth.
    """

    wavelength: Annotated[float, msgspec.Meta(ge=0.02, le=50.0)]
    rms: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]
    faceted: bool = False


class PlacementConfig(Struct):
    """Where the tunnel lies around the machine.

    Attributes:
        yaw_deg: Axis direction to the left of base X [deg].
        grade_deg: Axis direction above base X [deg].
        left: Axis beside the base origin, left positive [m].
        height: Base origin above the axis [m].
    """

    yaw_deg: Range
    grade_deg: Range
    left: Range
    height: Range


class LengthConfig(Struct):
    """How far the tunnel is built.

    Attributes:
        rear: Station where the mesh begins, behind the machine [m].
        unsprayed_start: Station where the sprayed concrete ends [m].
        unsprayed_length: Length of the part to spray, to the face [m].
    """

    rear: float
    unsprayed_start: Range
    unsprayed_length: Range


class SprayedConfig(Struct):
    """The sprayed part: concrete that just covers the arches.

    Attributes:
        below_arch_line: Mean surface inside the arch line [m].
        roughness: Its octaves.
        edge_ragged: How far its end wanders along the axis, rms [m].
        edge_ramp: Length over which it thins out [m].
    """

    below_arch_line: float
    roughness: list[Octave]
    edge_ragged: Metre
    edge_ramp: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)]


class RockConfig(Struct):
    """The blasted rock.

    Attributes:
        offset: Mean offset from the design line [m].
        look_out: How much further out the holes end than they begin, over the round [m].
        margin: Outside the pockets rock stays this far inside the overbreak line [m].
        roughness: Its octaves.
        layer: Concrete sprayed on all of it so far [m].
    """

    offset: float
    look_out: float
    margin: Metre
    roughness: list[Octave]
    layer: Metre = 0.0


class ArchesConfig(Struct):
    """Steel arches of H section.

    Attributes:
        stations: Stations at the crown [m]; empty: drawn from the next three.
        count: How many.
        first: First one beyond the end of the sprayed part [m].
        spacing: Between two [m].
        width: Along the axis [m], thesis 3.3.3: 200 mm.
        depth: Inner to outer flange, in the section plane [m].
        flange: Thickness of flanges and web [m].
        lean_deg: Positive where the crown stands further into the heading than the feet [deg].
        radial_error: Deviation of the inner flange from the arch line, rms [m].
        aside: Middle of an arch beside the axis, to the left and upward alike [m].
    """

    stations: list[float]
    count: Count
    first: Range
    spacing: Range
    width: Annotated[float, msgspec.Meta(ge=0.05, le=1.0)]
    depth: Annotated[float, msgspec.Meta(ge=0.05, le=0.5)]
    flange: Annotated[float, msgspec.Meta(ge=0.002, le=0.1)]
    lean_deg: Range
    radial_error: Metre
    aside: Range = (0.0, 0.0)


class PatchConfig(Struct):
    """Patches of the rock: overbreak pockets, or bumps that reach the arch line.

    Attributes:
        count: How many; fewer if they find no room.
        half_length: Half extent along the axis [m].
        half_arc: Half extent round the tunnel [m].
        depth: Pockets: beyond the overbreak line; bumps: inside the arch line [m].
        angle_deg: Section angles between which centres lie [deg].
    """

    count: Count
    half_length: Range
    half_arc: Range
    depth: Range
    angle_deg: Range


class BoltsConfig(Struct):
    """Rock bolts: a square plate on the rock and a stub that stands out of it.

    Attributes:
        count: How many.
        plate: Edge of the plate [m].
        stand_off: Plate before the rock, for the rock is not flat [m].
        stub: Length of the stub before the plate [m].
        thickness: Of the stub [m].
    """

    count: Annotated[int, msgspec.Meta(ge=0, le=500)] = 0
    plate: Annotated[float, msgspec.Meta(gt=0.0, le=0.5)] = 0.2  # usual plates are 150..200 mm wide
    stand_off: Metre = 0.02  # placeholder
    stub: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.12  # placeholder
    thickness: Annotated[float, msgspec.Meta(gt=0.0, le=0.2)] = 0.025  # usual bolts are 22..28 mm thick


class NetConfig(Struct):
    """Wire mesh nailed to the rock: bars along the tunnel and round it.

    Attributes:
        present: Whether there is any.
        pitch: Distance between bars [m].
        bar: Thickness of a bar [m].
        stand_off: Mesh before the rock [m].
        bend: Length over which the mesh bridges hollows instead of following them, one sigma [m].
    """

    present: bool = False
    pitch: Annotated[float, msgspec.Meta(ge=0.05, le=1.0)] = 0.20  # usual: 200 x 200 mm
    bar: Annotated[float, msgspec.Meta(gt=0.0, le=0.05)] = 0.008  # usual: 6..8 mm
    stand_off: Metre = 0.03  # placeholder
    bend: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 0.15  # placeholder


class BodyConfig(Struct):
    """An upright body on the floor: a vehicle (box) or a person (cylinder of diameter `length`).

    Attributes:
        shape: "box" or "cylinder".
        station: Of its middle [m].
        left: Of its middle, left of the axis [m].
        length: Along the axis [m].
        width: Across [m].
        height: Above the floor [m].
    """

    shape: Literal["box", "cylinder"]
    station: Range
    left: Range
    length: Annotated[float, msgspec.Meta(gt=0.0, le=30.0)]
    width: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]
    height: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]


class FloorConfig(Struct):
    """The floor and the muck left at the face.

    Attributes:
        below_axis: Depth below the axis [m].
        muck_height: Height of the muck at the face [m].
        muck_length: How far it reaches back from the face [m].
        roughness: Octaves of the floor.
    """

    below_axis: Range
    muck_height: Metre
    muck_length: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)]
    roughness: list[Octave]


class FaceConfig(Struct):
    """The rock face that closes the tunnel; `present` false leaves it open."""

    present: bool
    roughness: list[Octave]


class AirConfig(Struct):
    """What floats and falls between lidar and wall.

    Attributes:
        dust_per_m: Chance that a beam is returned by dust, per metre of its way [1/m].
        drips: Number of places where water falls from the crown.
        drip_radius: Radius of a falling thread [m].
        drip_chance: Chance that a beam through a thread meets a drop.
        pool_depth: Level of standing water above the floor's mean, 0 for dry [m].
        pool_mirror: Chance that a beam comes back by way of the water's mirror; else it is lost.
    """

    dust_per_m: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    drips: Count
    drip_radius: Annotated[float, msgspec.Meta(gt=0.0, le=0.5)]
    drip_chance: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
    pool_depth: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    pool_mirror: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.3


class MeshConfig(Struct):
    """Resolution of the triangle mesh: fine in the unsprayed part, coarse behind [m]."""

    step: Step
    step_behind: Step


class TunnelConfig(Struct):
    """Everything about a heading: config/simulation/tunnel.yaml, any key can be overlaid.

    Attributes:
        profile: Name of a file in config/profiles, or a path to one.
    """

    profile: str
    placement: PlacementConfig
    length: LengthConfig
    sprayed: SprayedConfig
    rock: RockConfig
    arches: ArchesConfig
    pockets: PatchConfig
    bumps: PatchConfig
    floor: FloorConfig
    face: FaceConfig
    bodies: list[BodyConfig]
    air: AirConfig
    mesh: MeshConfig
    bolts: BoltsConfig = BoltsConfig()
    net: NetConfig = NetConfig()

    def __post_init__(self) -> None:
        # a ValueError here becomes a ConfigError that names the file
        for where, value in _ranges(self):
            if not value[0] <= value[1]:
                raise ValueError(f"tunnel {where}: [{value[0]:g}, {value[1]:g}] must rise")
        for where, limit in (("yaw_deg", 30.0), ("grade_deg", 20.0)):
            if not max(abs(v) for v in getattr(self.placement, where)) <= limit:
                raise ValueError(f"tunnel placement.{where}: allowed within +-{limit:g}")
        start, length = self.length.unsprayed_start, self.length.unsprayed_length
        if not self.length.rear < start[0] or not length[0] >= 0.5 or not length[1] <= 20.0:
            raise ValueError(
                "tunnel length: rear must lie before unsprayed_start, unsprayed_length in 0.5..20 m"
            )
        if not max(abs(self.length.rear), abs(start[0]), start[1] + length[1]) <= 100.0:
            raise ValueError("tunnel length: all stations within 100 m of the base")
        for name in ("pockets", "bumps"):
            patch = getattr(self, name)
            if not min(patch.half_length[0], patch.half_arc[0]) >= 0.05:
                raise ValueError(f"tunnel {name}: half_length and half_arc at least 0.05 m")

    def load_profile(self) -> Profile:
        """Read the design profile this tunnel is built around; its arches are as wide as those built."""
        named = CONFIG / "profiles" / f"{self.profile}.yaml"
        profile: Any = load_profile(named if named.is_file() else Path(self.profile))
        built: Profile = msgspec.structs.replace(profile, arch_width=self.arches.width)
        return built


def draw(rng: np.random.Generator, low_high: Range) -> float:
    """Draw one value of a range."""
    return float(rng.uniform(*low_high))


def _ranges(config: Struct, prefix: str = "") -> list[tuple[str, Range]]:
    found: list[tuple[str, Range]] = []
    for name in config.__struct_fields__:
        value = getattr(config, name)
        for i, item in enumerate(value if isinstance(value, list) else [value]):
            where = f"{prefix}{name}" + (f"[{i}]" if isinstance(value, list) else "")
            if isinstance(item, Struct):
                found += _ranges(item, f"{where}.")
            elif isinstance(item, tuple):
                found.append((where, item))
    return found
