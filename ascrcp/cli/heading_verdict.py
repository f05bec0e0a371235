"""Compare what was recognised with the truth of a simulated heading."""

from dataclasses import dataclass, field

import numpy as np

from ascrcp.core.flow import Arch, Overbreak, Surface
from ascrcp.core.geometry import angle_between
from ascrcp.core.profile import Profile
from ascrcp.perception.features import shadow_volume
from ascrcp.perception.profile_line import crown_height
from ascrcp.simulation.tunnel_wall import Patch
from ascrcp.simulation.variety import Sample, pocket_of

NEAR = 0.10
"""An arch found within half its width of a true one is that one [m]."""

LEAST_AREA = 0.2
LEAST_DEPTH = 0.10
"""Pockets of at least this size [m2, m] must be found; regions of this size must be pockets."""


@dataclass(frozen=True)
class Pocket:
    """A true pocket in sight: how large it looks, and what was found of it."""

    patch: Patch
    area: float
    volume: float
    found: float


@dataclass(frozen=True)
class Verdict:
    """What was right and wrong about one heading; errors are found minus true.

    Attributes:
        axis_deg: Angle between the axes [deg].
        axis_mm: Distance of the axes in the middle of the unsprayed part [mm].
        bare: Whether recognition says that no sprayed surface bears its axis.
        sigma_deg: One standard deviation of the axis' direction that recognition tells [deg].
        floor_deg: Where it is bare, what no method can do better than, one standard deviation [deg].
        station_mm: Of each arch found, where its plane meets the axis, as in features.json [mm].
        crown_mm: Likewise at the crown [mm].
        lean_deg: Likewise [deg].
        missed_arches: Stations [m].
        false_arches: Stations [m].
        missed_pockets: Areas in sight [m2].
        false_regions: Regions of at least the least size where no pocket is.
        split: Pockets found as more than one region.
        pockets: Those that must be found.
        volume: Overbreak found [m3].
        volume_true: Overbreak in the lidar's sight [m3].
        shadow: Overbreak estimated out of sight [m3].
        shadow_true: Overbreak out of sight [m3].
        ends_mm: Largest error of the ends of the unsprayed part [mm].
    """

    axis_deg: float
    axis_mm: float
    bare: bool
    sigma_deg: float = 0.0
    floor_deg: float = 0.0
    station_mm: list[float] = field(default_factory=list)
    crown_mm: list[float] = field(default_factory=list)
    lean_deg: list[float] = field(default_factory=list)
    missed_arches: list[float] = field(default_factory=list)
    false_arches: list[float] = field(default_factory=list)
    missed_pockets: list[float] = field(default_factory=list)
    false_regions: list[Overbreak] = field(default_factory=list)
    split: int = 0
    pockets: list[Pocket] = field(default_factory=list)
    volume: float = 0.0
    volume_true: float = 0.0
    shadow: float = 0.0
    shadow_true: float = 0.0
    ends_mm: float = 0.0


def judge(surface: Surface, sample: Sample) -> Verdict:
    """Match arches by station and pockets by where they lie."""
    truth = sample.heading.truth
    middle = truth.axis.point + truth.axis.direction * np.mean(truth.unsprayed) - surface.axis.point
    aside = middle - surface.axis.direction * (middle @ surface.axis.direction)
    whole = sample.kind.see != "sprayed"
    matched, missed, false = _match(list(surface.arches), list(truth.arches) if whole else [])
    owner = pocket_of(sample.heading)
    pockets, lost, split = [], [], 0
    hit: set[int] = set()
    for number, patch in enumerate(truth.pockets if whole else ()):
        mine = (owner == number) & sample.visible
        area, volume = (
            float(sample.heading.beyond_area[mine].sum()),
            float(sample.heading.beyond_volume[mine].sum()),
        )
        over = [i for i, region in enumerate(surface.overbreak) if _overlaps(region, patch, surface)]
        hit |= set(over)
        split += len(over) > 1
        if area < LEAST_AREA or patch.depth < LEAST_DEPTH:
            continue
        if not over:
            lost.append(area)
        pockets.append(Pocket(patch, area, volume, sum(surface.overbreak[i].volume_m3 for i in over)))
    return Verdict(
        axis_deg=float(np.degrees(angle_between(truth.axis.direction, surface.axis.direction))),
        axis_mm=1000.0 * float(np.linalg.norm(aside)),
        bare="sprayed" not in surface.axis.evidence,
        sigma_deg=surface.axis.direction_sigma_deg,
        station_mm=[1000.0 * (on_axis(a, truth.profile) - on_axis(b, truth.profile)) for a, b in matched],
        crown_mm=[1000.0 * (a.station - b.station) for a, b in matched],
        lean_deg=[a.lean_deg - b.lean_deg for a, b in matched],
        missed_arches=missed,
        false_arches=false,
        missed_pockets=lost,
        false_regions=[
            region
            for i, region in enumerate(surface.overbreak)
            if i not in hit and region.area_m2 >= LEAST_AREA and region.max_depth_m >= LEAST_DEPTH
        ],
        split=split,
        pockets=pockets,
        volume=sum(region.volume_m3 for region in surface.overbreak),
        volume_true=float(sample.heading.beyond_volume[sample.visible].sum()) if whole else 0.0,
        shadow=shadow_volume(surface),
        shadow_true=float(sample.heading.beyond_volume[~sample.visible].sum()) if whole else 0.0,
        ends_mm=_ends(surface, sample),
    )


def on_axis(arch: Arch, profile: Profile) -> float:
    """Station at which the plane of an arch meets the axis [m]."""
    return arch.station - float(np.tan(np.radians(arch.lean_deg))) * crown_height(profile)


def _match(found: list[Arch], true: list[Arch]) -> tuple[list[tuple[Arch, Arch]], list[float], list[float]]:
    """Pairs (found, true), stations missed, stations found where no arch is."""
    pairs, missed = [], []
    for arch in true:
        near = min(found, key=lambda a: abs(a.station - arch.station), default=None)
        if near is None or not abs(near.station - arch.station) <= NEAR:
            missed.append(arch.station)
            continue
        found.remove(near)
        pairs.append((near, arch))
    return pairs, missed, [arch.station for arch in found]


def _overlaps(region: Overbreak, patch: Patch, surface: Surface) -> bool:
    reach = np.array([patch.along - patch.half_arc, patch.along + patch.half_arc])
    low, high = np.degrees(surface.profile.angle(reach))
    (first, last), (right, left) = region.station, region.angle_deg
    beside = first < patch.station + patch.half_length and last > patch.station - patch.half_length
    return bool(beside and right < high and left > low)


def _ends(surface: Surface, sample: Sample) -> float:
    first, last = sample.heading.truth.unsprayed
    wanted = {
        "all": ((0, first), (1, last)),
        "unsprayed": ((1, last),),
        "sprayed": (),
    }[sample.kind.see]
    return 1000.0 * max((abs(surface.unsprayed[i] - value) for i, value in wanted), default=0.0)
