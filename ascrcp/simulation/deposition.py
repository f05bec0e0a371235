"""The simulated spray: rays of a jet against the growing wall. Its truth judges the planner, never feeds it.

Unlike the planner's footprint on an unrolled wall, single rays are followed: they meet flanges, fly behind
them, hit the flanks of pockets, and meet the wall as it has grown by then.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from ascrcp.core.config import Struct
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array, inverse_transform
from ascrcp.simulation.bare_wall import Bare, sample
from ascrcp.simulation.fresh import Fresh, GrowthConfig
from ascrcp.simulation.tunnel import Range, draw

NEAREST_M, FARTHEST_M, MARCH = (
    0.45,
    1.95,
    18,
)  # where along a ray the wall is looked for, and in how many steps
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))  # angle between neighbours of a sunflower
MAX_REBOUND = 0.9

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]


class DepositionConfig(Struct):
    """config/simulation/deposition.yaml."""

    cell_m: Annotated[float, msgspec.Meta(ge=0.02, le=0.2)]
    rays: Annotated[int, msgspec.Meta(ge=5, le=5000)]
    step_s: Positive
    batch_s: Positive
    deviation_m: Range
    rebound_wall: Range
    rebound_crown: Range
    rebound_angle: Range
    pump_gain: Range
    pump_lag_s: Range
    aim_error_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)]
    aim_wander_s: Positive
    cut_sigma: Annotated[float, msgspec.Meta(ge=1.0, le=5.0)]
    pack_m: Annotated[float, msgspec.Meta(ge=0.0, le=0.3)]
    slope_m: Annotated[float, msgspec.Meta(ge=0.02, le=0.5)]


@dataclass(frozen=True)
class Grown:
    """What a spraying did.

    Attributes:
        rock: Growth of the rock [m], shape (ns, na).
        flange: Growth on arches [m], 0 beside them, shape (ns, na).
        pumped: Concrete pumped [m3].
        rebound: Of it, what rebounded [m3].
        behind: Of it, what stuck to the flanks and backs of arches [m3].
        missed: Of it, what met nothing within reach or left the wall kept [m3].
        fallen: Of what stuck, what fell off before it had set [m3].
    """

    rock: Array
    flange: Array
    pumped: float = 0.0
    rebound: float = 0.0
    behind: float = 0.0
    missed: float = 0.0
    fallen: float = 0.0


class Sprayer:
    """Sprays a heading's wall; what differs from the planner's belief is drawn from the generator."""

    def __init__(
        self, bare: Bare, config: DepositionConfig, rng: np.random.Generator, growth: GrowthConfig
    ) -> None:
        self._bare, self._config, self._rng = bare, config, rng
        self.deviation = draw(rng, config.deviation_m)
        self.rebound_wall = draw(rng, config.rebound_wall)
        self.rebound_crown = draw(rng, config.rebound_crown)
        self._rebound_angle = draw(rng, config.rebound_angle)
        self._gain = draw(rng, config.pump_gain)
        self._lag = draw(rng, config.pump_lag_s)
        shape = bare.rock.shape
        self.grown = Grown(np.zeros(shape), np.zeros(shape))
        self._ds = float(bare.station[1] - bare.station[0])
        self._da = float(bare.along[1] - bare.along[0])
        self._radius = _radius(bare)
        self._fresh = Fresh(bare, growth, rng)

    def spray(self, sequence: JointSequence, T_base_tunnel: Array, pump_m3_s: float) -> Grown:
        """Spray a timed sequence and let the wall grow; what was laid by one before has set.

        Args:
            sequence: Nozzle pose, and flow as a fraction of the pump's largest.
            T_base_tunnel: The true tunnel frame.
            pump_m3_s: The pump's largest flow, as indicated [m3/s].
        """
        c = self._config
        t = np.arange(0.0, sequence.duration, c.step_s)
        flow = self._lagged(t, sequence)
        on = flow > 1e-3
        t, volume = t[on], flow[on] * self._gain * pump_m3_s * c.step_s
        T = inverse_transform(T_base_tunnel)
        place = (
            np.column_stack([np.interp(t, sequence.t, x) for x in sequence.position.T]) @ T[:3, :3].T
            + T[:3, 3]
        )
        heading = np.column_stack([np.interp(t, sequence.t, x) for x in sequence.direction.T]) @ T[:3, :3].T
        place = place + self._wander(len(t))
        self._fresh.set()
        many = max(1, round(c.batch_s / c.step_s))
        for start in range(0, len(t), many):
            part = slice(start, start + many)
            self._batch(place[part], heading[part], volume[part], float(t[part][-1]))
        return self.grown

    def _lagged(self, t: Array, sequence: JointSequence) -> Array:
        """Let the flow follow what the pump is told (first order)."""
        row = np.clip(np.searchsorted(sequence.t, t, side="right") - 1, 0, len(sequence.t) - 1)
        told, share = sequence.flow[row], 1.0 - np.exp(-self._config.step_s / self._lag)
        out, value = np.empty(len(t)), 0.0
        for i, wanted in enumerate(told.tolist()):
            value += (wanted - value) * share
            out[i] = value
        return out

    def _wander(self, count: int) -> Array:
        """Errors of the nozzle's place, slow and of the configured size [m], shape (count, 3)."""
        c = self._config
        noise = gaussian_filter(
            self._rng.normal(size=(count, 3)), (c.aim_wander_s / c.step_s, 0.0), mode="nearest"
        )
        size = noise.std() if count > 1 else 1.0
        return np.asarray(noise * (c.aim_error_m / np.sqrt(3.0) / max(size, 1e-9)))

    def _batch(self, place: Array, heading: Array, volume: Array, now_s: float) -> None:
        c, bare = self._config, self._bare
        before = np.stack([self.grown.rock, self.grown.flange])
        n = len(place) * c.rays
        d = np.repeat(heading / np.linalg.norm(heading, axis=1, keepdims=True), c.rays, axis=0)
        origin, amount = np.repeat(place, c.rays, axis=0), np.repeat(volume / c.rays, c.rays)
        d = d + self._spread(d, n)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        hit, face, met = self._march(origin, d)
        lost = np.where(met, self._rebound(d, hit, face), 0.0) * amount
        stuck = np.where(met, amount - lost, 0.0)
        row, column = _index(hit[:, 0], bare.station, self._ds), _index(hit[:, 1], bare.along, self._da)
        inside = (
            met
            & (row >= 0)
            & (row < bare.rock.shape[0] - 1)
            & (column >= 0)
            & (column < bare.rock.shape[1] - 1)
        )
        on_flange = inside & (face == 1)
        flank = inside & (face == 2)
        on_rock = inside & (face == 0)
        self._add(self.grown.rock, hit[on_rock], stuck[on_rock])
        self._add(self.grown.flange, hit[on_flange], stuck[on_flange])
        self.grown.flange[~np.isfinite(bare.flange)] = 0.0
        self.grown = replace(
            self.grown,
            pumped=self.grown.pumped + float(amount.sum()),
            rebound=self.grown.rebound + float(lost.sum()),
            behind=self.grown.behind + float(stuck[flank].sum()),
            missed=self.grown.missed + float(amount[~met].sum() + stuck[met & ~inside].sum()),
        )
        self._let_fall(now_s, before)

    def _let_fall(self, now_s: float, before: Array) -> None:
        """Take off the wall what hangs too thick before it has set (`Fresh`)."""
        bare, now = self._bare, np.stack([self.grown.rock, self.grown.flange])
        falls = self._fresh.add(now_s, now - before, now)
        if falls.any():
            self.grown.rock[...] -= falls[0]
            self.grown.flange[...] -= falls[1]
            place = np.stack([bare.rock, np.nan_to_num(bare.flange)])
            size = self._ds * self._da * (1.0 + place / self._radius)
            self.grown = replace(self.grown, fallen=self.grown.fallen + float((falls * size).sum()))

    def _spread(self, d: Array, n: int) -> Array:
        """Tell where rays leave the axis: a Gaussian jet, cut off at its rim, shape (n, 3).

        The rays of an instant fill the jet evenly as a sunflower does, turned at random: drops are far more
        than rays, so their number's own scatter must not show.
        """
        rays = self._config.rays
        instants = n // rays
        share = (np.arange(rays) + self._rng.random((instants, 1))) / rays
        within = 1.0 - np.exp(-(self._config.cut_sigma**2) / 2)
        tangent = self.deviation * np.sqrt(-2.0 * np.log(1.0 - share * within)).ravel()
        angle = (GOLDEN * np.arange(rays) + 2.0 * np.pi * self._rng.random((instants, 1))).ravel()
        side = np.cross(d, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        other = np.cross(d, side)
        return np.asarray(tangent[:, None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other))

    def _march(self, origin: Array, d: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
        """Follow rays to the first thing they meet.

        Returns:
            Station, arc length and offset of the hit (n, 3); what was hit: 0 rock, 1 inner flange, 2 an
            arch's flank or back (n,); whether anything was hit (n,).
        """
        bare = self._bare
        reach = np.linspace(NEAREST_M, FARTHEST_M, MARCH)
        p = origin[:, None, :] + reach[:, None] * d[:, None, :]
        along, offset = bare.profile.locate(p[..., 1:].reshape(-1, 2))
        along, offset = along.reshape(p.shape[:2]), offset.reshape(p.shape[:2])
        row = (p[..., 0] - bare.station[0]) / self._ds
        column = (along - bare.along[0]) / self._da
        rock = sample(bare.rock - self.grown.rock, row, column)
        r = np.clip(np.rint(row), 0, bare.rock.shape[0] - 1).astype(np.int64)
        c = np.clip(np.rint(column), 0, bare.rock.shape[1] - 1).astype(np.int64)
        lid = (bare.flange - self.grown.flange)[r, c]
        back = (bare.flange + bare.outer)[r, c]
        with np.errstate(invalid="ignore"):
            in_arch = (offset > lid) & (offset < back)
        solid = (offset > rock) | in_arch
        met = solid.any(axis=1)
        k = np.argmax(solid, axis=1)
        every = np.arange(len(k))
        before = np.maximum(k - 1, 0)
        gap0 = rock[every, before] - offset[every, before]
        gap1 = rock[every, k] - offset[every, k]
        share = np.clip(gap0 / np.where(np.abs(gap0 - gap1) > 1e-9, gap0 - gap1, 1.0), 0.0, 1.0)
        arch = in_arch[every, k]
        with np.errstate(invalid="ignore"):
            front = arch & ~(offset[every, before] > lid[every, k])
        level = np.where(front, lid[every, k], 0.0)
        rise = offset[every, k] - offset[every, before]
        share = np.where(
            front,
            np.clip((level - offset[every, before]) / np.where(np.abs(rise) > 1e-9, rise, 1.0), 0, 1),
            share,
        )

        def blend(values: Array) -> Array:
            return np.asarray(values[every, before] + share * (values[every, k] - values[every, before]))

        hit = np.column_stack([blend(p[..., 0]), blend(along), blend(offset)])
        return hit, np.where(front, 1, np.where(arch, 2, 0)), met

    def _rebound(self, d: Array, hit: Array, face: NDArray[np.int64]) -> Array:
        """Share that rebounds from where the rays hit, shape (n,)."""
        bare = self._bare
        normal = bare.profile.normal(hit[:, 1])
        row, column = (hit[:, 0] - bare.station[0]) / self._ds, (hit[:, 1] - bare.along[0]) / self._da
        wall = bare.rock - self.grown.rock
        probe = self._config.slope_m
        dr, dc = probe / self._ds, probe / self._da
        by_station = (sample(wall, row + dr, column) - sample(wall, row - dr, column)) / (2 * probe)
        by_along = (sample(wall, row, column + dc) - sample(wall, row, column - dc)) / (2 * probe)
        plain = face > 0
        by_station, by_along = np.where(plain, 0.0, by_station), np.where(plain, 0.0, by_along)
        out = d[:, 1] * normal[:, 0] + d[:, 2] * normal[:, 1]
        around = d[:, 1] * normal[:, 1] - d[:, 2] * normal[:, 0]
        square = (out - by_station * d[:, 0] - by_along * around) / np.sqrt(1 + by_station**2 + by_along**2)
        up = np.clip(normal[:, 1], 0.0, 1.0) ** 2
        place = self.rebound_wall + (self.rebound_crown - self.rebound_wall) * up
        return np.asarray(
            np.clip(place + self._rebound_angle * (1.0 - np.clip(square, 0, 1) ** 2), 0, MAX_REBOUND)
        )

    def _add(self, field: Array, hit: Array, volume: Array) -> None:
        """Let the cells about each hit grow by its volume, bilinear."""
        bare, laid = self._bare, np.zeros(field.shape)
        row, column = (hit[:, 0] - bare.station[0]) / self._ds, (hit[:, 1] - bare.along[0]) / self._da
        r, c = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
        fr, fc = row - r, column - c
        height = volume / (
            self._ds * self._da * (1.0 + hit[:, 2] / self._radius[np.clip(c, 0, len(self._radius) - 1)])
        )
        for i, j, w in (
            (0, 0, (1 - fr) * (1 - fc)),
            (1, 0, fr * (1 - fc)),
            (0, 1, (1 - fr) * fc),
            (1, 1, fr * fc),
        ):
            np.add.at(laid, (r + i, c + j), w * height)
        if field is self.grown.rock:
            pack = self._config.pack_m
            laid = gaussian_filter(laid, (pack / self._ds, pack / self._da), mode="nearest", truncate=2.5)
        field += laid


def _radius(bare: Bare) -> Array:
    arc = np.searchsorted(bare.profile.arc_starts, bare.along, side="right") - 1
    arc = np.clip(arc, 0, len(bare.profile.arcs) - 1)
    return np.asarray(np.array([a.radius for a in bare.profile.arcs])[arc])


def _index(value: Array, grid: Array, step: float) -> NDArray[np.int64]:
    return np.floor((value - grid[0]) / step).astype(np.int64)
