"""Synthetic headings with exact truth, ray-marched as a lidar at the arm's end would see them.

Independent of ascrcp.simulation on purpose: what finds the tunnel must not share the code that makes it.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from ascrcp.core.geometry import Array, rotation
from ascrcp.core.profile import Arc, Profile

CIRCLE = Profile(name="circle-5.9", arcs=[Arc(centre=(0, 0), radius=5.9, start_deg=-28, end_deg=208)])


def circle(radius: float) -> Profile:
    """A circular profile of another radius."""
    return Profile(
        name=f"circle-{radius}", arcs=[Arc(centre=(0, 0), radius=radius, start_deg=-25, end_deg=205)]
    )


def three_centre() -> Profile:
    """Crown of 5.0 m, haunches of 6.6 m, tangent to each other at 50 degrees off the crown."""
    crown, side, joint = 5.0, 6.6, np.radians(40.0)
    dy, dz = (side - crown) * np.cos(joint), -(side - crown) * np.sin(joint)
    right, left = (float(dy), float(dz)), (float(-dy), float(dz))
    return Profile(
        name="three-centre",
        arcs=[
            Arc(centre=right, radius=side, start_deg=-12, end_deg=40),
            Arc(centre=(0, 0), radius=crown, start_deg=40, end_deg=140),
            Arc(centre=left, radius=side, start_deg=140, end_deg=192),
        ],
    )


@dataclass
class Truth:
    """What the heading really is: stations from the axis point nearest the base origin."""

    point: Array
    direction: Array
    unsprayed: tuple[float, float]
    arches: list[tuple[float, float]] = field(default_factory=list)  # station on the axis, lean [deg]
    pockets: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    pocket_seen: list[float] = field(default_factory=list)  # area of each pocket that points fell on [m2]
    volume_seen: float = 0.0  # beyond the overbreak line, in 5 cm cells that a point fell on


@dataclass
class Recipe:
    """Everything that may vary; the defaults are an easy heading."""

    seed: int = 0
    profile: Profile = field(default_factory=lambda: CIRCLE)
    arches: int = 2
    pockets: int = 3
    yaw_deg: float = 2.0
    grade_percent: float = -1.5
    axis_y: float = 0.0
    axis_z: float = -1.85
    floor: float = -2.0  # section height of the floor
    lean_deg: float = 0.0  # largest lean of an arch
    rough: float = 0.05
    sprayed: float = 14.0  # length of the sprayed part behind the heading; nothing is seen behind it
    face: bool = True
    boxes: bool = True
    rays: int = 350_000
    start: float = 10.2
    arch_shift: float = 0.0  # arches not concentric by so much
    dust: float = 0.002


class Heading:
    """Surface functions of one recipe and the rays that meet them."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self.rng = np.random.default_rng(recipe.seed)
        self.profile = recipe.profile
        self._pose()
        s0 = recipe.start
        self.s0, self.s1 = s0, s0 + recipe.profile.spray_depth
        self.arches = self._arches()
        self.pockets = self._pockets()
        size = (int(26 / 0.1), int(self.profile.length / 0.1) + 2)
        self.volume_seen, self.pocket_seen = 0.0, [0.0] * len(self.pockets)
        self._rock = recipe.rough * self._field(size, 3.5) + 0.3 * recipe.rough * self._field(size, 1.0)
        self._sprayed = 0.01 * self._field(size, 5.0)
        bump_s, bump_a = (
            self.rng.uniform(s0 + 0.4, self.s1 - 0.4),
            self.rng.uniform(0.2, 0.8) * self.profile.length,
        )
        self.bump = (bump_s, bump_a)

    def _field(self, size: tuple[int, int], sigma: float) -> Array:
        f = gaussian_filter(self.rng.standard_normal(size), sigma)
        return f / f.std()

    def _pose(self) -> None:
        r = self.recipe
        self.R = rotation("z", np.radians(r.yaw_deg)) @ rotation("y", -np.arctan(r.grade_percent / 100))
        d = self.R[:, 0]
        p = np.array([0.0, r.axis_y, r.axis_z])
        self.point = p - d * (p @ d)
        self.direction = d

    def _arches(self) -> list[tuple[float, float, float, float]]:
        r = self.recipe
        if not r.arches:
            return []
        pitch = (self.s1 - self.s0) / (r.arches + 0.3)
        found = []
        for i in range(r.arches):
            station = self.s0 + pitch * (i + 0.75) + self.rng.uniform(-0.08, 0.08) * pitch
            lean = self.rng.uniform(-r.lean_deg, r.lean_deg)
            dy, dz = self.rng.uniform(-r.arch_shift, r.arch_shift, 2)
            found.append((station, lean, dy, dz))
        return found

    def _pockets(self) -> list[tuple[float, float, float, float, float]]:
        pockets: list[tuple[float, float, float, float, float]] = []
        for _ in range(400):
            if len(pockets) == self.recipe.pockets:
                break
            half_s, half_a = self.rng.uniform(0.3, 0.45), self.rng.uniform(0.5, 0.85)
            s = self.rng.uniform(self.s0 + 0.1, self.s1 - 0.2)
            a = self.rng.uniform(2.5, self.profile.length - 2.5)
            if all(abs(s - p[0]) > 1.2 or abs(a - p[1]) > 2.2 for p in pockets):
                pockets.append((s, a, half_s, half_a, self.rng.uniform(0.2, 0.45)))
        return pockets

    def wall(self, s: Array, along: Array) -> Array:
        """Offset of the wall without arches at stations and arc lengths (n,) [m]."""
        at = [(s + 8.0) / 0.1, along / 0.1]
        rock = map_coordinates(self._rock, at, order=1, mode="nearest")
        for ps, pa, hs, ha, depth in self.pockets:
            q = 1.0 - ((s - ps) / hs) ** 2 - ((along - pa) / ha) ** 2
            rock = np.where(q > 0, np.maximum(rock, 0.15 + depth * np.sqrt(np.maximum(q, 0))), rock)
        bs, ba = self.bump
        line = self.profile.arch_line
        rock += (line - 0.01 - rock) * np.exp(-((((s - bs) / 0.15) ** 2 + ((along - ba) / 0.45) ** 2) ** 2))
        skin = line - 0.01 + map_coordinates(self._sprayed, at, order=1, mode="nearest")
        return np.where(s < self.s0, skin, rock)

    def _hits(self, s: Array, yz: Array) -> Array:
        along, offset = self.profile.locate(yz)
        hit = offset > self.wall(s, along)
        for station, lean, dy, dz in self.arches:
            _, off = self.profile.locate(yz - [dy, dz]) if dy or dz else (along, offset)
            line = self.profile.arch_line
            inside = np.abs(s - station - np.tan(np.radians(lean)) * yz[:, 1]) < self.profile.arch_width / 2
            hit |= inside & (off > line) & (off < line + 0.18)
        return hit

    def cast(self) -> Array:
        """Points in the base frame, shape (n, 3): wall, arches, face, floor, boxes, dust, drip."""
        r = self.recipe
        eye = np.array([self.s0 - 0.5, *self.rng.uniform(-0.4, 0.4, 1), 1.4 + self.rng.uniform(-0.3, 0.3)])
        pans = int(np.sqrt(r.rays / 2))
        pan, beam = np.meshgrid(
            np.linspace(0, np.pi, pans, endpoint=False), np.linspace(-np.pi / 4, 5 * np.pi / 4, 2 * pans)
        )
        pan, beam = pan.ravel() - np.pi / 2, beam.ravel()
        d = np.stack([np.cos(beam) * np.cos(pan), np.cos(beam) * np.sin(pan), np.sin(beam)], -1)
        t = np.full(len(d), 25.0)
        t = np.minimum(t, self._floor(eye, d))
        t = np.minimum(t, self._face(eye, d))
        if r.boxes:
            for low, high in self._box_list():
                t = np.minimum(t, _slab(eye, d, low, high))
        t = self._march(eye, d, t)
        t = t + self.rng.normal(0.0, 0.006, len(t))
        dusty = self.rng.random(len(t)) < r.dust
        t = np.where(dusty, t * self.rng.uniform(0.1, 1.15, len(t)), t)
        keep = (t > 0.3) & (t < 24.0) & (self.rng.random(len(t)) > 0.02)
        points = eye + d[keep] * t[keep, None]
        points = points[points[:, 0] > self.s0 - r.sprayed]
        self._seen(points)
        return (points @ self.R.T + self.point).astype(np.float32)

    def _floor(self, eye: Array, d: Array) -> Array:
        return (self.recipe.floor - eye[2]) / np.where(d[:, 2] < -1e-6, d[:, 2], -1e-6)

    def _face(self, eye: Array, d: Array) -> Array:
        if not self.recipe.face:
            return np.full(len(d), np.inf)
        face = self.s1 + 0.02 * self.rng.standard_normal(len(d))
        return np.where(d[:, 0] > 1e-6, (face - eye[0]) / np.maximum(d[:, 0], 1e-6), np.inf)

    def _box_list(self) -> list[tuple[Array, Array]]:
        f = self.recipe.floor
        truck = np.array([self.s0 - 6, -1.8, f]), np.array([self.s0 - 1.2, 0.6, f + 2.1])
        one = np.array([self.s0 + 0.8, 2.4, f]), np.array([self.s0 + 1.1, 2.9, f + 1.8])
        two = np.array([self.s0 - 2.5, -4.2, f]), np.array([self.s0 - 2.1, -3.8, f + 1.75])
        return [truck, one, two]

    def _march(self, eye: Array, d: Array, t_end: Array) -> Array:
        t = np.zeros(len(d))
        out = t_end.copy()
        live = np.arange(len(d))
        line = self.profile.arch_line
        for _ in range(900):
            p = eye + d[live] * t[live, None]
            _, offset = self.profile.locate(p[:, 1:])
            hit = np.zeros(len(live), bool)
            near = offset > line - 0.16
            hit[near] = self._hits(p[near, 0], p[near, 1:])
            out[live[hit]] = np.minimum(out[live[hit]], t[live[hit]] - 0.01)
            t[live] += np.where(near, 0.02, np.maximum(0.02, 0.8 * (line - 0.14 - offset)))
            live = live[~hit & (t[live] < t_end[live])]
            if not len(live):
                break
        return out

    def _seen(self, points: Array) -> None:
        along, offset = self.profile.locate(points[:, 1:])
        wall = self.wall(points[:, 0], along)
        on = (np.abs(offset - wall) < 0.06) & (points[:, 0] > self.s0) & (points[:, 0] < self.s1)
        coarse, fine = 0.05, 0.025
        cells = np.unique(
            np.floor(points[on, 0] / coarse).astype(int) * 10_000 + np.floor(along[on] / coarse).astype(int)
        )
        inner = (np.arange(2) + 0.5) * fine
        ds, da = (g.ravel() for g in np.meshgrid(inner, inner))
        s = ((cells // 10_000 * coarse)[:, None] + ds).ravel()
        a = ((cells % 10_000 * coarse)[:, None] + da).ravel()
        line, radius = self.profile.overbreak_line, self.profile.arcs[0].radius
        depth = np.maximum(self.wall(s, a) - line, 0.0)
        self.pocket_seen = [
            float(np.sum(((s - p[0]) / p[2]) ** 2 + ((a - p[1]) / p[3]) ** 2 < 1.0)) * fine * fine
            for p in self.pockets
        ]
        self.volume_seen = float(np.sum(depth * (1.0 + (line + depth / 2) / radius)) * fine * fine)

    def truth(self) -> Truth:
        """Truth in the same words as features.json."""
        return Truth(
            self.point,
            self.direction,
            (self.s0, self.s1),
            [(a[0], a[1]) for a in self.arches],
            self.pockets,
            self.pocket_seen,
            self.volume_seen,
        )


def _slab(eye: Array, d: Array, low: Array, high: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - eye) / d, (high - eye) / d
    near, far = np.minimum(a, b).max(1), np.maximum(a, b).min(1)
    return np.where((near < far) & (near > 0), near, np.inf)
