"""Let the joints of a steering mesh change as little as can be from node to node, the poses held.

Passes are solved one after the other, so that neighbouring nodes of two passes may reach almost the same
pose with far different joints; crossing over would be all self-motion. The redundancy is free: joints
that minimise sum |q_i - q_j|^2 / distance over the edges are found and brought back onto the poses, in turn.
"""

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.steer_pose import find_joints
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm

ROUNDS = 12
"""Smoothing and return to the poses in turn; after so many little changes any more."""

HOLD = 0.02
"""Pull toward the joints of the round before, against that of one edge of a metre: keeps strips that
nothing joins where they were, and the rest near enough for Newton's steps."""

MISS = 1e-3
"""A node that cannot be brought back onto its pose keeps its joints [m + rad]."""


def relax_joints(
    arm: Arm,
    q: Array,
    position: Array,
    direction: Array,
    edges: NDArray[np.int64],
    payload_kg: float = 0.0,
) -> Array:
    """Smooth joints over a mesh.

    Args:
        arm: The arm.
        q: Joints that reach the poses [rad, m], shape (n, joints).
        position: Nozzle of each node [m], shape (n, 3).
        direction: Its spray direction, shape (n, 3).
        edges: Pairs of nodes between which the nozzle may move, shape (m, 2).
        payload_kg: Concrete in the hose [kg].

    Returns:
        Joints that reach the same poses, within the ranges if those given were, shape (n, joints).
    """
    import scipy.sparse as sp  # not where a plan is only followed: the application starts sooner
    from scipy.sparse.linalg import splu

    if not len(edges) or not len(q):
        return q
    n = len(q)
    a, b = edges.T
    length = np.maximum(np.linalg.norm(position[a] - position[b], axis=1), 1e-3)
    weight = 1.0 / length
    W = sp.coo_matrix((np.tile(weight, 2), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    laplacian = sp.diags(np.asarray(W.sum(axis=1)).ravel()) - W
    solver = splu((laplacian + HOLD * sp.identity(n)).tocsc())
    for _ in range(ROUNDS):
        smooth = solver.solve(HOLD * q)
        found, miss = find_joints(arm, smooth, position, direction, payload_kg)
        good = (miss <= MISS) & arm.within_limits(found)
        q = np.where(good[:, None], found, q)
    return q
