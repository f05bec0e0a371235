"""The wall that grows in a run: true nozzle poses and true flow -> Heading with its layer on.

Lies in the lidar's process, which sees the wall and has nothing else to do while the arm sprays. The jet is
that of `deposition`; what hangs too thick before it has set falls off, with all that is fresh about it.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ascrcp.core.geometry import Array, inverse_transform
from ascrcp.simulation.bare_wall import Bare, grow_heading, lay_bare
from ascrcp.simulation.deposition import DepositionConfig, Grown, Sprayer
from ascrcp.simulation.fresh import GrowthConfig
from ascrcp.simulation.heading import Heading

STREAM = 5  # of chance, beside the rig's own and the heading's
LEAST_FLOW = 1e-3  # less is a pump that stands


@dataclass(frozen=True)
class SprayTruth:
    """What the site knows about the spraying and the platform does not.

    Attributes:
        jet: The jet.
        growth: How the wall takes it up.
        arch_depth: From an arch's inner to its outer flange [m].
        pump_m3_s: The pump's largest flow, as indicated [m3/s].
    """

    jet: DepositionConfig
    growth: GrowthConfig
    arch_depth: float
    pump_m3_s: float


class NozzleRecord:
    """Collects where the nozzle really was and how much came out of it, until a batch is full."""

    def __init__(self, truth: SprayTruth) -> None:
        self._step_s, self._batch_s = truth.jet.step_s, truth.growth.batch_s
        self._pump = truth.pump_m3_s if truth.growth.grows else 0.0
        self._volume = self._since_s = self._held_s = 0.0
        self._rows: list[tuple[float, ...]] = []

    def add(self, now_s: float, T_base_nozzle: Array, flow: float, step_s: float) -> Array | None:
        """Add one cycle.

        Args:
            now_s: Instant [s].
            T_base_nozzle: The true nozzle, shape (4, 4).
            flow: True concrete flow, as a fraction of the pump's largest.
            step_s: Length of the cycle [s].

        Returns:
            A full batch to lay, rows of instant [s], position [m], spray direction and indicated volume
            [m3], shape (n, 8); None while there is none. A pump that stops ends a batch.
        """
        if not flow > LEAST_FLOW:
            return self._take() if self._rows else None
        self._volume += flow * self._pump * step_s
        self._since_s += step_s
        self._held_s += step_s
        if self._since_s >= self._step_s - step_s / 2:
            place, direction = T_base_nozzle[:3, 3].tolist(), T_base_nozzle[:3, 0].tolist()
            self._rows.append((now_s, *place, *direction, self._volume))
            self._volume = self._since_s = 0.0
        return self._take() if self._held_s >= self._batch_s - step_s / 2 and self._rows else None

    def _take(self) -> Array:
        batch = np.array(self._rows)
        self._rows, self._held_s = [], 0.0
        return batch


class _Jet(Sprayer):
    """A jet told nozzle by nozzle; lag and wander are the rig's own, where `Sprayer` has to add them."""

    def lay(self, place: Array, direction: Array, indicated: Array, now_s: float) -> None:
        """Spray until an instant from nozzles in the tunnel frame (n, 3); indicated volumes [m3], (n,)."""
        self._batch(place, direction, indicated * self._gain, now_s)

    @property
    def patch(self) -> float:
        """Area of a cell on the design line [m2]."""
        return self._ds * self._da

    def stretch(self, offset: Array) -> Array:
        """How much wider a cell is at an offset than on the design line, shape (ns, na)."""
        return np.asarray(1.0 + offset / self._radius)


class GrowingWall:
    """A heading's wall under the jet; the same seed and the same batches give the same wall."""

    def __init__(self, heading: Heading, truth: SprayTruth, seed: int) -> None:
        self._heading, self._truth = heading, truth
        self._rng = np.random.default_rng([seed, STREAM])
        self._T_tunnel_base = inverse_transform(heading.truth.axis.T_base_tunnel)
        self._bare: Bare | None = None

    def lay(self, batch: Array) -> None:
        """Let the wall grow by one batch of a `NozzleRecord`, shape (n, 8)."""
        if self._bare is None:
            self._begin()
        jet, T = self._jet, self._T_tunnel_base
        jet.lay(
            batch[:, 1:4] @ T[:3, :3].T + T[:3, 3],
            batch[:, 4:7] @ T[:3, :3].T,
            batch[:, 7],
            float(batch[-1, 0]),
        )

    def _begin(self) -> None:
        """Measure the wall as the jet meets it; wire mesh holds back nothing."""
        rock = self._heading
        if rock.solid is not None:
            rock = replace(rock, triangles=rock.triangles[: rock.solid], solid=None)
        bare = self._bare = lay_bare(rock, self._truth.jet.cell_m, self._truth.arch_depth)
        self._jet = _Jet(bare, self._truth.jet, self._rng, self._truth.growth)

    def heading(self) -> Heading:
        """Return the heading with its layer on, for the lidar."""
        if self._bare is None:
            return self._heading
        return grow_heading(self._heading, self._bare, self._jet.grown.rock, self._jet.grown.flange)

    def summary(self) -> dict[str, Any]:
        """Return what became of the concrete [m3], plain values."""
        if self._bare is None:
            grown = Grown(np.zeros((0, 0)), np.zeros((0, 0)))
        else:
            grown = self._jet.grown
        held = {"on_rock": 0.0, "on_arches": 0.0}
        if self._bare is not None:
            cell, bare = self._jet.patch, self._bare
            held["on_rock"] = float((grown.rock * self._jet.stretch(bare.rock)).sum() * cell)
            flange = grown.flange * self._jet.stretch(np.nan_to_num(bare.flange))
            held["on_arches"] = float(flange.sum() * cell)
        return {
            "pumped_m3": grown.pumped,
            "rebound_m3": grown.rebound,
            "fallen_m3": grown.fallen,
            "on_rock_m3": held["on_rock"],
            "on_arches_m3": held["on_arches"],
            "behind_arches_m3": grown.behind,
            "missed_m3": grown.missed,
        }
