"""Inverse of the shotcrete arm in closed form, joints 5 and 6 held (thesis 2.2, design.md section 3).

With beta = q2 + q4 the inclination of the lance, the chain reads, after the slew is taken off,

    R  = Ry(-beta) Rz(q5) Rx(q7) Rz(q8)
    w  = a2 + Ry(-q2) (a3 + a4 + (q3, 0, 0)) + Ry(-beta) (a5 + Rz(q5) (a6 + a7 + a8 + (q6, 0, 0)))

with w the wrist centre (origin of joint 8) and a_i the translation of step i. Slew 2 x nozzle roll 2 x
boom 2 gives at most eight real solutions; the thesis counts 16 algebraic candidates (errata 0).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.chain import sine_cosine
from ascrcp.kinematics.description import ArmDescription, Prismatic
from ascrcp.kinematics.solution import MEETING, ON_AXIS, leg, settle, wrap_into

STRUCTURE = ("z", "-y", "x slides", "-y", "z", "x slides", "x", "z")
"""Axes of the eight steps this closed form is for."""

SINGULAR = 2e-12
"""Sine of the angle between tilt axis and pitch axes below which they count as parallel; taking them
for parallel then misses the pose by no more."""


LARGEST_SLACK = 3e-12
"""Most that rounding is allowed to have turned the wrist by: solutions are held to 1e-10 m at 8 m."""


@dataclass(frozen=True)
class SprayInverse:
    """Geometry the closed form needs, taken from the machine file.

    Attributes:
        base: Translation of step 1 [m], shape (3,).
        boom: Joint 2 after the slew [m], shape (3,).
        elbow: Joint 4 from joint 2 with the boom telescope at zero [m], shape (3,).
        yaw: Joint 5 from joint 4 [m], shape (3,).
        lance: Joint 8 from joint 5 with the lance telescope at zero [m], shape (3,).
        tool: Nozzle from joint 8 [m], shape (3,).
        lower, upper: Ranges as the file states them [rad, m]; joint 4's may be the lance's.
        limits_lance: Whether joint 4's range is that of q2 + q4.
    """

    base: Array
    boom: Array
    elbow: Array
    yaw: Array
    lance: Array
    tool: Array
    lower: Array
    upper: Array
    limits_lance: bool

    held: ClassVar[tuple[int, ...]] = (5, 6)
    middle: ClassVar[int] = 4

    @classmethod
    def fit(cls, description: ArmDescription) -> "SprayInverse | None":
        """Take the geometry from a description, or return None if its structure is another."""
        joints = description.joints
        axes = tuple(f"{j.axis}{' slides' if isinstance(j, Prismatic) else ''}" for j in joints)
        if axes != STRUCTURE or any(j.translate is None for j in joints):
            return None
        a = np.array([j.translate for j in joints])
        if a[7, 1] != 0.0 or a[7, 2] != 0.0:  # joint 8 must sit on the roll axis
            return None
        ranges = [j.range_m if isinstance(j, Prismatic) else np.radians(j.range_deg) for j in joints]
        lower, upper = np.array(ranges, dtype=float).T
        return cls(
            base=a[0],
            boom=a[1],
            elbow=a[2] + a[3],
            yaw=a[4],
            lance=a[5] + a[6] + a[7],
            tool=np.array(description.tool),
            lower=lower,
            upper=upper,
            limits_lance=tuple(joints[3].limit_sum) == (2, 4),
        )

    def solve(self, P: Array, held: Sequence[Array], near: Array | None) -> list[Array]:
        """Compute the eight candidates of each pose: boom 2 x roll 2 x slew 2.

        A lance yawed by exactly 90 deg, beyond any range, has its roll axis parallel to the pitch axes
        and gives no candidate.

        Args:
            P: Components of the poses, shape (3, 4, N).
            held: q5 [rad] and q6 [m], each shape (N,).
            near: Joint vectors whose slew and lance inclination settle a pose that leaves them free,
                shape (N, 8).

        Returns:
            One array per joint [rad, m], NaN where not real, each broadcasting to (2, 2, 2, N).
        """
        q5, q6 = held
        s5, c5 = sine_cosine(q5)
        stretched = self.lance[0] + q6
        lance_x = self.yaw[0] + c5 * stretched - s5 * self.lance[1]
        lance_z = self.yaw[2] + self.lance[2]
        lateral = self.boom[1] + self.elbow[1] + self.yaw[1] + s5 * stretched + c5 * self.lance[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            q1, forward, height, R1 = self._solve_slew(P, lateral, near)
            # a slew near its own fold passes rounding on to the wrist, magnified
            slack = np.clip(MEETING / np.abs(forward), MEETING, LARGEST_SLACK)
            q7, q8, beta, c_beta, s_beta = self._solve_wrist(R1, s5, c5, slack, near)
            x = forward - self.boom[0] - (c_beta * lance_x - s_beta * lance_z)
            z = height - self.boom[2] - (s_beta * lance_x + c_beta * lance_z)
            q2, q3, q4 = self._solve_boom(x, z, beta, 10.0 * slack)
        return [q1, q2, q3, q4, q5, q6, q7, q8]

    def _solve_slew(
        self, P: Array, lateral: Array, near: Array | None
    ) -> tuple[Array, Array, Array, list[list[Array]]]:
        """Wrist centre from the tool offset; slew from the constant lateral offset.

        Returns:
            q1 (2, N), forward distance of the wrist in the slewed frame (2, N), its height (N,), and
            the rotation with the slew taken off, nine components.
        """
        wx, wy, wz = (
            row[3] - (row[0] * self.tool[0] + row[1] * self.tool[1] + row[2] * self.tool[2]) - base
            for row, base in zip(P, self.base, strict=True)
        )
        radius = np.sqrt(wx * wx + wy * wy)
        settled = settle(radius, np.abs(lateral))
        forward = leg(settled, np.abs(lateral)) * np.array([[1.0], [-1.0]])
        size = radius * settled
        c1, s1 = (wx * forward + wy * lateral) / size, (wy * forward - wx * lateral) / size
        q1 = np.arctan2(s1, c1)
        on_axis = (radius <= ON_AXIS) & (np.abs(lateral) <= ON_AXIS)
        if on_axis.any():  # the slew is free
            free = 0.0 if near is None else near[:, 0]
            q1 = np.where(on_axis, free + np.array([[0.0], [np.pi]]), q1)
            c1, s1 = np.where(on_axis, np.cos(q1), c1), np.where(on_axis, np.sin(q1), s1)
        R1 = [
            [c1 * P[0, j] + s1 * P[1, j] for j in range(3)],
            [c1 * P[1, j] - s1 * P[0, j] for j in range(3)],
            [P[2, j] for j in range(3)],
        ]
        return wrap_into(q1, self.lower[0], self.upper[0]), forward, wz, R1

    def _solve_wrist(
        self, R1: list[list[Array]], s5: Array, c5: Array, slack: Array, near: Array | None
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Roll and lance inclination from the third column, tilt from what is left.

        Where the tilt axis is parallel to the pitch axes (q5 = 0, q7 = +-90 deg) only
        beta + q8 is fixed; `near`, else the middle of the tilt's range, settles beta.

        Returns:
            q7, q8, beta, cos(beta), sin(beta), each shape (2 roll, 2 slew, N).
        """
        (r1x, _, r3x), (r1y, _, r3y), (r1z, _, r3z) = R1
        across = np.sqrt(r3x * r3x + r3z * r3z)  # of the tilt axis, to the pitch axes
        settled = settle(across, np.abs(s5), slack)
        singular = settled <= SINGULAR
        s7 = -r3y / c5
        c7 = leg(settled, np.abs(s5)) / np.abs(c5) * np.array([[[1.0]], [[-1.0]]])
        along, size = s5 * s7, across * settled
        c_beta, s_beta = (r3x * along + r3z * c7) / size, (r3z * along - r3x * c7) / size
        beta = np.arctan2(s_beta, c_beta)
        if singular.any():
            c7 = np.where(singular, 0.0, c7)
            beta = np.where(singular, self._free_inclination(R1, s7, near), beta)
            c_beta, s_beta = (
                np.where(singular, np.cos(beta), c_beta),
                np.where(singular, np.sin(beta), s_beta),
            )
        x, z = c_beta * r1x + s_beta * r1z, c_beta * r1z - s_beta * r1x
        q7 = wrap_into(np.arctan2(s7, c7), self.lower[6], self.upper[6])
        q8 = np.arctan2(c7 * (c5 * r1y - s5 * x) + s7 * z, c5 * x + s5 * r1y)
        if self.limits_lance:
            beta = wrap_into(beta, self.lower[3], self.upper[3])
        return q7, wrap_into(q8, self.lower[7], self.upper[7]), beta, c_beta, s_beta

    def _free_inclination(self, R1: list[list[Array]], s7: Array, near: Array | None) -> Array:
        """Choose the lance inclination of a singular pose: near's, else tilt at mid range."""
        if near is not None:
            return near[:, 1] + near[:, 3]
        # q5 = 0, c7 = 0: the tool's x axis is inclined by beta + s7 q8
        inclined = np.arctan2(R1[2][0], R1[0][0])
        beta = wrap_into(inclined - s7 * (self.lower[7] + self.upper[7]) / 2, self.lower[3], self.upper[3])
        return np.clip(beta, self.lower[3], self.upper[3])

    def _solve_boom(self, x: Array, z: Array, beta: Array, slack: Array) -> tuple[Array, Array, Array]:
        """Boom pitch and extension from the elbow triangle; lance pitch is what beta leaves."""
        drop = self.elbow[2]
        radius = settle(np.sqrt(x * x + z * z), abs(drop), slack)
        length = leg(radius, abs(drop)) * np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
        q2 = wrap_into(np.arctan2(z, x) - np.arctan2(drop, length), self.lower[1], self.upper[1])
        q4 = beta - q2
        if not self.limits_lance:
            q4 = wrap_into(q4, self.lower[3], self.upper[3])
        return q2, length - self.elbow[0], q4
