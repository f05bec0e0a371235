"""Settings of the recognition chain, one struct per step: config/perception.yaml."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.paths import CONFIG

Length = Annotated[float, Meta(gt=0.0, le=100.0)]
Share = Annotated[float, Meta(gt=0.0, le=1.0)]
Degrees = Annotated[float, Meta(gt=0.0, le=30.0)]


class CropParameters(Struct):
    """Box around the base origin outside which points are dropped [m] (thesis eq. 3-2)."""

    behind: Length
    ahead: Length
    aside: Length


class VoxelParameters(Struct):
    """Voxel filter: edge [m] and the most points that may be left (thesis 3.3.1)."""

    size: Annotated[float, Meta(ge=0.005, le=0.2)]
    max_points: Annotated[int, Meta(ge=20_000, le=5_000_000)]


class GroundParameters(Struct):
    """Floor plane: largest tilt, height above it that is still floor [m], share that must agree."""

    max_tilt_deg: Degrees
    clearance: Length
    min_share: Share


class ClusterParameters(Struct):
    """Euclidean clusters: how near neighbours are [m], smallest tunnel [points]."""

    reach: Annotated[float, Meta(ge=0.05, le=2.0)]
    min_points: Annotated[int, Meta(ge=100, le=1_000_000)]


class AxisParameters(Struct):
    """Axis fit: cells [m], bounds of the first estimate, and what is refused as no tunnel."""

    max_yaw_deg: Annotated[float, Meta(gt=0.0, le=45.0)]
    cell_station: Length
    cell_along: Length
    min_share: Share
    max_taper: Annotated[float, Meta(gt=0.0, le=1.0)]
    iterations: Annotated[int, Meta(ge=4, le=100)]


class SectionParameters(Struct):
    """Slices and columns [m], the band that may be wall [m], sprayed part and face."""

    slice: Annotated[float, Meta(ge=0.01, le=0.2)]
    column: Annotated[float, Meta(ge=0.05, le=1.0)]
    inside: Length
    outside: Length
    sprayed_share: Share
    sprayed_length: Length
    face_share: Share


class ArchParameters(Struct):
    """Arch rule of thesis 3.3.3: slices in a row, arc in each [m], share of points, tolerances [m]."""

    slices: Annotated[int, Meta(ge=2, le=20)]
    arc: Length
    share: Share
    tolerance: Length
    inward: Length
    max_lean_deg: Degrees


class OverbreakParameters(Struct):
    """Overbreak rule of thesis 3.3.3: run along the arc [m], share, smallest region [m2] and depths [m]."""

    run: Length
    share: Share
    min_area: Annotated[float, Meta(ge=0.0, le=10.0)]
    min_depth: Annotated[float, Meta(ge=0.0, le=2.0)]
    min_mean_depth: Annotated[float, Meta(ge=0.0, le=2.0)]


class WallParameters(Struct):
    """Unrolled wall: cell edge, sprayed rows kept [m], gaps bridged [cells], shadows filled, steel [m]."""

    cell: Annotated[float, Meta(ge=0.02, le=0.5)]
    behind: Annotated[float, Meta(ge=0.0, le=50.0)]
    bridge: Annotated[int, Meta(ge=0, le=10)]
    fill: Length
    steel: Length


class PerceptionParameters(Struct):
    """All steps of the recognition chain."""

    crop: CropParameters
    voxel: VoxelParameters
    ground: GroundParameters
    cluster: ClusterParameters
    axis: AxisParameters
    section: SectionParameters
    arch: ArchParameters
    overbreak: OverbreakParameters
    wall: WallParameters


def load_parameters(path: Path | None = None) -> PerceptionParameters:
    """Read the chain's settings, config/perception.yaml by default.

    Raises:
        ConfigError: With the key and the rule it breaks.
    """
    return load(path or CONFIG / "perception.yaml", PerceptionParameters)
