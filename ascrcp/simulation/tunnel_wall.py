"""The wall of the simulated tunnel: sprayed part, rock, pockets, bumps -> offset from the design line."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.simulation.tunnel import PatchConfig, TunnelConfig, draw
from ascrcp.simulation.tunnel_mesh import rough

TRIES = 200  # a patch that finds no free place in so many draws is left out
GAP = 0.15  # least distance between two patches, and between a patch and the end of the part [m]


@dataclass(frozen=True)
class Patch:
    """An elliptic patch of the rock: middle (station, arc length) and half extents [m], depth [m]."""

    station: float
    along: float
    half_length: float
    half_arc: float
    depth: float

    def radius(self, s: Array, along: Array) -> Array:
        """Distance from the middle in half extents: 1 on the patch's edge."""
        return np.hypot((s - self.station) / self.half_length, (along - self.along) / self.half_arc)

    def is_clear_of(self, other: "Patch") -> bool:
        """Whether two patches keep their distance."""
        return (
            abs(self.station - other.station) > self.half_length + other.half_length + GAP
            or abs(self.along - other.along) > self.half_arc + other.half_arc + GAP
        )


def place_patches(
    config: PatchConfig,
    rng: np.random.Generator,
    profile: Profile,
    part: tuple[float, float],
    taken: list[Patch],
) -> list[Patch]:
    """Draw patches inside the unsprayed part that touch neither each other nor those taken."""
    along = np.linspace(0.0, profile.length, 2000)
    low, high = np.radians(config.angle_deg)
    angle = profile.angle(along)
    along = along[(angle >= low) & (angle <= high)]
    found: list[Patch] = []
    for _ in range(TRIES):
        if len(found) == config.count or len(along) == 0:
            break
        half = draw(rng, config.half_length)
        first, last = part[0] + half + GAP, part[1] - half - GAP
        station = draw(rng, (first, max(first, last)))
        patch = Patch(
            station, float(rng.choice(along)), half, draw(rng, config.half_arc), draw(rng, config.depth)
        )
        if first <= last and all(patch.is_clear_of(other) for other in taken + found):
            found.append(patch)
    return found


@dataclass(frozen=True)
class Wall:
    """The wall over a grid: stations (ns,), arc lengths (na,), outward offsets (ns, na) [m]."""

    station: Array
    along: Array
    offset: Array

    def cells_beyond(self, profile: Profile, part: tuple[float, float]) -> tuple[Array, Array, Array]:
        """Find what is missing beyond the overbreak line in the unsprayed part.

        Returns:
            Section coordinates (s, along, offset) of cells beyond the line, shape (k, 3), volume of
            each between wall and line [m3] (k,), and its area on the overbreak line [m2] (k,).
        """
        corner = self.offset
        offset = (corner[1:, 1:] + corner[1:, :-1] + corner[:-1, 1:] + corner[:-1, :-1]) / 4
        s, along = (x[1:] / 2 + x[:-1] / 2 for x in (self.station, self.along))
        S, A = np.meshgrid(s, along, indexing="ij")
        beyond = (offset > profile.overbreak_line) & (part[0] <= S) & (part[1] >= S)
        arc = np.clip(np.searchsorted(profile.arc_starts, along, side="right") - 1, 0, len(profile.arcs) - 1)
        radius = np.array([a.radius for a in profile.arcs])[arc]
        line, depth = radius + profile.overbreak_line, offset - profile.overbreak_line
        patch = np.diff(self.station)[:, None] * np.diff(self.along) / radius
        # a prism between two radii: mean radius times height times angle
        volume = patch * depth * (line + depth / 2)
        return (
            np.stack([S[beyond], A[beyond], offset[beyond]], axis=-1),
            volume[beyond],
            (patch * line)[beyond],
        )


def build_wall(
    config: TunnelConfig,
    rng: np.random.Generator,
    profile: Profile,
    part: tuple[float, float],
    pockets: list[Patch],
    bumps: list[Patch],
) -> Wall:
    """Draw the wall from the rear of the tunnel to behind its face."""
    fine, coarse = config.mesh.step, config.mesh.step_behind
    turn = part[0] - 4 * GAP
    end = part[1] + (4 * GAP if config.face.present else 0.0)
    station = np.concatenate([_even(config.length.rear, turn, coarse)[:-1], _even(turn, end, fine)])
    along = _even(0.0, profile.length, fine)
    S, A = station[:, None], along[None, :]
    rock = _rock(config, rng, profile, part, S, A, pockets, bumps)
    sprayed = profile.arch_line - config.sprayed.below_arch_line + rough(rng, S, A, config.sprayed.roughness)
    ragged = np.interp(along, _even(0.0, profile.length, 0.5), _normal(rng, profile.length, 0.5))
    edge = part[0] + config.sprayed.edge_ragged * ragged
    ramp = np.clip((S - edge) / config.sprayed.edge_ramp + 0.5, 0.0, 1.0)
    return Wall(station, along, sprayed + ramp**2 * (3 - 2 * ramp) * (rock - sprayed))


def _rock(
    config: TunnelConfig,
    rng: np.random.Generator,
    profile: Profile,
    part: tuple[float, float],
    S: Array,
    A: Array,
    pockets: list[Patch],
    bumps: list[Patch],
) -> Array:
    relief = rough(rng, S, A, config.rock.roughness)
    rock = config.rock.offset + config.rock.look_out * (S - part[0]) / (part[1] - part[0]) + relief
    for bump in bumps:
        weight = np.clip(1.0 - bump.radius(S, A) ** 2, 0.0, 1.0) ** 2
        rock = rock + weight * (profile.arch_line - bump.depth - rock)
    rock = np.minimum(rock, profile.overbreak_line - config.rock.margin)
    for pocket in pockets:
        r = pocket.radius(S, A)
        # beyond the line exactly inside the ellipse, up to its own relief; broken sides outside
        hollow = profile.overbreak_line + pocket.depth * (1.0 - r**4)
        rock = np.maximum(rock, hollow + relief * np.clip(1.0 - r**2, 0.0, 1.0))
    return rock - config.rock.layer


def _even(first: float, last: float, step: float) -> Array:
    return np.linspace(first, last, max(2, int(np.ceil((last - first) / step)) + 1))


def _normal(rng: np.random.Generator, length: float, step: float) -> Array:
    return rng.standard_normal(len(_even(0.0, length, step)))
