"""Order and tilt of the passes: overbreak first, then bay by bay: Surface -> Strip."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.flow import Overbreak, Surface
from ascrcp.core.geometry import Array
from ascrcp.planning.parameter import PlanningParameters

ANGLE_NODES = 1001  # of the table section angle -> arc length: 24 mm apart on the default profile
THIN_M = (
    0.05  # a strip of overbreak thinner than this inside a bay is left to the bay's own passes; placeholder
)


@dataclass(frozen=True)
class Strip:
    """One pass on the wall: where the cutting plane runs and between which arc lengths.

    Attributes:
        bay: Index of the bay.
        fraction: Place of the pass between the outermost passes of the bay, 0..1.
        along: First and last arc length [m], rising.
        falling: Sprayed from last to first: every second pass of an S.
        tilt_deg: Spray direction along the tunnel, theta2.
        overbreak: Whether it fills an overbreak region.
    """

    bay: int
    fraction: float
    along: tuple[float, float]
    falling: bool
    tilt_deg: float
    overbreak: bool


class Raster:
    """Lays passes over the bays and the overbreak regions of one heading."""

    def __init__(self, surface: Surface, parameters: PlanningParameters) -> None:
        self._surface = surface
        self._parameters = parameters
        self._along = np.linspace(0.0, surface.profile.length, ANGLE_NODES)
        self._angle = np.unwrap(surface.profile.angle(self._along))
        self._crown_z = float(surface.profile.point(self._along)[:, 1].max())

    def strips(self) -> list[Strip]:
        """Return all passes in spraying order (thesis 4.2 and 3.3.4: overbreak before the bays)."""
        strips: list[Strip] = []
        for region in sorted(self._surface.overbreak, key=lambda r: (r.station[0], r.angle_deg[0])):
            strips += self._region(region)
        grid = self._surface.along
        whole = (max(0.0, float(grid[0])), min(self._surface.profile.length, float(grid[-1])))
        for bay, ends in enumerate(self._surface.bays):
            strips += self._passes(bay, spread(*ends.station, self._parameters), whole, False)
        return strips

    def stations(self, strip: Strip, along: Array) -> Array:
        """Stations of a pass at arc lengths (n,) [m]: where arches lean, the passes lean with them.

        A positive lean has the arch's crown further into the heading than its feet.
        """
        ends = self._surface.bays[strip.bay]
        height = self._surface.profile.point(along)[:, 1] - self._crown_z
        first = ends.station[0] + self._lean(ends.arch_before) * height
        last = ends.station[1] + self._lean(ends.arch_after) * height
        inset = np.minimum(self._parameters.edge_distance_m, (last - first) / 2.0)
        return first + inset + strip.fraction * (last - first - 2.0 * inset)

    def arch_station(self, arch: int, along: Array) -> Array:
        """Stations of an arch's middle at arc lengths (n,) [m]."""
        height = self._surface.profile.point(along)[:, 1] - self._crown_z
        return self._surface.arches[arch].station + self._lean(arch) * height

    def _lean(self, arch: int | None) -> float:
        return 0.0 if arch is None else float(np.tan(np.radians(self._surface.arches[arch].lean_deg)))

    @property
    def seam(self) -> float | None:
        """Arc length at which passes are parted [m]; None if they are left whole."""
        if self._parameters.seam_deg is None:
            return None
        return float(np.interp(np.radians(self._parameters.seam_deg), self._angle, self._along))

    def _split(self, first: float, last: float) -> list[tuple[float, float]]:
        """Part an arc at the seam, right piece first: the nozzle's roll turns back once, not every pass."""
        p, seam = self._parameters, self.seam
        if seam is None or not first < seam < last:
            return [(first, last)]
        return [(first, seam), (min(seam + p.point_spacing_m, last), last)]

    def _passes(self, bay: int, stations: Array, along: tuple[float, float], overbreak: bool) -> list[Strip]:
        """Lay an S over one area; its part beyond the seam is an S of its own, sprayed afterwards."""
        outermost = spread(*self._surface.bays[bay].station, self._parameters)
        room = outermost[-1] - outermost[0]
        return [
            Strip(
                bay=bay,
                fraction=(station - outermost[0]) / room if room > 0.0 else 0.5,
                along=piece,
                falling=turn % 2 == 1,
                tilt_deg=self._tilt(bay, station),
                overbreak=overbreak,
            )
            for piece in self._split(*along)
            for turn, station in enumerate(stations.tolist())
        ]

    def _tilt(self, bay: int, station: float) -> float:
        """Choose theta2: oblique only beside an arch (thesis 4.2), square where both are equally near."""
        p, ends = self._parameters, self._surface.bays[bay]
        before = station - ends.station[0] if ends.arch_before is not None else np.inf
        after = ends.station[1] - station if ends.arch_after is not None else np.inf
        if not min(before, after) < p.spray_radius_m or abs(before - after) < 1e-6:
            return p.tilt_deg
        return p.tilt_inner_deg if before < after else p.tilt_outer_deg

    def _region(self, region: Overbreak) -> list[Strip]:
        """Lay passes over one overbreak region, bay by bay, for nothing is sprayed onto an arch."""
        p = self._parameters
        first_along, last_along = np.interp(np.radians(region.angle_deg), self._angle, self._along).tolist()
        strips: list[Strip] = []
        for bay, ends in enumerate(self._surface.bays):
            first, last = max(region.station[0], ends.station[0]), min(region.station[1], ends.station[1])
            if last - first >= THIN_M:
                inner = spread(*ends.station, p)
                stations = np.unique(np.clip(spread(first, last, p), inner[0], inner[-1]))
                strips += self._passes(bay, stations, (first_along, last_along), True)
        return strips


def spread(first: float, last: float, parameters: PlanningParameters) -> Array:
    """Place passes between two stations: evenly, at most one spray radius apart (thesis 4.2).

    Returns:
        Stations [m], the outermost one edge distance from the ends, one in the middle if narrow.
    """
    edge, radius = parameters.edge_distance_m, parameters.spray_radius_m
    room = last - first - 2.0 * edge
    if not room > 1e-6:
        return np.array([(first + last) / 2.0])
    count = int(np.ceil(room / radius - 1e-9)) + 1
    return np.linspace(first + edge, last - edge, count)
