"""Synthetic headings with known geometry: roughness, arches, pockets, holes, yaw and grade."""

import numpy as np
from scipy.ndimage import gaussian_filter

from ascrcp.core.flow import Arch, Axis, Bay, Label, Overbreak, Surface
from ascrcp.core.profile import Arc, Profile
from ascrcp.planning.target import Target

RADIUS = 5.9
STEP = 0.05


def profile() -> Profile:
    arc = Arc(centre=(0.0, 0.0), radius=RADIUS, start_deg=-28.0, end_deg=208.0)
    return Profile(name="circle", arcs=[arc])


def heading(
    seed: int = 0,
    unsprayed: tuple[float, float] = (10.2, 13.2),
    arches: tuple[float, ...] = (11.2, 12.18),
    lean_deg: float = 0.0,
    pockets: tuple[tuple[float, float, float, float], ...] = (),
    roughness: float = 0.03,
    holes: float = 0.0,
    yaw_deg: float = 2.0,
    grade_deg: float = -1.0,
    floor_z: float | None = None,
) -> Surface:
    """Build a heading; pockets are (station, angle_deg, half length along both [m], depth [m])."""
    rng = np.random.default_rng(seed)
    design = profile()
    station = np.arange(unsprayed[0] - 0.5, unsprayed[1] + 0.5, STEP)
    along = np.arange(0.0, design.length, STEP)
    noise = gaussian_filter(rng.normal(size=(len(station), len(along))), 2.0)
    offset = 0.05 + roughness * noise / noise.std()
    angle = np.degrees(design.angle(along))
    regions = []
    for s0, phi, half, depth in pockets:
        arc = np.radians(angle - phi) * RADIUS
        r = np.maximum(np.abs(station[:, None] - s0), np.abs(arc[None])) / half
        offset += depth * np.clip(1.0 - r**4, 0.0, None)
        wide = np.degrees(half / RADIUS)
        regions.append(
            Overbreak((s0 - half, s0 + half), (phi - wide, phi + wide), 4 * half**2, depth, depth, 1.0)
        )
    filled = np.zeros(offset.shape, dtype=bool)
    if holes:
        filled |= False
        middle = gaussian_filter(rng.normal(size=offset.shape), 3.0)
        offset[middle > np.quantile(middle, 1.0 - holes)] = np.nan
    ends = [unsprayed[0], *[e for a in arches for e in (a - 0.1, a + 0.1)], unsprayed[1]]
    bays = tuple(
        Bay((ends[2 * i], ends[2 * i + 1]), i - 1 if i else None, i if i < len(arches) else None)
        for i in range(len(arches) + 1)
    )
    yaw, grade = np.radians([yaw_deg, grade_deg])
    direction = np.array([np.cos(yaw) * np.cos(grade), np.sin(yaw) * np.cos(grade), np.sin(grade)])
    axis = Axis(point=np.array([-0.05, 0.3, -1.85]), direction=direction)
    points, labels = np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
    if floor_z is not None:
        T = axis.T_base_tunnel
        local = np.column_stack([rng.uniform(9, 13, 500), rng.uniform(-4, 4, 500), np.full(500, floor_z)])
        points = (local @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
        labels = np.full(500, Label.GROUND, np.uint8)
    return Surface(
        axis=axis,
        profile=design,
        unsprayed=unsprayed,
        arches=tuple(Arch(a, 0.2, lean_deg, (-28.0, 208.0)) for a in arches),
        overbreak=tuple(regions),
        bays=bays,
        station=station,
        along=along,
        offset=offset.astype(np.float32),
        filled=filled,
        points=points,
        labels=labels,
    )


def scan_of(
    surface: Surface,
    target: Target,
    layer: np.ndarray,
    places: tuple[tuple[float, float], ...] = ((-0.2, -0.2), (-0.2, 0.2), (0.2, -0.2), (0.2, 0.2)),
) -> np.ndarray:
    """Points of the wall with a layer on it, base frame: in every cell at these places from its middle."""
    T = surface.axis.T_base_tunnel
    ds, da = target.cell
    parts = []
    for s, a in places:
        S, A = np.meshgrid(target.station + s * ds, target.along + a * da, indexing="ij")
        offset = target.sample(target.offset - layer, S.ravel(), A.ravel()).reshape(S.shape)
        yz = target.profile.point(A, offset)
        parts.append(np.column_stack([S.ravel(), yz.reshape(-1, 2)]) @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(parts).astype(np.float32)
