"""Fuzzy PID of one joint: gains corrected by error and its rate (thesis 5.1.2, tables 5-3 to 5-5)."""

import math
from functools import cache

import numpy as np

from ascrcp.control.config import JointConfig
from ascrcp.control.joint import Ramp, Want
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.geometry import Array

_NAMES = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")

# Rows: rate of the error, columns: error, both NB..PB. The thesis heads only the columns, with ERROR.
RULES_KP = (
    "PB PB PM PM PS ZO ZO",
    "PB PB PM PS PS ZO NS",
    "PM PM PM PS ZO NS NS",
    "PM PM PS ZO NS NM NM",
    "PS PS ZO NS NS NM NB",
    "PS ZO NS NM NM NM NB",
    "ZO ZO NM NM NM NB NB",
)
RULES_KI = (
    "NB NB NM NM NS ZO ZO",
    "NB NB NM NS NS ZO NS",
    "NB NM NM NS ZO PS PS",
    "NM NM NS ZO PS PM PM",
    "NM NS ZO PS PS PM PB",
    "ZO ZO PS PS PM PB PB",
    "ZO ZO PS PM PM PB PB",
)
RULES_KD = (
    "PS NS NB NB NB NM PS",
    "PS NS NB NM NM NS ZO",
    "ZO NS NM NM NS NS ZO",
    "ZO NS NS NS NS NS ZO",
    "ZO ZO ZO ZO ZO ZO ZO",
    "PB NS PS PS PS PS PB",
    "PB PM PM PM PS PS PB",
)

_CENTRES = np.arange(-3.0, 4.0)
_OUTPUT = np.linspace(-4.0, 4.0, 161)
_NODES = np.linspace(-3.0, 3.0, 25)


def membership(value: Array | float) -> Array:
    """Compute how far values belong to NB..PB: triangles at -3..3, shoulders outside; shape (..., 7)."""
    x = np.clip(np.asarray(value, dtype=float), -3.0, 3.0)[..., None]
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(x - _CENTRES)))


def infer(rules: tuple[str, ...], error: float, rate: float) -> float:
    """Infer one correction: Mamdani's minimum and maximum, centre of area.

    Args:
        rules: One of the three tables.
        error: Error in units of its fuzzy set, -3..3.
        rate: Rate of the error likewise.

    Returns:
        Correction in units of the output's fuzzy set, -3..3.
    """
    table = np.array([[_NAMES.index(name) for name in row.split()] for row in rules])
    strength = np.minimum(membership(rate)[:, None], membership(error)[None, :])
    degree = np.array([strength[table == k].max(initial=0.0) for k in range(7)])
    shapes = np.maximum(0.0, 1.0 - np.abs(_OUTPUT[None, :] - _CENTRES[:, None]))
    area = np.minimum(shapes, degree[:, None]).max(axis=0)
    return float((area * _OUTPUT).sum() / area.sum())


@cache
def tabulate(rules: tuple[str, ...]) -> list[list[float]]:
    """Infer on a grid of rate and error, for the 20 ms cycle to interpolate in."""
    return [[infer(rules, float(e), float(r)) for e in _NODES] for r in _NODES]


class FuzzyControl:
    """Position PID whose three gains the rules correct every cycle."""

    def __init__(self, config: JointConfig) -> None:
        self._config = config.fuzzy
        self._si = config.si
        self._ramp = Ramp(config.ramp)
        self._tables = tuple(tabulate(rules) for rules in (RULES_KP, RULES_KI, RULES_KD))
        self.position = 0.0
        self._integral = self._rate = 0.0
        self._last: float | None = None

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle; see JointControl."""
        self.position = want.measured
        error = want.error / self._si
        if want.wait or not abs(error) < math.inf:
            return self._ramp.toward(0.0 if want.wait else math.nan)
        c = self._config
        change = 0.0 if self._last is None else (error - self._last) / CYCLE_S
        self._last = error
        self._rate += c.rate_share * (change - self._rate)  # a stepping sensor makes bare differences useless
        dp, di, dd = self._corrections(3.0 * error / c.error, 3.0 * self._rate / c.rate)
        kp = max(0.0, c.kp + c.kp_span * dp / 3.0)
        ki = max(0.0, c.ki + c.ki_span * di / 3.0)
        kd = max(0.0, c.kd + c.kd_span * dd / 3.0)
        self._integral = max(-c.integral_max, min(c.integral_max, self._integral + ki * error * CYCLE_S))
        return self._ramp.toward(kp * error + self._integral + kd * self._rate)

    def _corrections(self, error: float, rate: float) -> tuple[float, float, float]:
        """Interpolate the three tables."""
        last = len(_NODES) - 1
        x, y = ((max(-3.0, min(3.0, v)) + 3.0) / 6.0 * last for v in (error, rate))
        i, k = min(int(x), last - 1), min(int(y), last - 1)
        fx, fy = x - i, y - k
        found = []
        for table in self._tables:
            low = table[k][i] * (1.0 - fx) + table[k][i + 1] * fx
            high = table[k + 1][i] * (1.0 - fx) + table[k + 1][i + 1] * fx
            found.append(low * (1.0 - fy) + high * fy)
        return found[0], found[1], found[2]

    def clear(self) -> None:
        """Forget the past."""
        self._ramp.clear()
        self._integral = self._rate = 0.0
        self._last = None
