"""Misses of a machine against measured tip positions, in sigmas, and the robust fit that shrinks them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.config import Struct
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.description import Positive
from ascrcp.kinematics.observation import Observations
from ascrcp.kinematics.parameter import Parameter, change_description, derive_position, zero_change
from ascrcp.kinematics.sag import sagged_forward

CHI3_MEDIAN = 1.538
"""Median length of a 3-vector of unit normal numbers: turns a median miss into a sigma."""

HUBER = 2.0
"""Misses beyond this many sigma pull with constant force while blunders are looked for."""

FINEST = 0.1
"""Least scale of the misses, as a share of the noise assumed: exact data have no blunders."""

LONGEST = 3.0
"""Longest step of a fit, in units of the expected errors: farther off the model is not linear."""

LOOSE = 4.0
"""Sigma of the file's values in units of the expected errors; that of the sag's exponent is 1."""

STEPS = 60
CONVERGED = 1e-10
"""Relative gain at which a fit ends."""


class Noise(Struct):
    """What a perfect model would still miss by, one sigma or one step."""

    sensor_step_deg: Positive
    sensor_step_mm: Positive
    survey_mm: Positive


@dataclass(frozen=True)
class Problem:
    """Observations of one arm and the parameters to fit; x are changes in units of `expected`."""

    arm: Arm
    seen: Observations
    parameters: tuple[Parameter, ...]
    noise: Noise

    @cached_property
    def scale(self) -> Array:
        """Expected size of each parameter's error, shape (k,)."""
        return np.array([p.expected for p in self.parameters])

    @cached_property
    def prior(self) -> Array:
        """Weight of the file's values: each counts as one observation, a few expected errors its sigma.

        Next to what a survey tells that is nothing; where two parameters do nearly the same (sag and
        the height of joint 2) it keeps both from running off in opposite directions. Shape (k,).
        """
        return np.array([1.0 if p.key == "exponent" else 1.0 / LOOSE**2 for p in self.parameters])

    @cached_property
    def whiten(self) -> Array:
        """Matrices that turn misses into multiples of their sigma, shape (n, 3, 3)."""
        step = np.where(
            self.arm.prismatic, self.noise.sensor_step_mm / 1e3, np.radians(self.noise.sensor_step_deg)
        )
        J = self.arm.jacobian(self.seen.q)[:, :3] @ np.linalg.inv(self.arm.limit_matrix)
        spread = (J * (step**2 / 12.0)) @ np.swapaxes(J, 1, 2)  # a step's error is uniform
        return np.linalg.inv(np.linalg.cholesky(spread + (self.noise.survey_mm / 1e3) ** 2 * np.eye(3)))

    def changed(self, x: Array) -> tuple[Arm, Array]:
        """Return the changed arm and the joints as its sensors should have read them."""
        change = x * self.scale
        arm = Arm(change_description(self.arm.description, self.parameters, change))
        return arm, self.seen.q + zero_change(self.arm, self.parameters, change)

    def miss(self, x: Array) -> Array:
        """Measured less computed tip positions [m], shape (n, 3)."""
        arm, q = self.changed(x)
        return np.asarray(self.seen.position - sagged_forward(arm, q, self.seen.payload_kg)[:, :3, 3])

    def whitened(self, x: Array) -> Array:
        """Misses in sigmas, shape (n, 3)."""
        return np.asarray((self.whiten @ self.miss(x)[..., None])[..., 0])

    def design(self, x: Array) -> Array:
        """Derivative of the tip positions in sigmas by x, shape (n, 3, k)."""
        arm, q = self.changed(x)
        return np.asarray(
            self.whiten @ derive_position(arm, q, self.seen.payload_kg, self.parameters) * self.scale
        )

    def pick(self, rows: NDArray[np.bool_]) -> "Problem":
        """Return the problem of some rows."""
        return Problem(self.arm, self.seen.pick(rows), self.parameters, self.noise)


def fit(problem: Problem, x: Array | None = None, threshold: float = np.inf) -> Array:
    """Minimise the squared misses in sigmas (Levenberg-Marquardt), Huber's loss beyond a threshold."""
    x = np.zeros(len(problem.parameters)) if x is None else x
    if not len(x):
        return x
    damping = 1e-6
    r = problem.whitened(x)
    cost = _cost(r, threshold) + _stay(problem, x)
    for _ in range(STEPS):
        A = problem.design(x)
        weight = np.minimum(1.0, threshold / np.maximum(np.linalg.norm(r, axis=1), 1e-12))
        WA = weight[:, None, None] * A
        normal = np.einsum("nij,nik->jk", WA, A) + np.diag(problem.prior)
        pull = np.einsum("nij,ni->j", WA, r) - problem.prior * x
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), pull)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max()), LONGEST))
        trial = problem.whitened(x + step)
        reached = _cost(trial, threshold) + _stay(problem, x + step)
        if not reached <= cost:
            damping *= 10.0
            continue
        gain, cost, x, r = cost - reached, reached, x + step, trial
        damping = max(damping / 10.0, 1e-12)
        if gain <= CONVERGED * cost:
            break
    return x


def _stay(problem: Problem, x: Array) -> float:
    """Cost of leaving the file's values."""
    return float(0.5 * (problem.prior * x * x).sum())


def _cost(r: Array, threshold: float) -> float:
    """Huber's loss of rows (n, 3)."""
    size = np.linalg.norm(r, axis=1)
    near = np.minimum(size, threshold)
    return float((near * (size - near / 2.0)).sum())


def find_scale(r: Array) -> float:
    """Estimate the sigma of misses (n, 3) from their median, which blunders do not move."""
    return max(float(np.median(np.linalg.norm(r, axis=1))) / CHI3_MEDIAN, FINEST)
