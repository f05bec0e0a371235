"""Draw one tunnel heading from a seed: TunnelConfig -> triangle mesh and its exact truth."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Arch, Axis
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.core.profile import Profile
from ascrcp.simulation.tunnel import AirConfig, TunnelConfig, draw
from ascrcp.simulation.tunnel_arch import build_arch, draw_arches
from ascrcp.simulation.tunnel_mesh import Mesh, grid, merge
from ascrcp.simulation.tunnel_site import (
    build_bodies,
    build_bolts,
    build_face,
    build_feet,
    build_floor,
    build_net,
    draw_drips,
)
from ascrcp.simulation.tunnel_wall import Patch, build_wall, place_patches

CONCERNS = (
    "placement",
    "length",
    "arches",
    "pockets",
    "bumps",
    "wall",
    "floor",
    "face",
    "bodies",
    "air",
    "bolts",
    "net",
)


@dataclass(frozen=True)
class HeadingTruth:
    """What was built, in the words of `features.json`; stations and angles as in the tunnel frame.

    Attributes:
        axis: The exact axis.
        profile: Design profile.
        unsprayed: First and last station of the part to spray [m].
        arches: Steel arches by rising station; `station` is that of the crown.
        pockets: Planted overbreak pockets.
        bumps: Planted rock bumps that reach the arch line and are no arches.
        overbreak_volume: Volume beyond the overbreak line [m3].
        overbreak_area: Its area on the overbreak line [m2].
        floor_z: Base-frame height of the floor in the middle of the unsprayed part [m].
    """

    axis: Axis
    profile: Profile
    unsprayed: tuple[float, float]
    arches: tuple[Arch, ...]
    pockets: tuple[Patch, ...]
    bumps: tuple[Patch, ...]
    overbreak_volume: float
    overbreak_area: float
    floor_z: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values; lines as radii of the profile's crown."""
        crown = self.profile.point(np.array(self.profile.length / 2))
        radius = float(np.hypot(*crown))

        def angle(patch: Patch) -> float:
            return float(np.degrees(self.profile.angle(np.array(patch.along))))

        return {
            "axis": {"point": self.axis.point.tolist(), "direction": self.axis.direction.tolist()},
            "arch_line": radius + self.profile.arch_line,
            "over_line": radius + self.profile.overbreak_line,
            "unsprayed": list(self.unsprayed),
            "arches": [{"station": a.station, "width": a.width, "tilt_deg": a.lean_deg} for a in self.arches],
            "overbreak": [
                {
                    "station": p.station,
                    "angle_deg": angle(p),
                    "half_len": p.half_length,
                    "half_arc": p.half_arc,
                    "depth": p.depth,
                }
                for p in self.pockets
            ],
            "traps": [{"station": p.station, "angle_deg": angle(p)} for p in self.bumps],
            "overbreak_volume_m3": self.overbreak_volume,
            "overbreak_area_m2": self.overbreak_area,
            "floor_z": self.floor_z,
        }


