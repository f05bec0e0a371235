"""Gradient projection for a redundant arm: pose -> joints that make a function small on the way.

Duct paper 1.2, 3.1 and 3.3 as errata 3.2 corrects them: the self-motion descends (the printed sign climbs),
the damping stands where it damps, and the projector is exact.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from ascrcp.core.config import Struct
from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.reason import explain_failure

Positive = Annotated[float, Meta(gt=0.0)]
Share = Annotated[float, Meta(gt=0.0, le=1.0)]

SMALL = 1e-12


class ProjectionParameters(Struct):
    """Numbers of eq. 8 to 17; config/duct.yaml says each one's source.

    Attributes:
        scale: lambda of eq. 13.
        damping: rho of eq. 17, where the least singular value reaches zero.
        damping_below: Singular value below which damping sets in.
        rest_step: Length of a self-motion step at a pose that is held [rad, m].
        weight_step: Delta k of eq. 9.
        weight_floor: Least weight after eq. 10.
        guard_deg: How far beyond the present angle eq. 8's new limit is laid.
        least_distance: Least distance to a limit counted, as a share of the range.
        largest_step: Largest step towards the pose [m, rad].
        tolerance: Miss of the pose at which it is reached [m, rad].
        iterations: Most steps for one pose.
    """

    scale: Positive
    damping: Positive
    damping_below: Positive
    rest_step: Positive
    weight_step: Positive
    weight_floor: Share
    guard_deg: Positive
    least_distance: Share
    largest_step: Positive
    tolerance: Positive
    iterations: Annotated[int, Meta(ge=1, le=10_000)]


@dataclass(frozen=True)
class LimitCost:
    """Liegeois's function (eq. 6) with limits and weights that collisions change (eq. 8 to 10).

    Attributes:
        lower, upper: Limits used [rad, m], shape (n,).
        weight: k of each joint, shape (n,).
        floor: Least distance counted [rad, m], shape (n,).
    """

    lower: Array
    upper: Array
    weight: Array
    floor: Array

    @classmethod
    def of(cls, arm: Arm, parameters: ProjectionParameters) -> "LimitCost":
        """Start from the arm's ranges and equal weights."""
        floor = parameters.least_distance * (arm.upper - arm.lower)
        return cls(arm.lower, arm.upper, np.ones(arm.n), floor)

    def value(self, q: Array) -> float:
        """Return sum k (max - min)^2 / ((max - q)(q - min)) at q (n,)."""
        high, low = self._room(q)
        return float((self.weight * (self.upper - self.lower) ** 2 / (high * low)).sum())

    def _room(self, q: Array) -> tuple[Array, Array]:
        """Distances to both limits, never less than the floor."""
        return np.maximum(self.upper - q, self.floor), np.maximum(q - self.lower, self.floor)

    def gradient(self, q: Array) -> Array:
        """Return the slope of `value` at q (n,), shape (n,)."""
        high, low = self._room(q)
        square = (self.upper - self.lower) ** 2
        return np.asarray(self.weight * square * (low - high) / (high * low) ** 2)

    def push(self, q: Array, joint: int, rise: bool, parameters: ProjectionParameters) -> "LimitCost":
        """Bar a joint's way back and weigh it more (eq. 8 to 10).

        Args:
            q: Present joints (n,).
            joint: Its index from 0.
            rise: Whether a growing joint leaves the wall; else a falling one does.
            parameters: Guard and weights.
        """
        guard = np.radians(parameters.guard_deg)
        lower, upper, weight = self.lower.copy(), self.upper.copy(), self.weight.copy()
        if rise:
            lower[joint] = max(lower[joint], q[joint] - guard)
        else:
            upper[joint] = min(upper[joint], q[joint] + guard)
        weight[joint] += parameters.weight_step
        spread = weight.max() - weight.min()
        weight = np.ones_like(weight) if spread < SMALL else (weight - weight.min()) / spread
        return replace(self, lower=lower, upper=upper, weight=np.maximum(weight, parameters.weight_floor))


def pose_error(T_now: Array, T_wanted: Array) -> Array:
    """Return the step from poses to poses (..., 4, 4): translation [m], rotation vector [rad], (..., 6)."""
    R = T_wanted[..., :3, :3] @ np.swapaxes(T_now[..., :3, :3], -1, -2)
    skew = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    sine = np.linalg.norm(skew, axis=-1, keepdims=True) / 2
    cosine = (np.trace(R, axis1=-2, axis2=-1)[..., None] - 1.0) / 2
    angle = np.arctan2(sine, cosine)
    turn = np.where(sine > 1e-9, angle / np.maximum(2 * sine, SMALL), 0.5) * skew
    return np.concatenate([T_wanted[..., :3, 3] - T_now[..., :3, 3], turn], axis=-1)


def damped_inverse(J: Array, parameters: ProjectionParameters) -> tuple[Array, Array]:
    """Invert a Jacobian (..., 6, n) with damping only near singular poses (eq. 17 corrected).

    Returns:
        J_rho+ (..., n, 6), and the exact projector I - J+ J onto the self-motion, (..., n, n).
    """
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    near = np.minimum(s[..., -1:] / parameters.damping_below, 1.0)
    square = parameters.damping**2 * (1.0 - near**2)
    V = np.swapaxes(Vt, -1, -2)
    inverse = (V * (s / (s**2 + square))[..., None, :]) @ np.swapaxes(U, -1, -2)
    return inverse, np.eye(J.shape[-1]) - V @ Vt


def approach(arm: Arm, q: Array, T_wanted: Array, cost: LimitCost, parameters: ProjectionParameters) -> Array:
    """Travel to a pose, the cost descending by self-motion on the way (eq. 14 with the factor of eq. 13).

    Args:
        arm: The arm.
        q: Joints to start from [rad, m], shape (n,).
        T_wanted: Pose of the tool, shape (4, 4).
        cost: What self-motion makes small.
        parameters: Step sizes.

    Raises:
        UnreachableError: The pose is not reached, or only outside the ranges.
    """
    for _ in range(parameters.iterations):
        error = pose_error(arm.forward(q), T_wanted)
        size = float(np.abs(error).max())
        if not size > parameters.tolerance:
            break
        step = error * min(1.0, parameters.largest_step / size)
        inverse, projector = damped_inverse(arm.jacobian(q), parameters)
        direct, free = inverse @ step, -projector @ cost.gradient(q)
        pace, pull = float(np.linalg.norm(direct)), float(np.linalg.norm(free))
        q = q + direct + parameters.scale * pace / max(pace + pull, SMALL) * free
    else:
        raise UnreachableError(f"{arm.name} does not reach a pose of the ring: {size:.3g} m or rad are left")
    if not bool(arm.within_limits(q)):
        raise UnreachableError(f"a pose of the ring is out of range: {explain_failure(arm, q)}")
    return q


def self_motion(arm: Arm, q: Array, cost: LimitCost, parameters: ProjectionParameters) -> Array:
    """Take one step of self-motion at rest, where eq. 13 would give none; the pose drifts by second order."""
    free = -damped_inverse(arm.jacobian(q), parameters)[1] @ cost.gradient(q)
    return np.asarray(q + parameters.rest_step * free / max(float(np.linalg.norm(free)), SMALL))
