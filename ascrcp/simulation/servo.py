"""The electro-hydraulic position loop of the second paper's figure 10: opening in percent -> angle.

Valve and cylinder with load are of second order, the cylinder integrates (errata 2); advanced exactly
for a held opening.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

VALVE_HZ, VALVE_DAMPING = 9.0, 0.7
GAIN = 0.325
"""Speed per opening [deg/s per %]."""

LOAD_HZ, LOAD_DAMPING = 9.0, 0.5
MOST = 100.0
"""Largest opening [%]."""


@dataclass
class Servo:
    """Valve w^2 / (s^2 + 2 z w s + w^2), then K / s * w^2 / (s^2 + 2 z w s + w^2)."""

    period_s: float = 0.01

    def __post_init__(self) -> None:
        wv, wh = 2.0 * math.pi * VALVE_HZ, 2.0 * math.pi * LOAD_HZ
        system = np.zeros((6, 6))
        system[0, 1] = system[2, 3] = system[4, 2] = 1.0
        system[1, [0, 1, 5]] = -wv * wv, -2.0 * VALVE_DAMPING * wv, wv * wv
        system[3, [2, 3, 0]] = -wh * wh, -2.0 * LOAD_DAMPING * wh, GAIN * wh * wh
        self._held = expm(system * self.period_s)
        self._state = np.zeros(6)

    @property
    def angle_deg(self) -> float:
        """Angle reached [deg]."""
        return float(self._state[4])

    def advance(self, opening: float) -> None:
        """Hold an opening [%] for one period."""
        self._state[5] = max(-MOST, min(MOST, opening))
        self._state = self._held @ self._state
