"""Passes that cover the wall evenly, deep places in layers first: Surface + Target -> Lines."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import NothingToSprayError
from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.core.profile import section_angle
from ascrcp.planning.deposition import Jet
from ascrcp.planning.layer import count_layers, find_parts, smooth_wall, take_turns, wall_before
from ascrcp.planning.parameter import PlanningParameters, change
from ascrcp.planning.path import spray_angle, spray_direction, withdraw
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.raster import Raster, Strip, spread
from ascrcp.planning.target import Target
from ascrcp.planning.wall import Wall

FLOOR_SPARE_M = 1e-6  # a nozzle turned up to the lowest height must not fall below it by rounding
BESIDE_ARCH_M = 0.06  # from a flange to the nearest passes in deep places, half the jet past it; placeholder
TWIN_DEG = 2.0  # of theta2: passes over one line aimed less apart lay the same; placeholder
LEAST_PASS_M = 0.30  # a shorter pass of a further layer is left to the last layer; one patch


@dataclass(frozen=True)
class Lines:
    """Points of all passes in spraying order, tunnel frame, n points.

    Attributes:
        nozzle: (s, y, z) [m], shape (n, 3).
        wall: The points aimed at, shape (n, 3).
        along: Their arc length [m], shape (n,).
        theta2, theta3: Spray direction [rad], shape (n,).
        bay: Index of the bay, shape (n,).
        pass_index: Number of the pass, shape (n,).
        layer: Layer, counted down to 1, the last, shape (n,).
        overbreak: Whether the pass fills a deep place, shape (n,).
    """

    nozzle: Array
    wall: Array
    along: Array
    theta2: Array
    theta3: Array
    bay: NDArray[np.int64]
    pass_index: NDArray[np.int64]
    layer: NDArray[np.int64]
    overbreak: NDArray[np.bool_]

    @property
    def jet(self) -> Jet:
        """Nozzles and directions."""
        s2 = np.sin(self.theta2)
        direction = np.column_stack([np.cos(self.theta2), s2 * np.cos(self.theta3), s2 * np.sin(self.theta3)])
        return Jet(self.nozzle, direction)

    def to_path(self, surface: Surface, speed: Array, flow: Array) -> SprayPath:
        """Carry the nozzles into the base frame."""
        T = surface.axis.T_base_tunnel
        return SprayPath(
            position=apply_transform(T, self.nozzle),
            theta2=self.theta2,
            theta3=self.theta3,
            station=self.wall[:, 0],
            angle=section_angle(self.wall[:, 1:]),
            bay=self.bay,
            pass_index=self.pass_index,
            overbreak=self.overbreak,
            R_base_tunnel=T[:3, :3],
            speed=speed,
            flow=flow,
        )


@dataclass(frozen=True)
class _Pass:
    """One pass: its line in the bay (or the arch it runs on), its layer, where it begins and ends, its aim.

    With `flank` theta2 is square to the wall's slope along the axis, as far as the tilts beside arches go.
    """

    strip: Strip
    layer: int
    arch: int | None = None
    beyond_seam: bool = False
    flank: bool = False


class Coverage:
    """Lays the passes of one heading."""

    def __init__(
        self,
        surface: Surface,
        target: Target,
        wall: Wall,
        parameters: PlanningParameters,
        process: ProcessParameters,
        where: NDArray[np.bool_] | None = None,
    ) -> None:
        dose = process.dose
        self._surface, self._target, self._wall, self._process = surface, target, wall, process
        self._parameters = change(
            parameters,
            spray_radius_m=dose.pass_spacing_m,
            edge_distance_m=min(dose.edge_m, dose.pass_spacing_m),
            point_spacing_m=dose.point_spacing_m,
        )
        self._raster = Raster(surface, self._parameters)
        self._again = where is not None
        self._where = target.inside if where is None else where & target.inside
        self.layers = count_layers(target, process)
        self._walls: dict[int, Wall] = {}

    def lines(self, progress: Callable[[float], None] | None = None) -> Lines:
        """Lay all passes: further layers first, then the last one bay by bay, each arch after its bay.

        Raises:
            NothingToSprayError: Not one point can be sprayed.
        """
        bays = range(len(self._surface.bays))
        turns = take_turns([part for bay in bays for part in self._deep(bay)])
        passes = [one for layer in turns for one in layer]
        for bay in bays:
            passes += self._last(bay)
        found = []
        for number, one in enumerate(passes):
            if progress is not None:
                progress(number / len(passes))
            points = self._lay(one)
            if points is not None:
                found.append((one, points))
        if not found:
            raise NothingToSprayError(
                "no point of the wall can be sprayed: all are unseen, within tolerance already, or nearer "
                f"the floor than floor_clearance_m {self._parameters.floor_clearance_m} m"
            )
        return _join(found)

    def _fractions(self, bay: int) -> Array:
        """Places of the passes between the outermost ones of a bay, 0..1."""
        stations = spread(*self._surface.bays[bay].station, self._parameters)
        room = stations[-1] - stations[0]
        return (stations - stations[0]) / room if room > 0.0 else np.array([0.5])

    def _beside_arches(self, bay: int) -> Array:
        """Places of passes close beside the arches that end a bay, outside 0..1; none in a narrow bay."""
        ends, edge = self._surface.bays[bay], self._parameters.edge_distance_m
        room = ends.station[1] - ends.station[0] - 2.0 * edge
        if room < self._process.dose.pass_spacing_m:
            return np.zeros(0)
        beyond = (edge - min(BESIDE_ARCH_M, edge)) / room
        before, after = ends.arch_before is not None, ends.arch_after is not None
        return np.array([-beyond] * before + [1.0 + beyond] * after)

    def _deep(self, bay: int) -> list[list[list[_Pass]]]:
        """Lay the further layers of a bay: of each deep part its layers, deepest first (thesis 3.3.4)."""
        inside = self._bay_cells(bay) & self._where
        found: list[list[list[_Pass]]] = []
        for part in find_parts(inside & (self.layers >= 2), self._target.cell):
            layers: list[list[_Pass]] = []
            for layer in range(int(self.layers[part & inside].max(initial=1)), 1, -1):
                here = [
                    p & part for p in find_parts(part & inside & (self.layers >= layer), self._target.cell)
                ]
                layers.append([p for piece in here for p in self._cover(bay, piece, layer)])
            found.append(layers)
        return found

    def _last(self, bay: int) -> list[_Pass]:
        """Lay the last layer of a bay, then the arch that ends it."""
        inside = self._bay_cells(bay) & self._where
        passes = self._cover(bay, inside, 1)
        arch = self._surface.bays[bay].arch_after
        return passes if arch is None else passes + self._on_arch(bay, arch)

    def _on_arch(self, bay: int, arch: int) -> list[_Pass]:
        """Lay the pass along an arch's inner flange, if it is to be covered."""
        lid = self._target.arches[arch]
        mine = np.abs(self._target.station[:, None] - lid.station) <= lid.half
        columns = np.flatnonzero((self._target.arch & self._where & mine).any(axis=0))
        if not len(columns) or not self._process.target.cover_arch_m > 0.0:
            return []
        first, last = self._target.along[[columns[0], columns[-1]]].tolist()
        square = self._parameters.tilt_deg
        return [
            _Pass(Strip(bay, 1.0, piece, False, square, False), 1, arch, self._is_beyond(piece))
            for piece in self._pieces(first, last)
        ]

    def _cover(self, bay: int, mask: NDArray[np.bool_], layer: int) -> list[_Pass]:
        """Lay an S over the cells of a mask; what lies beyond the seam is an S of its own.

        The layers of a deep place are aimed as the bay is and at its flanks in turn, every second one midway
        between the lines of the others: from the near stand-off of such places one layer's passes leave
        ridges, a sixth of the layer high, that would add up to centimetres; nearest to arches these reach
        the foot of a pocket's wall past the flange. A second spraying is laid twice as densely, square, as
        the bay and at the flanks, for the doses to choose from: what is still thin is mostly where the first
        could not aim.
        """
        target = self._target
        fractions = self._fractions(bay)
        midway = np.concatenate([(fractions[1:] + fractions[:-1]) / 2.0, self._beside_arches(bay)])
        if self._again:
            fractions = np.sort(np.concatenate([fractions, midway]))
        elif layer > 1 and layer % 2 == 0 and len(midway):
            fractions = np.sort(midway)
        sides: tuple[list[_Pass], list[_Pass]] = ([], [])
        for fraction in fractions.tolist():
            strip = Strip(bay, fraction, (0.0, 0.0), False, self._tilt(bay, fraction), layer > 1)
            rows = np.rint((self._raster.stations(strip, target.along) - target.station[0]) / target.cell[0])
            rows = np.clip(rows, 0, len(target.station) - 1).astype(np.int64)
            on = mask[rows, np.arange(len(target.along))]
            for piece in [p for run in self._runs(on) for p in self._pieces(*run)]:
                beyond = self._is_beyond(piece)
                side = sides[beyond]
                for tilt, flank in self._aims(strip.tilt_deg, layer):
                    aimed = replace(strip, along=piece, falling=len(side) % 2 == 1, tilt_deg=tilt)
                    side.append(_Pass(aimed, layer, None, beyond, flank))
        return [*sides[0], *sides[1]]

    def _aims(self, tilt: float, layer: int) -> list[tuple[float, bool]]:
        """How the passes over one line are aimed: theta2 of the bay [deg], whether at the flank instead."""
        if tilt == self._process.dose.face_tilt_deg:  # nearer the face there is no room to aim
            return [(tilt, False)]
        square = self._parameters.tilt_deg
        if not self._again:  # beside an arch a flank is aimed at past the arch, which is in the way
            return [(tilt, layer % 2 == 0 and tilt == square)]
        return [(tilt, True), *((other, False) for other in sorted({tilt, square}))]

    def _runs(self, on: NDArray[np.bool_]) -> list[tuple[float, float]]:
        """First and last arc length of the runs of cells; gaps shorter than a patch are sprayed through."""
        columns = np.flatnonzero(on)
        if not len(columns):
            return []
        gap = self._process.target.patch_m / self._target.cell[1]
        runs = np.split(columns, np.flatnonzero(np.diff(columns) > gap) + 1)
        ends = [(float(self._target.along[r[0]]), float(self._target.along[r[-1]])) for r in runs]
        if self._again:  # no later layer fills what is short
            ends = [self._lengthen(*run) for run in ends]
        return [(a, b) for a, b in ends if b - a >= LEAST_PASS_M - 1e-9]

    def _lengthen(self, first: float, last: float) -> tuple[float, float]:
        """Make a run of cells long enough for a pass, within the design line."""
        more = max(0.0, LEAST_PASS_M - (last - first)) / 2.0
        length = self._surface.profile.length
        first = min(max(first - more, 0.0), length - LEAST_PASS_M)
        return first, min(max(last + more, first + LEAST_PASS_M), length)

    def _pieces(self, first: float, last: float) -> list[tuple[float, float]]:
        seam = self._raster.seam
        if seam is None or not first + LEAST_PASS_M / 2 < seam < last - LEAST_PASS_M / 2:
            return [(first, last)]
        return [(first, seam), (seam, last)]

    def _is_beyond(self, piece: tuple[float, float]) -> bool:
        seam = self._raster.seam
        return seam is not None and (piece[0] + piece[1]) / 2.0 > seam

    def _tilt(self, bay: int, fraction: float) -> float:
        """Choose theta2: oblique beside an arch and before the face, else square."""
        ends, p = self._surface.bays[bay], self._parameters
        length = ends.station[1] - ends.station[0]
        place = p.edge_distance_m + fraction * (length - 2.0 * p.edge_distance_m)
        before, after = place, length - place
        near = self._process.dose.pass_spacing_m
        if ends.arch_after is None and after < near and after < before:
            return self._process.dose.face_tilt_deg
        if ends.arch_before is not None and before < near and before < after:
            return p.tilt_inner_deg
        if ends.arch_after is not None and after < near and after < before:
            return p.tilt_outer_deg
        return p.tilt_deg

    def _bay_cells(self, bay: int) -> NDArray[np.bool_]:
        """Cells between the middles of the arches that end a bay."""
        ends, target = self._surface.bays[bay], self._target
        first, last = (
            np.full(len(target.along), end) if arch is None else target.arches[arch].station
            for end, arch in zip(ends.station, (ends.arch_before, ends.arch_after), strict=True)
        )
        row = target.station[:, None]
        return np.asarray((row >= first) & (row < last) & ~target.arch)

    def _wall_at(self, layer: int) -> Wall:
        if layer not in self._walls:
            offset = wall_before(self._target, self.layers, layer)
            self._walls[layer] = smooth_wall(self._target, offset, self._wall, self._parameters)
        return self._walls[layer]

    def _lay(self, one: _Pass) -> tuple[Array, Array, Array, Array, Array] | None:
        """Thin, cut, normal, offset, leave out: nozzle, wall point, arc length, theta2, theta3 of a pass."""
        p, wall = self._parameters, self._wall_at(one.layer)
        fine = np.linspace(*one.strip.along, max(2, int(np.ceil(np.ptp(one.strip.along) / 0.05)) + 1))
        place = wall.point(self._stations(one, fine), fine)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
        count = max(2, int(np.ceil(length[-1] / p.point_spacing_m - 1e-9)) + 1)
        along = np.interp(np.linspace(0.0, length[-1], count), length, fine)
        along = along[::-1] if one.strip.falling else along
        station = self._stations(one, along)
        point = wall.point(station, along)
        if one.arch is not None:
            lid = self._target.arches[one.arch]
            point = np.column_stack([station, self._surface.profile.point(along, lid.inner)])
        limit = 0.0 if one.arch is not None else np.radians(p.normal_limit_deg)
        theta2 = self._theta2(one, station, along)
        if self._again and one.flank and np.abs(theta2 - np.radians(p.tilt_deg)).max() < np.radians(TWIN_DEG):
            return None  # the square pass over the same line does
        theta3 = self._keep_side(spray_angle(wall.normal(station, along, limit)), one.beyond_seam)
        theta3, stand_off = self._keep_off_floor(point, theta2, theta3, self._stand_off(one))
        direction = spray_direction(theta2, theta3)
        nozzle = point - stand_off[:, None] * direction
        nozzle = withdraw(nozzle, direction, self._surface, self._raster, p.arch_clearance_m)
        keep = wall.sample(wall.unseen, station, along) <= p.bridge_m
        keep &= (nozzle[:, 2] >= wall.floor_z + p.floor_clearance_m) & (point[:, 2] >= wall.floor_z)
        if keep.sum() < 2:
            return None
        return nozzle[keep], point[keep], along[keep], theta2[keep], theta3[keep]

    def _theta2(self, one: _Pass, station: Array, along: Array) -> Array:
        """Tilt of a pass along the tunnel [rad], shape (n,)."""
        if not one.flank:
            return np.full(len(along), np.radians(one.strip.tilt_deg))
        p, wall = self._parameters, self._wall_at(one.layer)
        square = np.pi / 2.0 + np.arctan(wall.sample(wall.slope_along_axis, station, along))
        return np.clip(square, np.radians(p.tilt_outer_deg), np.radians(p.tilt_inner_deg))

    def _keep_off_floor(
        self, point: Array, theta2: Array, theta3: Array, stand_off: float
    ) -> tuple[Array, Array]:
        """Point the jet down where its nozzle would be too near the floor, as far as the process allows.

        Returns:
            theta3 [rad] and the stand-off [m]: the full one where a nearer nozzle would have to stand too
            low, both (n,).
        """
        full = self._parameters.stand_off_m
        near, fits = self._turn_down(point, theta2, theta3, stand_off)
        far, _ = self._turn_down(point, theta2, theta3, full)
        return np.where(fits, near, far), np.where(fits, stand_off, full)

    def _turn_down(
        self, point: Array, theta2: Array, theta3: Array, stand_off: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Turn jets down for one stand-off [m]; tell which nozzles keep off the floor then, both (n,)."""
        p = self._parameters
        room = point[:, 2] - self._wall.floor_z - p.floor_clearance_m - FLOOR_SPARE_M
        steepest = room / (stand_off * np.sin(theta2))
        down = np.arcsin(np.clip(steepest, -1.0, 1.0))
        turned = np.where(np.cos(theta3) < 0.0, np.pi - down, down)
        low = np.sin(theta3) > steepest
        can = np.abs(turned - theta3) <= np.radians(p.floor_tilt_deg)
        return np.where(low & can, turned, theta3), ~low | can

    def _stand_off(self, one: _Pass) -> float:
        """Nozzle to wall [m]: nearer, with a narrower jet, where a small place is filled or sprayed again."""
        if one.layer > 1 or self._again:
            return min(self._parameters.stand_off_m, self._process.dose.near_stand_off_m)
        return self._parameters.stand_off_m

    def _keep_side(self, theta3: Array, beyond: bool) -> Array:
        """Hold directions on their side of the seam, where the nozzle's roll has its stop."""
        if self._parameters.seam_deg is None:
            return theta3
        stop = np.pi - np.radians(self._parameters.seam_deg)
        return np.minimum(theta3, stop) if beyond else np.maximum(theta3, stop)

    def _stations(self, one: _Pass, along: Array) -> Array:
        if one.arch is not None:
            return self._raster.arch_station(one.arch, along)
        return self._raster.stations(one.strip, along)


def _join(found: list[tuple[_Pass, tuple[Array, Array, Array, Array, Array]]]) -> Lines:
    sizes = [len(points[2]) for _, points in found]
    nozzle, wall, along, theta2, theta3 = (
        np.concatenate([points[k] for _, points in found]) for k in range(5)
    )

    def spread_out(values: list[float]) -> Array:
        return np.repeat(np.array(values), sizes)

    return Lines(
        nozzle=nozzle,
        wall=wall,
        along=along,
        theta2=theta2,
        theta3=theta3,
        bay=spread_out([one.strip.bay for one, _ in found]).astype(np.int64),
        pass_index=np.repeat(np.arange(len(found)), sizes),
        layer=spread_out([one.layer for one, _ in found]).astype(np.int64),
        overbreak=spread_out([one.strip.overbreak for one, _ in found]).astype(bool),
    )
