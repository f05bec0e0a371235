"""What hangs and knocks on the boom: payload, concrete in the hose, bumps."""

import math

import numpy as np

from ascrcp.simulation.parameter import BumpConfig, HoseConfig


class Burden:
    """Payload that changes while concrete flows, and knocks at random.

    Attributes:
        kg: Payload now [kg].
    """

    def __init__(
        self, hose: HoseConfig, bump: BumpConfig, payload_kg: float, rng: np.random.Generator
    ) -> None:
        self._hose = hose
        self._bump = bump
        self._rng = rng
        self._base = self.kg = payload_kg
        self._filled = 0.0
        self._next_s = float(rng.exponential(bump.interval_s))

    def set(self, payload_kg: float) -> None:
        """Hang another payload on from now on [kg]."""
        self._base = payload_kg

    def advance(self, flow: float, stroke: float, step_s: float) -> tuple[float, float]:
        """Advance one step.

        Args:
            flow: Concrete flow, fraction 0..1.
            stroke: Where the pump is in its stroke, 0..1.
            step_s: Step [s].

        Returns:
            Knock on the boom in this step, up and sideways [m/s]; nearly always nothing.
        """
        hose = self._hose
        self._filled += (1.0 - self._filled) * min(1.0, flow * step_s / hose.fill_s)
        surge = hose.surge_kg * flow * math.sin(2.0 * math.pi * stroke)
        self.kg = max(0.0, self._base + hose.fill_kg * self._filled + surge)
        self._next_s -= step_s
        if self._next_s > 0.0:
            return 0.0, 0.0
        self._next_s += float(self._rng.exponential(self._bump.interval_s))
        up, aside = (self._bump.speed * self._rng.standard_normal(2)).tolist()
        return up, aside
