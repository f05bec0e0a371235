"""The surface wanted: Surface -> Target, on an even grid of the unrolled wall, with what is left out."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter, map_coordinates, uniform_filter

from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.perception.profile_line import crown_height, curvature
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.wall import HEAP_M, Wall

ARCH_DEPTH_M = 0.15  # inner to outer flange: HW 150 class; placeholder
MARGIN_M = 0.5  # grid beyond the unsprayed part: what is sprayed past its ends is reckoned too
GRAIN_SHARE = 0.5  # one sigma of the window over a cell's rock, in cells: neither alias nor blur


class Left(IntEnum):
    """Why a cell is not to be sprayed, or cannot be."""

    NOT = 0
    OUTSIDE = 1
    UNSEEN = 2
    FLOOR = 3
    ARM = 4
    SHADOW = 5
    BEFORE = 6
    STEEP = 7
    EDGE = 8

    @property
    def code(self) -> str:
        """Name by which files and screens know the reason."""
        return self.name.lower()


LEFT_TEXT = {
    Left.UNSEEN.code: "not seen by the scan",
    Left.FLOOR.code: "the nozzle would be too near the floor",
    Left.ARM.code: "the arm does not reach it, or not without coming too near to something",
    Left.SHADOW.code: "in the shadow of an arch",
    Left.BEFORE.code: "muck or something else lies before the wall",
    Left.STEEP.code: "the flank of a pocket is too steep for the jet",
    Left.EDGE.code: "beyond the outermost passes",
}
"""What the reasons mean, by code, for a reader of English."""


@dataclass(frozen=True)
class ArchLid:
    """An arch as the spray meets it: middle station by column [m] (na,), half width, flanges' offsets [m]."""

    station: Array
    half: float
    inner: float
    outer: float


@dataclass(frozen=True)
class Target:
    """Present and wanted surface on a grid; offsets from the design line [m], outward positive.

    Attributes:
        profile: Design profile.
        station: Stations of the rows [m], even, shape (ns,).
        along: Arc lengths of the columns [m], even, shape (na,).
        rock: The wall, arches taken away, shape (ns, na).
        offset: What the spray meets: rock, or an arch's inner flange, shape (ns, na).
        wanted: The surface wanted, shape (ns, na).
        arch: Cells on an arch, shape (ns, na).
        left: `Left` of each cell, shape (ns, na).
        arches: The arches.
        area: Area of each cell at the wanted surface [m2], shape (ns, na).
        guessed: Share of each cell that no scan saw, filled from what is beside it, 0..1, shape (ns, na).
    """

    profile: Profile
    station: Array
    along: Array
    rock: Array
    offset: Array
    wanted: Array
    arch: NDArray[np.bool_]
    left: NDArray[np.uint8]
    arches: tuple[ArchLid, ...]
    area: Array
    guessed: Array

    @property
    def cell(self) -> tuple[float, float]:
        """Size of a cell along the axis and along the arc [m]."""
        return float(self.station[1] - self.station[0]), float(self.along[1] - self.along[0])

    @property
    def thickness(self) -> Array:
        """Concrete wanted [m], never negative, shape (ns, na)."""
        return np.asarray(np.maximum(self.offset - self.wanted, 0.0))

    def volume(self, layer: Array) -> Array:
        """Concrete in a layer [m] on the present surface [m3], shape (ns, na).

        A cell of a pocket is wider than one on the wanted surface.
        """
        ds, da = self.cell
        middle = self.offset - layer / 2.0
        return np.asarray(layer * ds * da * (1.0 + curvature(self.profile, self.along) * middle))

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Cells to be sprayed, shape (ns, na)."""
        return np.asarray(self.left == Left.NOT)

    @property
    def beneath(self) -> NDArray[np.bool_]:
        """Rock cells that reach beneath an arch's flange: no jet gets to all of them, shape (ns, na)."""
        near = np.zeros(self.arch.shape, dtype=bool)
        for lid in self.arches:
            near |= np.abs(self.station[:, None] - lid.station) < lid.half + self.cell[0] / 2.0
        return near & ~self.arch & binary_dilation(self.arch, np.ones((3, 1)))

    def sample(self, grid: Array, station: Array, along: Array) -> Array:
        """Read a grid at stations and arc lengths (n,), linearly between the cells' middles."""
        ds, da = self.cell
        place = [(station - self.station[0]) / ds, (along - self.along[0]) / da]
        return np.asarray(map_coordinates(grid, place, order=1, mode="nearest"), dtype=float)


