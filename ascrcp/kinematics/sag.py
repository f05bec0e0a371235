"""Static sag of the tip: rigid pose -> pose under gravity, and the rigid target that makes up for it.

The law is that of a cantilever: with r the tip's horizontal distance from the base origin,

    sag(r) = (own + load * payload) (r / reference)^exponent,   pitch(r) = slope_ratio * sag / r

The tip drops by sag along base -z and its frame pitches down about the horizontal axis square to the
reach. Thesis 2.3 blames this for the Z errors of its table 2-1 and leaves them in (errata 0).
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.description import SagModel

if TYPE_CHECKING:
    from ascrcp.kinematics.arm import Arm

MAX_PAYLOAD_KG = 2000.0
"""Above this a payload is a mistake of units: the full hose of thesis 6.2.3 weighs 181 kg."""


def compute_sag(model: SagModel, reach: Array, payload_kg: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Compute sag and pitch at horizontal reaches.

    Args:
        model: Coefficients.
        reach: Horizontal distance of the tip from the base origin [m], shape (...).
        payload_kg: Concrete in the hose [kg], scalar or shape (...).

    Returns:
        Drop along base -z [m] and downward pitch [rad], each shape (...).

    Raises:
        InputError: A payload that is negative, huge or not finite.
    """
    payload = np.asarray(payload_kg, dtype=float)
    allowed = (payload >= 0.0) & (payload <= MAX_PAYLOAD_KG)
    if not allowed.all():
        worst = float(payload[~allowed].flat[0])
        raise InputError(f"payload {worst:g} kg, allowed 0..{MAX_PAYLOAD_KG:g}")
    full = (model.own_mm + model.load_mm_per_kg * payload) / 1000.0
    share = reach / model.reference_reach
    drop = full * share**model.exponent
    pitch = model.slope_ratio * drop / np.maximum(reach, 1e-9)
    return drop, pitch


def sagged_forward(arm: "Arm", q: ArrayLike, payload_kg: ArrayLike = 0.0) -> Array:
    """Compute where gravity takes the tool: forward(q) dropped and pitched, shape (..., 4, 4)."""
    return _bend(arm, arm.forward(q), payload_kg, 1.0)


def sagged_lidar(arm: "Arm", q: ArrayLike, payload_kg: ArrayLike = 0.0) -> Array:
    """Compute where gravity takes the lidar's mount, shape (..., 4, 4): the law at the mount's own reach.

    Raises:
        InputError: The machine carries no lidar, or a bad q or payload.
    """
    return _bend(arm, arm.lidar(q), payload_kg, 1.0)


def compensate(arm: "Arm", T: Array, payload_kg: ArrayLike = 0.0) -> Array:
    """Find the rigid target whose sagged pose is T.

    Sag moves the tip along z only and the law looks at its horizontal reach only, so the fixed
    point is reached at once and is exact.

    Args:
        arm: The arm; without a sag model T comes back unchanged.
        T: Wanted poses, shape (..., 4, 4).
        payload_kg: Concrete in the hose [kg], scalar or shape (...).

    Returns:
        T' with sagged(T') = T, shape (..., 4, 4).
    """
    return _bend(arm, np.asarray(T, dtype=float), payload_kg, -1.0)


def _bend(arm: "Arm", T: Array, payload_kg: ArrayLike, sign: float) -> Array:
    model = arm.description.sag
    if model is None:
        return T
    x, y = T[..., 0, 3], T[..., 1, 3]
    reach = np.hypot(x, y)
    drop, pitch = compute_sag(model, reach, payload_kg)
    safe = np.maximum(reach, 1e-9)
    ux, uy = x / safe, y / safe
    s, c = np.sin(sign * pitch), np.cos(sign * pitch)
    bent = T.copy()
    for column in range(3):
        along = ux * T[..., 0, column] + uy * T[..., 1, column]
        up = T[..., 2, column]
        change = (c - 1.0) * along + s * up
        bent[..., 0, column] += ux * change
        bent[..., 1, column] += uy * change
        bent[..., 2, column] = c * up - s * along
    bent[..., 2, 3] -= sign * drop
    return bent
