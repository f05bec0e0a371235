"""The design profile of the tunnel section: arcs in the section plane and two offset lines.

Section plane: y left, z up, relative to the axis, looking along +s. Section angle phi: 0 at the
right spring line, 90 deg crown, 180 deg left, so y = -r cos(phi), z = r sin(phi).
"""

from pathlib import Path

import numpy as np

from ascrcp.core.config import Struct
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array

MIN_RADIUS, MAX_RADIUS = 0.25, 5000.0  # of an arc [m]; a straight wall is a very large arc
MIN_SIZE, MAX_SIZE = 1.5, 40.0  # width of a section [m]
MAX_OFFSET = 2.0  # of arch line and overbreak line from the design line [m]


class Arc(Struct):
    """One circular arc of the design line, walked with rising section angle.

    Attributes:
        centre: (y, z) of the arc's centre relative to the axis [m].
        radius: Radius [m].
        start_deg: Angle about the arc's own centre where it starts, counted like phi [deg].
        end_deg: Angle where it ends, larger than start_deg.
    """

    centre: tuple[float, float]
    radius: float
    start_deg: float
    end_deg: float


class Profile(Struct):
    """Design line (arcs, right to left over the crown) with the two lines of thesis fig. 3-14.

    Attributes:
        arch_line: Offset of the steel arches' inner flange from the design line [m], R1.
        overbreak_line: Offset beyond which rock counts as overbreak [m], R2. Outward positive.
        arch_width: Width of an arch along the axis [m], thesis 3.3.3: 200 mm.
        spray_depth: Length of the unsprayed part at the heading [m], thesis 3.3.1: about 3 m.
    """

    name: str
    arcs: list[Arc]
    arch_line: float = -0.22
    overbreak_line: float = 0.15
    arch_width: float = 0.20
    spray_depth: float = 3.0

    def __post_init__(self) -> None:
        where = f"profile {self.name}"
        if not self.arcs:
            raise ConfigError(f"{where}: arcs must hold at least one arc")
        for i, arc in enumerate(self.arcs):
            if not MIN_RADIUS <= arc.radius <= MAX_RADIUS:
                hint = "; is it in millimetres?" if arc.radius > MAX_RADIUS else ""
                raise ConfigError(
                    f"{where}: arc {i} radius {arc.radius:g} m, allowed {MIN_RADIUS:g}..{MAX_RADIUS:g}{hint}"
                )
            if not 0.0 < arc.end_deg - arc.start_deg <= 360.0:
                raise ConfigError(f"{where}: arc {i} must run 0..360 deg with rising angle")
        for i in range(len(self.arcs) - 1):
            gap = float(np.hypot(*(self._end(i, 1) - self._end(i + 1, 0))))
            if gap > 0.02:
                raise ConfigError(
                    f"{where}: arc {i + 1} starts {gap:.3f} m from the end of arc {i}, allowed 0.02"
                )
        if not self.arch_line < self.overbreak_line:
            raise ConfigError(
                f"{where}: arch_line {self.arch_line} must lie inside overbreak_line {self.overbreak_line}"
            )
        if not 0.05 <= self.arch_width <= 1.0 or not 0.5 <= self.spray_depth <= 20.0:
            raise ConfigError(f"{where}: arch_width 0.05..1 m, spray_depth 0.5..20 m")
        if not abs(self.arch_line) <= MAX_OFFSET or not abs(self.overbreak_line) <= MAX_OFFSET:
            raise ConfigError(
                f"{where}: arch_line and overbreak_line lie at most {MAX_OFFSET:g} m off the design line"
            )
        check_line(self.point(np.linspace(0.0, self.length, 240)), where)

    def _end(self, index: int, which: int) -> Array:
        arc = self.arcs[index]
        a = np.radians(arc.end_deg if which else arc.start_deg)
        return np.array([arc.centre[0] - arc.radius * np.cos(a), arc.centre[1] + arc.radius * np.sin(a)])

    @property
    def arc_starts(self) -> Array:
        """Arc length at which each arc begins, and the total at the end, shape (arcs + 1,) [m]."""
        lengths = [a.radius * np.radians(a.end_deg - a.start_deg) for a in self.arcs]
        return np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def length(self) -> float:
        """Arc length of the whole design line [m]."""
        return float(self.arc_starts[-1])

    def locate(self, yz: Array) -> tuple[Array, Array]:
        """Find where points lie along and off the design line.

        Args:
            yz: Points in the section plane [m], shape (n, 2).

        Returns:
            Arc length along the design line [m] (n,), clamped to its ends, and outward offset
            from it [m] (n,). The arc that is nearest in angle, then in offset, owns a point.
        """
        yz = np.asarray(yz, dtype=float)
        best = np.full(len(yz), np.inf)
        along = np.zeros(len(yz))
        offset = np.zeros(len(yz))
        for arc, start in zip(self.arcs, self.arc_starts[:-1], strict=True):
            d = yz - arc.centre
            r = np.hypot(d[:, 0], d[:, 1])
            mid = np.radians((arc.start_deg + arc.end_deg) / 2)
            half = np.radians((arc.end_deg - arc.start_deg) / 2)
            a = np.arctan2(d[:, 1], -d[:, 0]) - mid
            a = (a + np.pi) % (2 * np.pi) - np.pi
            outside = np.maximum(np.abs(a) - half, 0.0) * r
            off = r - arc.radius
            rank = 10.0 * outside + np.abs(off)
            won = rank < best
            best = np.where(won, rank, best)
            along = np.where(won, start + arc.radius * (np.clip(a, -half, half) + half), along)
            offset = np.where(won, off, offset)
        return along, offset

    def point(self, along: Array, offset: Array | float = 0.0) -> Array:
        """Return section points (..., 2) at arc lengths (...) and outward offsets (...) [m]."""
        along, offset = np.broadcast_arrays(np.asarray(along, float), np.asarray(offset, float))
        centre, radius, a = self._angle(along)
        r = radius + offset
        return np.stack([centre[..., 0] - r * np.cos(a), centre[..., 1] + r * np.sin(a)], axis=-1)

    def normal(self, along: Array) -> Array:
        """Return the outward unit normals (..., 2) of the design line at arc lengths (...) [m]."""
        _, _, a = self._angle(np.asarray(along, float))
        return np.stack([-np.cos(a), np.sin(a)], axis=-1)

    def angle(self, along: Array) -> Array:
        """Return the section angle phi [rad] of the design line's points at arc lengths (...) [m]."""
        p = self.point(along)
        return section_angle(p)

    def _angle(self, along: Array) -> tuple[Array, Array, Array]:
        starts = self.arc_starts
        i = np.clip(np.searchsorted(starts, along, side="right") - 1, 0, len(self.arcs) - 1)
        centre = np.array([a.centre for a in self.arcs])[i]
        radius = np.array([a.radius for a in self.arcs])[i]
        first = np.radians([a.start_deg for a in self.arcs])[i]
        return centre, radius, first + (along - starts[i]) / radius


