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
from ascrcp.kinematics.description import ArmDescription, Prismatic
from ascrcp.kinematics.solution import root, wrap_into

STRUCTURE = ("z", "-y", "x slides", "-y", "z", "x slides", "x", "z")
"""Axes of the eight steps this closed form is for."""

SINGULAR = 1e-10
"""Sine of the angle between tilt axis and pitch axes below which they count as parallel."""


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

    def solve(self, T: Array, held: Sequence[Array], near: Array | None) -> Array:
        """Compute the eight candidates of each pose.

        Args:
            T: Poses, shape (N, 4, 4).
            held: q5 [rad] and q6 [m], each shape (N,).
            near: Joint vectors whose lance inclination settles a pose that leaves it free, (N, 8).

        Returns:
            Candidates [rad, m], NaN where not real, joint first: shape (8, 8, N).
        """
        q5, q6 = held
        q = np.empty((8, 2, 2, 2, len(T)))  # joint, boom, roll, slew, pose
        q[4], q[5] = q5, q6
        s5, c5 = np.sin(q5), np.cos(q5)
        stretched = self.lance[0] + q6
        lance_x = self.yaw[0] + c5 * stretched - s5 * self.lance[1]
        lance_z = self.yaw[2] + self.lance[2]
        lateral = self.boom[1] + self.elbow[1] + self.yaw[1] + s5 * stretched + c5 * self.lance[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            forward, height, R1 = self._solve_slew(T, lateral, q)
            beta, c_beta, s_beta = self._solve_wrist(R1, s5, c5, near, q)
            x = forward - self.boom[0] - (c_beta * lance_x - s_beta * lance_z)
            z = height - self.boom[2] - (s_beta * lance_x + c_beta * lance_z)
            self._solve_boom(x, z, beta, q)
        return q.reshape(8, 8, -1)

    def _solve_slew(self, T: Array, lateral: Array, q: Array) -> tuple[Array, Array, list[list[Array]]]:
        """Wrist centre from the tool offset; slew from the constant lateral offset.

        Returns:
            Forward distance of the wrist in the slewed frame (2, N), its height (N,), and the
            rotation with the slew taken off, nine components.
        """
        R = T[:, :3, :3]
        w = T[:, :3, 3] - R @ self.tool - self.base
        wx, wy = np.ascontiguousarray(w[:, 0]), np.ascontiguousarray(w[:, 1])
        square = wx * wx + wy * wy
        forward = root(square - lateral * lateral, square + 1.0) * np.array([[1.0], [-1.0]])
        q1 = np.arctan2(wy, wx) - np.arctan2(lateral, forward)
        q[0] = wrap_into(q1, self.lower[0], self.upper[0])
        safe = np.where(square > 0.0, square, 1.0)  # a wrist on the slew axis: arctan2 took zero
        c1 = np.where(square > 0.0, (wx * forward + wy * lateral) / safe, np.cos(q1))
        s1 = np.where(square > 0.0, (wy * forward - wx * lateral) / safe, np.sin(q1))
        rows = [[np.ascontiguousarray(R[:, i, j]) for j in range(3)] for i in range(3)]
        R1 = [
            [c1 * rows[0][j] + s1 * rows[1][j] for j in range(3)],
            [c1 * rows[1][j] - s1 * rows[0][j] for j in range(3)],
            [np.broadcast_to(rows[2][j], c1.shape) for j in range(3)],
        ]
        return forward, w[:, 2], R1

    def _solve_wrist(
        self, R1: list[list[Array]], s5: Array, c5: Array, near: Array | None, q: Array
    ) -> tuple[Array, Array, Array]:
        """Roll and lance inclination from the third column, tilt from what is left.

        Where the tilt axis is parallel to the pitch axes (q5 = 0, q7 = +-90 deg) only
        beta + q8 is fixed; `near`, else the middle of the tilt's range, settles beta.

        Returns:
            beta, cos(beta), sin(beta), each shape (2 roll, 2 slew, N).
        """
        (r1x, _, r3x), (r1y, _, r3y), (r1z, _, r3z) = R1
        square = r3x * r3x + r3z * r3z
        singular = square < SINGULAR**2
        s7 = -r3y / c5
        c7 = root(square - s5 * s5, np.abs(s5)) / np.abs(c5) * np.array([[[1.0]], [[-1.0]]])
        c7 = np.where(singular, 0.0, c7)
        q7 = np.arctan2(np.broadcast_to(s7, c7.shape), c7)
        along, across = s5 * s7, c7
        beta = np.arctan2(r3z, r3x) - np.arctan2(across, along)
        beta = np.where(singular, self._free_inclination(R1, s7, near), beta)
        beta = wrap_into(beta, self.lower[3], self.upper[3]) if self.limits_lance else beta
        c_beta, s_beta = np.cos(beta), np.sin(beta)
        x, z = c_beta * r1x + s_beta * r1z, c_beta * r1z - s_beta * r1x
        q8 = np.arctan2(c7 * (c5 * r1y - s5 * x) + s7 * z, c5 * x + s5 * r1y)
        q[6] = wrap_into(q7, self.lower[6], self.upper[6])
        q[7] = wrap_into(q8, self.lower[7], self.upper[7])
        return beta, c_beta, s_beta

    def _free_inclination(self, R1: list[list[Array]], s7: Array, near: Array | None) -> Array:
        """Choose the lance inclination of a singular pose: near's, else tilt at mid range."""
        if near is not None:
            return near[:, 1] + near[:, 3]
        # q5 = 0, c7 = 0: the tool's x axis is inclined by beta + s7 q8
        inclined = np.arctan2(R1[2][0], R1[0][0])
        beta = wrap_into(inclined - s7 * (self.lower[7] + self.upper[7]) / 2, self.lower[3], self.upper[3])
        return np.clip(beta, self.lower[3], self.upper[3])

    def _solve_boom(self, x: Array, z: Array, beta: Array, q: Array) -> None:
        """Boom pitch and extension from the elbow triangle; lance pitch is what beta leaves."""
        drop = self.elbow[2]
        square = x * x + z * z
        length = root(square - drop * drop, square + 1.0) * np.array([[[[1.0]]], [[[-1.0]]]])
        q[2] = length - self.elbow[0]
        pitch = np.arctan2(z, x) - np.arctan2(drop, length)
        q[1] = wrap_into(pitch, self.lower[1], self.upper[1])
        lance = beta - q[1]
        q[3] = lance if self.limits_lance else wrap_into(lance, self.lower[3], self.upper[3])
