"""Inverse of the muck-removal arm in closed form (errata 1.2, which corrects the paper's 2.1.2).

Signs, quadrants and the telescope are the errata's: the paper's arctan and arcsin lose branches and
its d4 is 0/0 for every pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.description import ArmDescription, DhRow, Prismatic
from ascrcp.kinematics.solution import root, wrap_into

SINGULAR = 1e-10
"""|sin(theta5)| below which only theta2 + theta3 -+ theta6 is fixed."""

STRAIGHT = 1e-3
"""Smallest |sin(theta5)| whose magnification of rounding is allowed for."""


@dataclass(frozen=True)
class BucketInverse:
    """Lengths k1..k5 [m] of table 1 and the ranges [rad, m]."""

    k1: float
    k2: float
    k3: float
    k4: float
    k5: float
    lower: Array
    upper: Array

    held: ClassVar[tuple[int, ...]] = ()

    @classmethod
    def fit(cls, description: ArmDescription) -> "BucketInverse | None":
        """Take the lengths from a description, or return None if its structure is another."""
        rows = [joint.dh for joint in description.joints]
        slides = [isinstance(joint, Prismatic) for joint in description.joints]
        if slides != [False, False, False, True, False, False] or any(description.tool):
            return None
        if any(row is None for row in rows):
            return None
        table = [row for row in rows if row is not None]
        k1, k2, k3, k4, k5 = table[0].d, table[0].a, table[1].a, table[4].d, table[5].a
        expected = [
            DhRow(d=k1, a=k2, alpha_deg=90.0),
            DhRow(a=k3),
            DhRow(alpha_deg=90.0),
            DhRow(),
            DhRow(d=k4, alpha_deg=90.0),
            DhRow(a=k5),
        ]
        if table != expected:
            return None
        joints = description.joints
        ranges = [j.range_m if isinstance(j, Prismatic) else np.radians(j.range_deg) for j in joints]
        lower, upper = np.array(ranges, dtype=float).T
        return cls(k1, k2, k3, k4, k5, lower, upper)

    def solve(self, T: Array, held: Sequence[Array], near: Array | None) -> Array:
        """Compute the eight candidates of each pose, joint first: (6, 8, N), NaN where not real."""
        n, o, a, p = (T[:, :3, j].T for j in range(4))
        w = p - self.k5 * n
        q = np.empty((6, 2, 2, 2, len(T)))  # joint, telescope, wrist, slew, pose
        half_turn = np.array([[0.0], [np.pi]])
        th1 = np.arctan2(w[1], w[0]) + half_turn
        c1, s1 = np.cos(th1), np.sin(th1)
        nt, ot, at = (s1 * v[0] - c1 * v[1] for v in (n, o, a))  # z1 = (s1, -c1, 0)
        sine = np.hypot(nt, ot)
        sign = np.array([[[1.0]], [[-1.0]]])
        th5 = np.arctan2(sign * sine, -at)
        free = near[:, 5] if near is not None else np.full(len(T), (self.lower[5] + self.upper[5]) / 2)
        th6 = np.where(sine < SINGULAR, free, np.arctan2(-sign * ot, sign * nt))
        s6, c6 = np.sin(th6), np.cos(th6)
        z3 = [s6 * n[i] + c6 * o[i] for i in range(3)]
        ur, uz = z3[0] * c1 + z3[1] * s1, z3[2]
        ar, az = w[0] * c1 + w[1] * s1 - self.k2, w[2] - self.k1
        dot = ar * ur + az * uz
        square = ar * ar + az * az
        radicand = self.k3**2 - square + dot * dot
        # a nearly straight wrist passes its rounding on to u, magnified
        scale = (square + self.k3**2) / np.where(sine < SINGULAR, 1.0, np.maximum(sine, STRAIGHT))
        length = dot + sign[..., None] * root(radicand, scale)
        th2 = np.arctan2(az - length * uz, ar - length * ur)
        th3 = np.arctan2(ur, -uz) - th2
        for i, value in enumerate((th1, th2, th3, length - self.k4, th5, th6)):
            q[i] = value if i == 3 else wrap_into(value, self.lower[i], self.upper[i])
        return q.reshape(6, 8, -1)
