"""One line of the simulated lidar: pose and pan -> distances, as a pulsed scanner would see them."""

from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.config import Struct
from ascrcp.core.errors import DeviceError
from ascrcp.core.geometry import Array, rotation
from ascrcp.simulation.heading import Heading

SIGHT_MARGIN = 0.05  # a cell whose middle is hidden by less than its own relief counts as seen [m]
Metre = Annotated[float, msgspec.Meta(ge=0.0, le=200.0)]
Chance = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class OwnPartConfig(Struct):
    """A part of the machine that the lidar sees: a box in the mount frame.

    Attributes:
        low: Its lowest corner (x, y, z) [m].
        high: Its highest corner [m].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]


class LidarConfig(Struct):
    """The simulated scanner: config/simulation/lidar.yaml.

    Attributes:
        name: What it answers to DeviceIdent.
        beam_start_deg: Angle of the first beam in the scan plane, 0 forward, 90 up [deg].
        beam_step_deg: Angle between beams [deg].
        beams: Number of beams.
        lines_per_s: Turns of the mirror per second [1/s]; drives the device's own time.
        min_range: Nearest distance it measures [m].
        max_range: Farthest distance it measures [m].
        range_sigma: Noise of a distance square to the wall, one standard deviation [m].
        range_bias: Constant error of every distance [m].
        footprint_mrad: Further noise per metre and per tangent of the incidence angle [mrad].
        clear_range: Distance at which half of the beams square to rock still come back [m].
        dropout: Chance that a beam is lost for no reason.
        mixed: Chance that a beam on an edge reports a distance between both surfaces.
        mixed_jump: Smallest jump between neighbouring beams that is an edge [m].
        pan_zero_deg: Error of the pan head's zero: true pan minus measured pan [deg].
        own_parts: Parts of the machine in view.
    """

    name: str
    beam_start_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    beam_step_deg: Annotated[float, msgspec.Meta(ge=0.02, le=10.0)]
    beams: Annotated[int, msgspec.Meta(ge=2, le=8192)]
    lines_per_s: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
    min_range: Metre
    max_range: Metre
    range_sigma: Metre
    range_bias: Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
    footprint_mrad: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)]
    clear_range: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
    dropout: Chance
    mixed: Chance
    mixed_jump: Metre
    pan_zero_deg: Annotated[float, msgspec.Meta(ge=-10.0, le=10.0)]
    own_parts: list[OwnPartConfig]

    def __post_init__(self) -> None:
        if not self.min_range < self.max_range <= 65.0:
            raise ValueError("max_range must lie above min_range and within the 65 m of 16-bit millimetres")
        if not self.beam_step_deg * (self.beams - 1) <= 360.0:
            raise ValueError("beams times beam_step_deg must stay within one turn")

    @property
    def beam(self) -> Array:
        """Beam angles in the scan plane [rad], shape (beams,)."""
        return np.radians(self.beam_start_deg + self.beam_step_deg * np.arange(self.beams))


class LidarModel:
    """Casts the beams of one line into a heading and spoils them as the real thing does.

    Args:
        config: The scanner.
        heading: What it looks at.
    """

    def __init__(self, config: LidarConfig, heading: Heading) -> None:
        try:
            from open3d import core
            from open3d.t.geometry import RaycastingScene
        except (ImportError, OSError) as error:
            raise DeviceError(f"simulated lidar: Open3D cannot be loaded: {error}") from None
        self._config = config
        self._air = heading.air
        self._drips = heading.drips
        self._pool = heading.pool_z
        self._beyond = heading.beyond
        self._beyond_volume = heading.beyond_volume
        self._tensor = core.Tensor.from_numpy
        self._scene = self._solid = RaycastingScene(nthreads=1)
        self._scene.add_triangles(self._tensor(heading.vertices), self._tensor(heading.triangles))
        if heading.solid is not None and heading.solid < len(heading.triangles):
            self._solid = RaycastingScene(nthreads=1)
            solid = heading.triangles[: heading.solid]
            self._solid.add_triangles(self._tensor(heading.vertices), self._tensor(solid))
        beam = config.beam
        self._plane = np.column_stack([np.cos(beam), np.zeros_like(beam), np.sin(beam)])
        self._low = np.array([p.low for p in config.own_parts]).reshape(-1, 1, 3)
        self._high = np.array([p.high for p in config.own_parts]).reshape(-1, 1, 3)
        self.cast(np.eye(4), 0.0)  # the first cast builds the search tree, which takes a while

    def cast(self, T_base_mount: Array, pan: float) -> tuple[Array, Array]:
        """Find what the beams of one line meet, without any error of measurement.

        Args:
            T_base_mount: Pose of the lidar mount, shape (4, 4).
            pan: Measured pan angle [rad]; the beams point at Rot(z, pan) (cos b, 0, sin b).

        Returns:
            Distances [m], inf where there is nothing, and cosines of the incidence angle, (beams,).
        """
        in_mount = self._directions(pan)
        rays = np.empty((len(in_mount), 6), np.float32)
        rays[:, :3] = T_base_mount[:3, 3]
        rays[:, 3:] = in_mount @ T_base_mount[:3, :3].T
        hit = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        distance = hit["t_hit"].numpy().astype(float)
        cosine = np.abs(np.einsum("ij,ij->i", hit["primitive_normals"].numpy(), rays[:, 3:]))
        own = _enter_boxes(in_mount, self._low, self._high)
        return np.minimum(distance, own), np.where(own < distance, 1.0, cosine)

    def measure(self, T_base_mount: Array, pan: float, rng: np.random.Generator) -> Array:
        """Measure one line: `cast`, then edges, noise, water, dust, weak echoes and lost beams.

        Returns:
            Distances [m], NaN where nothing valid came back, shape (beams,).
        """
        config = self._config
        distance, cosine = self.cast(T_base_mount, pan)
        chance = rng.random((5, len(distance)))
        noise = rng.standard_normal(len(distance))
        distance = self._mix_edges(distance, chance[0], chance[1])
        tangent = np.sqrt(np.maximum(1.0 - cosine**2, 0.0)) / np.maximum(cosine, 0.05)
        wall = np.where(np.isfinite(distance), distance, 0.0)
        sigma = np.hypot(config.range_sigma, config.footprint_mrad * 1e-3 * wall * tangent)
        # the echo weakens with the square of the distance and with the cosine (Lambert)
        with np.errstate(divide="ignore"):
            signal = cosine * (config.clear_range / np.maximum(wall, config.min_range)) ** 2
        seen = np.isfinite(distance) & (signal > 2.0 * chance[2])
        distance = np.where(seen, distance, np.inf)
        if self._pool is not None:
            distance = self._over_water(T_base_mount, pan, distance, rng.random(len(distance)))
        if len(self._drips):
            direction = self._directions(pan) @ T_base_mount[:3, :3].T
            distance = self._through_water(T_base_mount, direction, distance, chance[3])
        if self._air.dust_per_m > 0.0:
            dust = -np.log1p(-rng.random(len(distance))) / self._air.dust_per_m
            distance = np.minimum(distance, dust)
        distance = distance + config.range_bias + sigma * noise
        valid = (
            (config.min_range <= distance) & (distance <= config.max_range) & (chance[4] >= config.dropout)
        )
        return np.where(valid, distance, np.nan)

    def visible_volume(self, origin: Array) -> float:
        """Sum the overbreak whose wall is in line of sight of a point (3,), base frame [m3].

        The truth behind `overbreak_volume_m3` of features.json, which counts what was seen.
        """
        return float(self._beyond_volume[self.is_visible(origin)].sum())

    def is_visible(self, origin: Array) -> NDArray[np.bool_]:
        """Whether each of the cells beyond the overbreak line is in sight of a point, shape (c,).

        Wire mesh is looked through: between its bars every cell of the rock is seen in part.
        """
        if len(self._beyond) == 0:
            return np.zeros(0, dtype=bool)
        way = self._beyond - origin
        length = np.linalg.norm(way, axis=1)
        rays = np.hstack([np.broadcast_to(origin, way.shape), way / length[:, None]]).astype(np.float32)
        reached = self._solid.cast_rays(self._tensor(rays), nthreads=1)["t_hit"].numpy()
        return np.asarray(reached > length - SIGHT_MARGIN)

    def _directions(self, pan: float) -> Array:
        return self._plane @ rotation("z", pan + np.radians(self._config.pan_zero_deg)).T

    def _mix_edges(self, distance: Array, chance: Array, share: Array) -> Array:
        """Let beams that straddle an edge report a distance between this surface and the next."""
        here, there = distance[:-1], distance[1:]
        with np.errstate(invalid="ignore"):
            edge = np.isfinite(here + there) & (np.abs(there - here) > self._config.mixed_jump)
        at = np.flatnonzero(edge & (chance[:-1] < self._config.mixed))
        mixed = distance.copy()
        mixed[at] += share[at] * (distance[at + 1] - distance[at])
        return mixed

    def _over_water(self, T_base_mount: Array, pan: float, distance: Array, chance: Array) -> Array:
        """Let beams that meet standing water go astray, or see the wall in its mirror as if below it."""
        assert self._pool is not None
        origin, direction = T_base_mount[:3, 3], self._directions(pan) @ T_base_mount[:3, :3].T
        with np.errstate(divide="ignore"):
            way = (self._pool - origin[2]) / direction[:, 2]
        wet = np.flatnonzero((way > 0.0) & (way < distance))
        rays = np.empty((len(wet), 6), np.float32)
        rays[:, :3] = origin + direction[wet] * way[wet, None]
        rays[:, 3:] = direction[wet] * [1.0, 1.0, -1.0]
        onward = self._scene.cast_rays(self._tensor(rays), nthreads=1)["t_hit"].numpy()
        mirrored = np.where(chance[wet] < self._air.pool_mirror, way[wet] + onward, np.inf)
        distance = distance.copy()
        distance[wet] = mirrored
        return distance

    def _through_water(self, T_base_mount: Array, direction: Array, distance: Array, chance: Array) -> Array:
        """Let beams that pass a thread of falling water be returned by its drops now and then."""
        level = np.hypot(direction[:, 0], direction[:, 1])
        for x, y, z_low, z_high in self._drips:
            to = np.array([x, y]) - T_base_mount[:2, 3]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = direction[:, :2] @ to / level**2
                aside = np.abs(direction[:, 0] * to[1] - direction[:, 1] * to[0]) / level
            z = T_base_mount[2, 3] + t * direction[:, 2]
            meets = (
                (aside <= self._air.drip_radius) & (t > 0.0) & (t < distance) & (z_low <= z) & (z <= z_high)
            )
            distance = np.where(meets & (chance < self._air.drip_chance), t, distance)
        return distance


def _enter_boxes(direction: Array, low: Array, high: Array) -> Array:
    """Distance at which rays from the origin enter the nearest of some boxes, inf if none.

    Args:
        direction: Unit vectors, shape (n, 3).
        low: Lowest corners, shape (k, 1, 3).
        high: Highest corners, shape (k, 1, 3).
    """
    if len(low) == 0:
        return np.full(len(direction), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = low / direction, high / direction
    enter = np.nanmax(np.minimum(a, b), axis=-1)
    leave = np.nanmin(np.maximum(a, b), axis=-1)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf).min(axis=0)
