"""Fresh concrete on the simulated wall: where too much of it hangs before it has set, it falls off."""

from typing import Annotated

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter

from ascrcp.core.config import Struct
from ascrcp.core.geometry import Array
from ascrcp.simulation.bare_wall import Bare
from ascrcp.simulation.tunnel import Range, draw

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]


class GrowthConfig(Struct):
    """config/simulation/growth.yaml."""

    grows: bool
    batch_s: Positive
    fall_wall_m: Range
    fall_crown_m: Range
    fall_patch_m: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)]
    set_s: Range


class Fresh:
    """What was laid lately on rock and flanges, and how much of it stays up."""

    def __init__(self, bare: Bare, config: GrowthConfig, rng: np.random.Generator) -> None:
        wall, crown = draw(rng, config.fall_wall_m), draw(rng, config.fall_crown_m)
        up = np.clip(bare.profile.normal(bare.along)[:, 1], 0.0, 1.0) ** 2
        self._holds = wall + (crown - wall) * up
        self._sets = float(np.exp(-1.0 / draw(rng, config.set_s)))
        step = (bare.station[1] - bare.station[0]) * (bare.along[1] - bare.along[0])
        self._sigma = config.fall_patch_m / np.sqrt(float(step))
        self._thickness = np.zeros((2, *bare.rock.shape))
        self._now_s = 0.0

    def set(self) -> None:
        """Let all of it set; the clock begins anew."""
        self._thickness[...] = 0.0
        self._now_s = 0.0

    def add(self, now_s: float, laid: Array, grown: Array) -> Array:
        """Add what was laid since the last call, and find what falls: all that is fresh where too thick.

        Args:
            now_s: Instant [s].
            laid: On rock and on flanges [m], shape (2, ns, na).
            grown: All that hangs there by now [m], shape (2, ns, na): a layer that is older hangs on.

        Returns:
            What falls [m], shape (2, ns, na).
        """
        self._thickness *= self._sets ** max(0.0, now_s - self._now_s)
        self._now_s = now_s
        self._thickness += laid
        both = self._thickness.sum(axis=0)
        if not (both > self._holds).any():  # nor is then any mean over it
            return np.zeros(laid.shape)
        heavy = gaussian_filter(both, self._sigma) > self._holds
        falls = np.minimum(self._thickness * heavy, grown)
        self._thickness[:, heavy] = 0.0
        return np.asarray(falls)