def check_line(line: Array, where: str) -> None:
    """Refuse a line of points (n, 2) that is no tunnel's section: its size, or a line that crosses itself."""
    width, height = (float(v) for v in np.ptp(line, axis=0))
    if not (MIN_SIZE <= width <= MAX_SIZE and 0.2 * MIN_SIZE <= height <= MAX_SIZE):
        raise ConfigError(
            f"{where}: the design line is {width:.4g} m wide and {height:.4g} m high, "
            f"allowed {MIN_SIZE:g}..{MAX_SIZE:g} m"
        )
    a, b = line[:-1], line[1:]

    def side(p: Array, q: Array, r: Array) -> Array:
        """Sign of the turn p -> q -> r for every pair of pieces, shape (k, k)."""
        u, v = q - p, r[None, :] - p[:, None]
        return np.sign(u[:, None, 0] * v[..., 1] - u[:, None, 1] * v[..., 0])

    crossing = (side(a, b, a) * side(a, b, b) < 0) & (side(a, b, a).T * side(a, b, b).T < 0)
    apart = np.abs(np.arange(len(a))[:, None] - np.arange(len(a))) > 1
    at = np.argwhere(crossing & apart)
    if len(at):
        y, z = line[at[0, 0]]
        raise ConfigError(f"{where}: the design line crosses itself near ({y:.2f}, {z:.2f}) m")


def section_angle(yz: Array) -> Array:
    """Section angle phi of points (..., 2) [rad], in (-pi/2, 3 pi/2] so that the floor is the cut."""
    phi = np.arctan2(yz[..., 1], -yz[..., 0])
    return np.where(phi <= -np.pi / 2, phi + 2 * np.pi, phi)


def load_profile(path: Path) -> Profile:
    """Read a profile file by its suffix: YAML (design.md section 9), DXF or points.

    Raises:
        ConfigError: One line saying what is wrong with it.
    """
    from ascrcp.core.profile_file import read_profile  # which itself builds profiles

    return read_profile(path)