def find_target(surface: Surface, wall: Wall, process: ProcessParameters, bridge: float) -> Target:
    """Lay the grid and decide the surface wanted.

    The wanted surface is the line of the process where the rock, averaged as the planner averages it,
    lies outside it by the least cover; elsewhere it is the least cover over the rock. On arches it is
    the least cover over the inner flange.

    Args:
        surface: Recognised heading.
        wall: The same, smooth and without holes.
        process: Line and covers.
        bridge: Wall further than this from anything seen is left out [m].
    """
    profile, p = surface.profile, process.target
    first, last = surface.unsprayed
    station = _even(first - MARGIN_M, last + MARGIN_M, process.dose.cell_m)
    along = _even(0.0, profile.length, process.dose.cell_m)
    S, A = (x.ravel() for x in np.meshgrid(station, along, indexing="ij"))
    shape = (len(station), len(along))
    step = (wall.station[1] - wall.station[0], wall.along[1] - wall.along[0])
    grain = GRAIN_SHARE * process.dose.cell_m
    fine = gaussian_filter(wall.raw, (grain / step[0], grain / step[1]), mode="nearest")
    rock = wall.sample(fine, S, A).reshape(shape)
    smooth = wall.sample(wall.offset, S, A).reshape(shape)
    arches = find_lids(surface, along)
    arch = np.zeros(shape, dtype=bool)
    offset = rock.copy()
    wanted = np.minimum(p.line_m, smooth - p.cover_rock_m)
    for lid, found in zip(arches, surface.arches, strict=True):
        phi = np.degrees(profile.angle(along))
        on = (np.abs(station[:, None] - lid.station) <= lid.half) & (smooth > lid.inner)
        on &= (phi >= found.span_deg[0]) & (phi <= found.span_deg[1])
        arch |= on
        offset = np.where(on, lid.inner, offset)
        wanted = np.where(on, lid.inner - p.cover_arch_m, wanted)
    left = np.full(shape, Left.NOT, dtype=np.uint8)
    left[(wall.sample(wall.unseen, S, A).reshape(shape) > bridge) & ~arch] = Left.UNSEEN
    before = binary_dilation(smooth < profile.arch_line - HEAP_M, iterations=2)
    left[before & ~arch] = Left.BEFORE
    left[(station < first) | (station > last)] = Left.OUTSIDE
    left[:, profile.point(along)[:, 1] < wall.floor_z] = Left.OUTSIDE  # the floor covers it
    area = (station[1] - station[0]) * (along[1] - along[0]) * (1.0 + curvature(profile, along) * wanted)
    guessed = np.where(arch, 0.0, _guessed(surface, S, A, process.dose.cell_m).reshape(shape))
    return Target(profile, station, along, rock, offset, wanted, arch, left, arches, area, guessed)


def _guessed(surface: Surface, station: Array, along: Array, cell: float) -> Array:
    """Share of cells of a size [m] that the scan did not see, about stations and arc lengths [m], (n,)."""
    step = (surface.station[1] - surface.station[0], surface.along[1] - surface.along[0])
    unseen = (surface.filled | ~np.isfinite(surface.offset)).astype(float)
    share = uniform_filter(unseen, [max(1, round(cell / s)) for s in step], mode="nearest")
    place = [(station - surface.station[0]) / step[0], (along - surface.along[0]) / step[1]]
    return np.asarray(map_coordinates(share, place, order=0, mode="nearest"))


def find_lids(surface: Surface, along: Array) -> tuple[ArchLid, ...]:
    """Describe the arches as the spray meets them."""
    height = surface.profile.point(along)[:, 1] - crown_height(surface.profile)
    inner = surface.profile.arch_line
    return tuple(
        ArchLid(
            a.station + np.tan(np.radians(a.lean_deg)) * height, a.width / 2.0, inner, inner + ARCH_DEPTH_M
        )
        for a in surface.arches
    )


def mean_finish(grid: Array, mask: NDArray[np.bool_], target: Target, patch: float) -> Array:
    """Average over patches of one surface, arches and rock each on their own; NaN where too little counts."""
    sides = (mean_patch(grid, mask & side, target.cell, patch) for side in (target.arch, ~target.arch))
    on, beside = sides
    return np.where(target.arch, on, beside)


def mean_patch(grid: Array, mask: NDArray[np.bool_], cell: tuple[float, float], patch: float) -> Array:
    """Average masked cells over a patch about every cell; NaN where less than half of it counts.

    Args:
        grid: Values, shape (ns, na).
        mask: Cells that count.
        cell: Size of a cell [m].
        patch: Edge of the patch [m].
    """
    size = tuple(max(1, round(patch / c)) for c in cell)
    weight = uniform_filter(mask.astype(float), size, mode="constant")
    total = uniform_filter(np.where(mask, grid, 0.0), size, mode="constant")
    return np.where(mask & (weight >= 0.5 - 1e-9), total / np.maximum(weight, 1e-9), np.nan)


def _even(first: float, last: float, step: float) -> Array:
    count = max(2, int(np.ceil((last - first) / step - 1e-9)))
    return np.asarray(first + (np.arange(count) + 0.5) * (last - first) / count)
