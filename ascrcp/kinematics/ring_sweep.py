"""Less acceleration by self-motion, pose by pose: a clear plan -> a gentler one (duct paper eq. 11, 12)."""

from dataclasses import replace

import numpy as np

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.gradient_projection import damped_inverse, pose_error
from ascrcp.kinematics.ring import RingPlan, Scene, round_trip

CORRECTIONS = 20
"""Most Newton steps back onto the poses."""


def find_acceleration(q: Array, dt: float) -> Array:
    """Return accelerations of joints (m, n) at the inner rows [rad/s2, m/s2], shape (m - 2, n)."""
    return np.asarray(np.diff(q, 2, axis=0) / dt**2)


def limit_acceleration(scene: Scene, plan: RingPlan) -> RingPlan:
    """Descend eq. 11 and 12 over the whole ring, each pose by its own self-motion, clearances kept.

    The paper adds this gradient while travelling, where only the past is known; a pose's acceleration
    also depends on the next, so the ring is swept again and again instead.

    Args:
        scene: What it is planned in.
        plan: A clear plan.
    """
    arm, p = scene.arm, scene.parameters
    bound = p.sweep.alpha * arm.max_acceleration
    T = plan.T[round_trip(len(plan.T))]
    q = plan.q
    for _ in range(p.sweep.sweeps):
        acceleration = find_acceleration(q, p.dt)
        excess = (acceleration - np.clip(acceleration, -bound, bound)) * p.dt**2
        if not excess.any():
            break
        slope = np.zeros_like(q)
        for shift, factor in enumerate((1.0, -2.0, 1.0)):
            slope[shift : shift + len(excess)] += factor * excess
        projector = damped_inverse(arm.jacobian(q), p.projection)[1]
        tried = _restore(scene, q - p.sweep.rate * (projector @ slope[..., None])[..., 0], T)
        clear = scene.body.measure(arm, tried, scene.duct).clearance.min(axis=1) >= p.margin
        q = np.where((clear & arm.within_limits(tried))[:, None], tried, q)
    return replace(plan, q=q)


def _restore(scene: Scene, q: Array, T: Array) -> Array:
    """Bring joints (m, n) back onto poses (m, 4, 4) by least steps."""
    for _ in range(CORRECTIONS):
        error = pose_error(scene.arm.forward(q), T)
        if np.abs(error).max() <= scene.parameters.projection.tolerance:
            return q
        inverse, _ = damped_inverse(scene.arm.jacobian(q), scene.parameters.projection)
        q = q + (inverse @ error[..., None])[..., 0]
    raise UnreachableError(f"{scene.duct.name}: a step of self-motion does not come back onto the poses")
