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
from ascrcp.kinematics.solution import MEETING, ON_AXIS, leg, settle, wrap_into

SINGULAR = 1e-10
"""|sin(theta5)| below which only theta2 + theta3 -+ theta6 is fixed."""

CLOSE_TO_AXIS = 1e-6
"""Distance of the wrist from the slew axis [m] below which rounding makes its direction rough."""

LARGEST_SLACK = 3e-11
"""Most that rounding is allowed to have moved the elbow by [m]: solutions are held to 1e-10 m."""


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
    middle: ClassVar[int] = 3

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

    def solve(self, P: Array, held: Sequence[Array], near: Array | None) -> list[Array]:
        """Compute the eight candidates of each pose: telescope 2 x wrist 2 x slew 2.

        Args:
            P: Components of the poses, shape (3, 4, N).
            held: None.
            near: Joint vectors whose slew and bucket settle a pose that leaves them free, (N, 6).

        Returns:
            One array per joint [rad, m], NaN where not real, each broadcasting to (2, 2, 2, N).
        """
        n, o, a, p = (P[:, j] for j in range(4))
        w = [p[i] - self.k5 * n[i] for i in range(3)]
        with np.errstate(divide="ignore", invalid="ignore"):
            th1, s1, c1, radius = self._solve_slew(w, near)
            nt, ot, at = (s1 * v[0] - c1 * v[1] for v in (n, o, a))  # z1 = (s1, -c1, 0)
            sine = np.sqrt(nt * nt + ot * ot)
            sign = np.array([[[1.0]], [[-1.0]]])
            th5 = np.arctan2(sign * sine, -at)
            s6, c6 = -sign * ot / sine, sign * nt / sine
            th6 = np.arctan2(s6, c6)
            straight = sine < SINGULAR
            if straight.any():  # only theta2 + theta3 -+ theta6 is fixed
                free = (self.lower[5] + self.upper[5]) / 2 if near is None else near[:, 5]
                th6 = np.where(straight, free, th6)
                s6, c6 = np.where(straight, np.sin(th6), s6), np.where(straight, np.cos(th6), c6)
            z3 = [s6 * n[i] + c6 * o[i] for i in range(3)]
            ur, uz = z3[0] * c1 + z3[1] * s1, z3[2]
            ar, az = w[0] * c1 + w[1] * s1 - self.k2, w[2] - self.k1
            th2, th3, length = self._solve_boom(ar, az, ur, uz, sine, radius)
        angles = [
            wrap_into(value, self.lower[i], self.upper[i])
            for i, value in ((0, th1), (1, th2), (2, th3), (4, th5), (5, th6))
        ]
        return [*angles[:3], length - self.k4, *angles[3:]]

    def _solve_slew(self, w: Sequence[Array], near: Array | None) -> tuple[Array, Array, Array, Array]:
        """Turn the arm's plane through the wrist: theta1, sine, cosine (2, N); distance (N,)."""
        radius = np.sqrt(w[0] * w[0] + w[1] * w[1])
        on_axis = radius <= ON_AXIS
        th1, s1, c1 = np.arctan2(w[1], w[0]), w[1] / radius, w[0] / radius
        free: Array | float = 0.0
        if near is not None:
            free = near[:, 0]
            # close by, a reference whose plane holds the wrist is as good as the direction and less rough
            aside = np.abs(np.cos(free) * w[1] - np.sin(free) * w[0])
            on_axis |= (radius <= CLOSE_TO_AXIS) & (aside <= ON_AXIS)
        if on_axis.any():  # the slew is free
            th1 = np.where(on_axis, free, th1)
            s1, c1 = np.where(on_axis, np.sin(th1), s1), np.where(on_axis, np.cos(th1), c1)
        sign = np.array([[1.0], [-1.0]])
        radius = np.where(on_axis, 1.0, radius)  # a slew that is settled carries no rounding
        return th1 + np.array([[0.0], [np.pi]]), sign * s1, sign * c1, radius

    def _solve_boom(
        self, ar: Array, az: Array, ur: Array, uz: Array, sine: Array, radius: Array
    ) -> tuple[Array, Array, Array]:
        """Solve the triangle of boom and fore-arm: theta2, theta3 and the fore-arm's length, (2, 2, 2, N)."""
        dot, off = ar * ur + az * uz, np.abs(ar * uz - az * ur)
        # a nearly straight wrist, or one near the slew axis, passes its rounding on to u, magnified
        close = np.where(sine < SINGULAR, 1.0, sine) * np.minimum(radius, 1.0)
        slack = np.clip(MEETING / close, MEETING, LARGEST_SLACK)
        off = settle(off, np.full_like(off, self.k3), slack)
        length = dot + leg(np.full_like(off, self.k3), off) * np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
        th2 = np.arctan2(az - length * uz, ar - length * ur)
        return th2, np.arctan2(ur, -uz) - th2, length
