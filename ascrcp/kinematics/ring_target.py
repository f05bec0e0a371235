"""A ring of spray poses inside a duct, and the lever that tilts them (duct paper 3.2)."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array, transform, unit
from ascrcp.kinematics.duct import Duct
from ascrcp.kinematics.feedback import rotation_matrices, spread_tilt


@dataclass(frozen=True)
class Ring:
    """Poses once round a duct, the last followed by the first.

    Attributes:
        T: Tool poses, shape (n, 4, 4): z the spray direction, square to the wall in the section plane;
            y the lance, along the duct (errata 3.1).
        stand_off: Gun to wall [m].
    """

    T: Array
    stand_off: float


def make_ring(duct: Duct, station: float, count: int, stand_off: float) -> Ring:
    """Set poses round the section at a station, evenly by arc length from the contour's first point.

    Raises:
        InputError: A station outside the duct, or a stand-off the section has no room for.
    """
    outline, _, normal = duct.section(station)
    closed = np.vstack([outline, outline[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.arange(count) / count * length[-1]
    wall = np.column_stack([np.interp(at, length, closed[:, i]) for i in range(3)])
    vertex = unit(np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0))
    tangents = np.vstack([vertex, vertex[:1]])
    tangent = unit(np.column_stack([np.interp(at, length, tangents[:, i]) for i in range(3)]))
    outward = unit(np.cross(tangent, normal))
    lance = np.broadcast_to(normal, outward.shape)
    R = np.stack([np.cross(lance, outward), lance, outward], axis=2)
    position = wall - stand_off * outward
    room = duct.measure(position, np.zeros(count)).clearance
    if not (room > 0.99 * stand_off).all():
        raise InputError(
            f"{duct.name}: a stand-off of {stand_off:g} m leaves the gun {room.min():.3f} m from the wall "
            f"at station {station:g} m"
        )
    return Ring(transform(R, position), stand_off)


def tilt_ring(T: Array, tilt: Array) -> Array:
    """Turn poses (n, 4, 4) about their own guns by rotation vectors (n, 3) in the base frame [rad]."""
    turned = T.copy()
    turned[:, :3, :3] = rotation_matrices(tilt) @ T[:, :3, :3]
    return turned


def find_lever(joint: Array, gun: Array, escape: Array, amount: float) -> Array:
    """Find the turn about the gun that carries a joint towards the contour's centre (3.2, steps 1 to 3).

    Args:
        joint: The colliding joint's position [m], shape (3,).
        gun: The gun's, the fulcrum: the paper's midpoint would move the gun (errata 3.2).
        escape: e_m, shape (3,).
        amount: How far the joint is to go [m].

    Returns:
        Rotation vector e_m x e_a times the angle [rad], shape (3,).
    """
    lever = gun - joint
    length = float(np.linalg.norm(lever))
    axis = np.cross(unit(escape), lever / length)
    return np.asarray(amount / length * unit(axis))


def spread_round(tilt: Array, step: float) -> Array:
    """Spread tilts (n, 3) over their neighbours, `step` less each [rad], on over the ring's seam."""
    n = len(tilt)
    return spread_tilt(np.tile(tilt, (3, 1)), np.zeros(3 * n, dtype=np.int64), step)[n : 2 * n]
