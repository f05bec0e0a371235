"""What else stands and falls in the simulated tunnel: floor, muck, face, people, vehicles, drips."""

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import gaussian_filter

from ascrcp.core.geometry import Array, apply_transform
from ascrcp.core.profile import Profile
from ascrcp.simulation.tunnel import AirConfig, BodyConfig, BoltsConfig, NetConfig, TunnelConfig, draw
from ascrcp.simulation.tunnel_mesh import Mesh, box, cylinder, grid, rough
from ascrcp.simulation.tunnel_wall import Wall

FLOOR_STEP = 0.15  # triangles of the floor [m]
FACE_STEP = 0.08  # triangles of the face [m]
BEYOND = 0.8  # floor and face reach this far behind the wall, so that no gap shows [m]
NET_STEP = 0.10  # pieces of a bar [m]
PLATE = 0.008  # thickness of a bolt's plate [m]
DRIP_REACH = 3.0  # drips fall from the unsprayed part to this far behind it [m]


def build_floor(
    config: TunnelConfig, rng: np.random.Generator, profile: Profile, part: tuple[float, float], floor: float
) -> Mesh:
    """Build the floor with the muck heap that rises toward the face, tunnel frame."""
    (low, high), _ = _extent(profile)
    s = np.arange(config.length.rear, part[1] + BEYOND, FLOOR_STEP)
    S, Y = np.meshgrid(s, np.arange(low, high, FLOOR_STEP), indexing="ij")
    heap = np.clip((S - part[1]) / config.floor.muck_length + 1.0, 0.0, 1.0) * config.floor.muck_height
    Z = floor + heap + rough(rng, S, Y, config.floor.roughness)
    return grid(np.stack([S, Y, Z], axis=-1))


def build_feet(lining: Array, floor: float) -> list[Mesh]:
    """Carry the wall straight down to the floor where the profile ends above it, tunnel frame.

    Args:
        lining: Grid of wall points, stations by arc lengths, shape (ns, na, 3) [m].
        floor: Height of the floor [m].
    """
    meshes = []
    for edge in (lining[:, 0], lining[:, -1]):
        below = edge.copy()
        below[:, 2] = np.minimum(edge[:, 2], floor - BEYOND)
        meshes.append(grid(np.stack([edge, below])))
    return meshes


def build_face(
    config: TunnelConfig, rng: np.random.Generator, profile: Profile, part: tuple[float, float]
) -> list[Mesh]:
    """Build the rock face at the end of the unsprayed part, tunnel frame; none if it is left open."""
    if not config.face.present:
        return []
    (left, right), (bottom, top) = _extent(profile)
    Y, Z = np.meshgrid(np.arange(left, right, FACE_STEP), np.arange(bottom, top, FACE_STEP), indexing="ij")
    S = part[1] + rough(rng, Y, Z, config.face.roughness)
    return [grid(np.stack([S, Y, Z], axis=-1))]


def build_bodies(bodies: list[BodyConfig], rng: np.random.Generator, floor: float) -> list[Mesh]:
    """Stand vehicles and people on the floor, tunnel frame."""
    meshes = []
    for body in bodies:
        foot = np.array([draw(rng, body.station), draw(rng, body.left), floor])
        if body.shape == "cylinder":
            meshes.append(cylinder(foot, body.length / 2, body.height))
        else:
            half = np.array([body.length / 2, body.width / 2, 0.0])
            meshes.append(box(foot - half, foot + half + [0.0, 0.0, body.height]))
    return meshes


def build_bolts(
    config: BoltsConfig, rng: np.random.Generator, profile: Profile, part: tuple[float, float], wall: Wall
) -> list[Mesh]:
    """Set rock bolts square to the wall of the unsprayed part, tunnel frame."""
    meshes = []
    for _ in range(config.count):
        s, along = rng.uniform(*part), rng.uniform(0.15, 0.85) * profile.length
        row, column = np.searchsorted(wall.station, s), np.searchsorted(wall.along, along)
        face = float(wall.offset[row, column]) - config.stand_off
        for half, outer, inner in (
            (config.plate / 2, face, face - PLATE),
            (config.thickness / 2, face, face - config.stub),
        ):
            block = box(np.array([s - half, along - half, inner]), np.array([s + half, along + half, outer]))
            s_, along_, offset = block.vertices.T
            meshes.append(Mesh(np.column_stack([s_, profile.point(along_, offset)]), block.triangles))
    return meshes


def build_net(
    config: NetConfig, rng: np.random.Generator, profile: Profile, part: tuple[float, float], wall: Wall
) -> list[Mesh]:
    """Nail wire mesh to the rock of the unsprayed part, as flat bars that face the axis, tunnel frame."""
    if not config.present:
        return []
    steps = [float(axis[-1] - axis[-2]) for axis in (wall.station, wall.along)]
    spread = [config.bend / step for step in steps]
    # bent over hollows, and never inside the rock
    net = np.minimum(gaussian_filter(wall.offset, spread) - config.stand_off, wall.offset - config.bar)
    surface = RegularGridInterpolator((wall.station, wall.along), net, bounds_error=False, fill_value=None)
    shift = rng.uniform(0.0, config.pitch, 2)
    across, round_ = (
        np.arange(first + by, last, config.pitch)
        for first, last, by in ((*part, shift[0]), (0.0, profile.length, shift[1]))
    )
    fine = np.arange(part[0], part[1], NET_STEP), np.arange(0.0, profile.length, NET_STEP)
    meshes = []
    for s in across:
        meshes.append(_bar(np.full_like(fine[1], s), fine[1], (config.bar / 2, 0.0), surface, profile))
    for along in round_:
        meshes.append(_bar(fine[0], np.full_like(fine[0], along), (0.0, config.bar / 2), surface, profile))
    return meshes


def _bar(
    s: Array, along: Array, half: tuple[float, float], surface: RegularGridInterpolator, profile: Profile
) -> Mesh:
    """One bar through points (m,) of the unrolled wall, `half` wide to either side along s and arc."""
    offset = surface(np.column_stack([s, along]))
    sides = [
        np.column_stack([s + sign * half[0], profile.point(along + sign * half[1], offset)])
        for sign in (-1, 1)
    ]
    return grid(np.stack(sides))


def draw_drips(
    air: AirConfig,
    rng: np.random.Generator,
    part: tuple[float, float],
    floor: float,
    profile: Profile,
    T_base_tunnel: Array,
) -> Array:
    """Draw threads of water that fall from the wall to the floor.

    Returns:
        x, y, lowest z, highest z [m], base frame, shape (drips, 4).
    """
    s = rng.uniform(part[0] - DRIP_REACH, part[1], air.drips)
    along = rng.uniform(0.3, 0.7, air.drips) * profile.length
    top = np.column_stack([s, profile.point(along, profile.arch_line).reshape(-1, 2)])
    top = apply_transform(T_base_tunnel, top)
    depth = apply_transform(T_base_tunnel, np.column_stack([s, np.zeros_like(s), np.full_like(s, floor)]))
    return np.column_stack([top[:, :2], depth[:, 2], top[:, 2]])


def _extent(profile: Profile) -> tuple[tuple[float, float], tuple[float, float]]:
    yz = profile.point(np.linspace(0.0, profile.length, 500))
    low, high = yz.min(axis=0) - BEYOND, yz.max(axis=0) + BEYOND
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))