@dataclass(frozen=True)
class Heading:
    """A built heading: what the lidar's rays meet, and the truth about it.

    Attributes:
        vertices: Mesh in the base frame [m], shape (n, 3).
        triangles: Vertex indices, shape (m, 3).
        truth: What was built.
        air: Dust and dripping water.
        drips: Threads of falling water: x, y, lowest z, highest z [m], base frame, shape (k, 4).
        beyond: Middle of wall cells beyond the overbreak line [m], base frame, shape (c, 3).
        beyond_volume: Volume missing in front of each [m3], shape (c,).
        beyond_area: Area of each on the overbreak line [m2], shape (c,).
        rock: So many triangles come first that are the wall's rock; the arches follow.
        built: So many come first that are rock or arches; floor, face and bodies follow.
        pool_z: Level of standing water [m], base frame, None if the floor is dry.
        solid: So many triangles come first that nothing is seen through; wire mesh follows. None: all.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    truth: HeadingTruth
    air: AirConfig
    drips: Array
    beyond: Array
    beyond_volume: Array
    beyond_area: Array
    rock: int
    built: int
    pool_z: float | None = None
    solid: int | None = None


def build_heading(config: TunnelConfig, rng: np.random.Generator, profile: Profile | None = None) -> Heading:
    """Draw a heading. Same configuration and same generator state give the same heading.

    Each concern draws from a stream of its own, so that one more arch moves no rock.

    Args:
        config: What may be drawn.
        rng: The only source of chance.
        profile: Design profile; by default the one the configuration names.
    """
    profile = profile or config.load_profile()
    streams = dict(zip(CONCERNS, rng.spawn(len(CONCERNS)), strict=True))
    axis = _place_axis(config, streams["placement"])
    start = draw(streams["length"], config.length.unsprayed_start)
    part = (start, start + draw(streams["length"], config.length.unsprayed_length))
    pockets = place_patches(config.pockets, streams["pockets"], profile, part, [])
    bumps = place_patches(config.bumps, streams["bumps"], profile, part, pockets)
    wall = build_wall(config, streams["wall"], profile, part, pockets, bumps)
    floor = -draw(streams["floor"], config.floor.below_axis)
    arches = draw_arches(config.arches, streams["arches"], profile, part, floor)
    yz = profile.point(wall.along[None, :], wall.offset)
    s = np.broadcast_to(wall.station[:, None], wall.offset.shape)
    lining = np.concatenate([s[..., None], yz], axis=-1)
    parts = [grid(lining), *build_feet(lining, floor)]
    rock = _count(parts)
    for arch in arches:
        parts += build_arch(config.arches, arch, streams["arches"], profile)
    built = _count(parts)
    parts.append(build_floor(config, streams["floor"], profile, part, floor))
    parts += build_face(config, streams["face"], profile, part)
    parts += build_bolts(config.bolts, streams["bolts"], profile, part, wall)
    parts += build_bodies(config.bodies, streams["bodies"], floor)
    solid = _count(parts)
    mesh = merge([*parts, *build_net(config.net, streams["net"], profile, part, wall)])
    T = axis.T_base_tunnel
    cells, volume, area = wall.cells_beyond(profile, part)
    beyond = np.column_stack([cells[:, 0], profile.point(cells[:, 1], cells[:, 2])])
    truth = HeadingTruth(
        axis=axis,
        profile=profile,
        unsprayed=part,
        arches=tuple(arches),
        pockets=tuple(pockets),
        bumps=tuple(bumps),
        overbreak_volume=float(volume.sum()),
        overbreak_area=float(area.sum()),
        floor_z=float(apply_transform(T, np.array([[sum(part) / 2, 0.0, floor]]))[0, 2]),
    )
    return Heading(
        vertices=apply_transform(T, mesh.vertices).astype(np.float32),
        triangles=mesh.triangles.astype(np.uint32),
        truth=truth,
        air=config.air,
        drips=draw_drips(config.air, streams["air"], part, floor, profile, T),
        beyond=apply_transform(T, beyond),
        beyond_volume=volume,
        beyond_area=area,
        pool_z=truth.floor_z + config.air.pool_depth if config.air.pool_depth > 0.0 else None,
        rock=rock,
        built=built,
        solid=solid,
    )


def _count(parts: list[Mesh]) -> int:
    return sum(len(piece.triangles) for piece in parts)


def _place_axis(config: TunnelConfig, rng: np.random.Generator) -> Axis:
    placement = config.placement
    yaw, grade = (np.radians(draw(rng, limits)) for limits in (placement.yaw_deg, placement.grade_deg))
    direction = np.array([np.cos(grade) * np.cos(yaw), np.cos(grade) * np.sin(yaw), np.sin(grade)])
    beside = np.array([0.0, draw(rng, placement.left), -draw(rng, placement.height)])
    return Axis(beside - direction * (beside @ direction), direction)
