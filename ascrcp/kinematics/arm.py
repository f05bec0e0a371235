"""The arm: joints -> poses, poses -> joints, from a machine file (design.md sections 3 and 9)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.core.geometry import Array, rotation, transform
from ascrcp.kinematics.bucket import BucketInverse
from ascrcp.kinematics.chain import Op, Walk, compile_chain, pack_transform, walk_chain
from ascrcp.kinematics.description import ArmDescription, Mount, Prismatic, Revolute, load_description
from ascrcp.kinematics.inverse import SprayInverse
from ascrcp.kinematics.kernel_table import tabulate_chain
from ascrcp.kinematics.pose import split_poses
from ascrcp.kinematics.solution import BRANCHES, ClosedForm, Confirmation, Solutions

LIMIT_TOLERANCE = 1e-7
"""How far outside a range a joint that stands on its limit may come out [rad, m]: where two solutions
meet, rounding of the pose is felt by its square root."""

BLOCK = 2048
"""Poses inverted at once: small enough for the cache."""


@dataclass(frozen=True)
class JointInfo:
    """What the screen and the drives need to know of one joint.

    Attributes:
        number: From 1, as the papers count.
        name: English name.
        name_zh: Chinese name.
        prismatic: Whether it slides [m]; else it turns [rad].
        lower: Lower end of its range [rad, m].
        upper: Upper end.
        limit_sum: Joint numbers whose sum the range limits; the joint alone for most.
    """

    number: int
    name: str
    name_zh: str
    prismatic: bool
    lower: float
    upper: float
    limit_sum: tuple[int, ...]


class Arm:
    """A serial arm. Joint vectors mix rad and m; joints are numbered from 1 where they are named.

    Attributes:
        name: Machine name.
        n: Number of joints.
        joints: Their metadata.
        prismatic: Whether each slides, shape (n,).
        limit_matrix: Rows that turn q into the limited quantities, shape (n, n): the identity,
            but for a joint whose range limits a sum (kc's joint 4: q2 + q4).
        limit_lower, limit_upper: Ranges of limit_matrix @ q [rad, m], shape (n,).
        lower, upper: Widest range of each joint by itself [rad, m], shape (n,).
        max_speed, max_acceleration, max_jerk: Per joint, SI, shape (n,).
        travel_weight: Cost of moving each joint, shape (n,).
        zero_pose: The pose the arm scans from [rad, m], shape (n,).
        table: Its motions for the machine code.
    """

    def __init__(self, description: ArmDescription) -> None:
        self.description = description
        self.name = description.name
        self.n = len(description.joints)
        self._chain = compile_chain(description)
        self.table = tabulate_chain(self._chain)
        self.joints = tuple(_describe(i, joint) for i, joint in enumerate(description.joints, start=1))
        self.prismatic: NDArray[np.bool_] = np.array([joint.prismatic for joint in self.joints])
        self.travel_weight = np.array([joint.travel_weight for joint in description.joints])
        rates = np.array([_rates(joint) for joint in description.joints])
        self.max_speed, self.max_acceleration, self.max_jerk = rates.T.copy()
        self.limit_matrix = np.zeros((self.n, self.n))
        for i, joint in enumerate(self.joints):
            self.limit_matrix[i, np.array(joint.limit_sum) - 1] = 1.0
        self.limit_lower = np.array([joint.lower for joint in self.joints])
        self.limit_upper = np.array([joint.upper for joint in self.joints])
        self.lower, self.upper = self._widest()
        zero = description.zero_pose or [0.0] * self.n
        self.zero_pose = np.where(self.prismatic, zero, np.radians(zero))
        if not bool(self.within_limits(self.zero_pose)):
            raise ConfigError(f"machine {self.name}: zero_pose lies outside the joints' ranges")
        self._T_mount = _mount(description.lidar)
        self._closed_form: ClosedForm | None = SprayInverse.fit(description) or BucketInverse.fit(description)
        if self._closed_form is not None:
            ranges = [(joint.lower, joint.upper) for joint in self.joints]
            self._confirmation = Confirmation(self._chain, ranges, self._closed_form.middle)
        for array in (self.lower, self.upper, self.limit_lower, self.limit_upper, self.zero_pose):
            array.flags.writeable = False

    def forward(self, q: ArrayLike) -> Array:
        """Compute the tool's pose (eq. 2-5).

        Args:
            q: Joint vectors [rad, m], shape (..., n).

        Returns:
            T_base_tool, shape (..., 4, 4).

        Raises:
            InputError: Wrong shape, NaN or infinity.
        """
        walk, shape = self._walk(q)
        return pack_transform(walk.columns, shape)

    def jacobian(self, q: ArrayLike) -> Array:
        """Compute the geometric Jacobian in the base frame.

        Column i is (z_i x (p - o_i); z_i) of a turning joint and (z_i; 0) of a sliding one (duct
        paper eq. 2, with the sliding form it leaves out).

        Args:
            q: Joint vectors [rad, m], shape (..., n).

        Returns:
            Shape (..., 6, n); rows vx, vy, vz [m/s], wx, wy, wz [rad/s] per rad/s or m/s.
        """
        return self.pose_and_jacobian(q)[1]

    def pose_and_jacobian(self, q: ArrayLike) -> tuple[Array, Array]:
        """Compute forward(q) and jacobian(q) in one walk."""
        walk, shape = self._walk(q, record=True)
        J = np.zeros((*shape, 6, self.n))
        p = walk.columns[3]
        for i, (axis, origin) in enumerate(zip(walk.axes, walk.origins, strict=True)):
            if self.prismatic[i]:
                for row in range(3):
                    J[..., row, i] = axis[row]
                continue
            arm = [p[row] - origin[row] for row in range(3)]
            for row in range(3):
                j, k = (row + 1) % 3, (row + 2) % 3
                J[..., row, i] = axis[j] * arm[k] - axis[k] * arm[j]
                J[..., 3 + row, i] = axis[row]
        return pack_transform(walk.columns, shape), J

    def frames(self, q: ArrayLike) -> Array:
        """Compute the frame that ends each joint's step, and the tool's last, shape (..., n + 1, 4, 4)."""
        walk, shape = self._walk(q, record=True)
        packed = [pack_transform(columns, shape) for columns in [*walk.frames, walk.columns]]
        return np.stack(packed, axis=-3)

    def lidar(self, q: ArrayLike) -> Array:
        """Compute T_base_lidarmount, shape (..., 4, 4).

        Raises:
            InputError: The machine carries no lidar, or q is bad.
        """
        mount = self.description.lidar
        if mount is None or self._T_mount is None:
            raise InputError(f"machine {self.name} has no lidar mount")
        walk, shape = self._walk(q, record=True)
        return pack_transform(walk.frames[mount.joint - 1], shape) @ self._T_mount

    def inverse(
        self, T: ArrayLike, held: Mapping[int, Any] | None = None, near: ArrayLike | None = None
    ) -> Solutions:
        """Find every real joint vector that brings the tool to a pose, in closed form.

        Args:
            T: T_base_tool, shape (4, 4) or (N, 4, 4).
            held: Joints held at given values [rad, m], numbered from 1: {5: .., 6: ..} for kc;
                scalars or arrays (N,).
            near: Joint vectors (n,) or (N, n) that settle what a singular pose leaves free.

        Returns:
            Solutions: q (N, k, n), valid (N, k), within_limits (N, k).

        Raises:
            InputError: A bad pose, wrong held joints, or an arm without a closed form.
        """
        form = self._form()
        T = np.asarray(T, dtype=float)
        if T.ndim not in (2, 3) or T.shape[-2:] != (4, 4):
            raise InputError(f"poses must have shape (4, 4) or (N, 4, 4), not {T.shape}")
        poses = split_poses(T.reshape(-1, 4, 4))
        n = poses.shape[2]
        values = self._held(held or {}, form.held, n)
        reference = None if near is None else self._near(near, n)
        joints = np.empty((self.n, *BRANCHES, n))
        valid, inside = np.empty((2, *BRANCHES, n), dtype=bool)
        for start in range(0, n, BLOCK):
            cut = slice(start, start + BLOCK)
            P = poses[..., cut]
            q = form.solve(P, [v[cut] for v in values], None if reference is None else reference[cut])
            good = valid[..., cut] = self._confirmation.check(q, P)
            inside[..., cut] = good & self._inside(q)
            spoil = np.where(good, 0.0, np.nan)
            for i in range(self.n):
                np.add(q[i], spoil, out=joints[i][..., cut])
        count = math.prod(BRANCHES)
        return Solutions(
            joints.reshape(self.n, count, -1).transpose(2, 1, 0),
            valid.reshape(count, -1).T,
            inside.reshape(count, -1).T,
        )

    @property
    def chain(self) -> tuple[Op, ...]:
        """The elementary motions from base to tool."""
        return self._chain

    @property
    def held(self) -> tuple[int, ...]:
        """Joints the closed form needs held, from 1; empty also where there is none."""
        return () if self._closed_form is None else self._closed_form.held

    def candidates(self, T: Array, held: Mapping[int, Any]) -> Array:
        """Compute closed-form candidates without confirming them, for searches over many.

        Args:
            T: Poses, shape (N, 4, 4), taken as rigid.
            held: As for inverse.

        Returns:
            Joint vectors [rad, m], NaN where not real, shape (N, k, n).
        """
        form = self._form()
        P = np.ascontiguousarray(np.moveaxis(T[:, :3], 0, -1))
        q = np.empty((self.n, *BRANCHES, len(T)))
        for i, value in enumerate(form.solve(P, self._held(held, form.held, len(T)), None)):
            q[i] = value
        return q.reshape(self.n, -1, len(T)).transpose(2, 1, 0)

    def candidates_inside(self, T: Array, held: Mapping[int, Any]) -> tuple[NDArray[np.int64], Array]:
        """Compute those closed-form candidates that keep every range, not confirmed.

        The ranges are looked at before branches and joints are spread out: most candidates end there.

        Args:
            T: Poses, shape (N, 4, 4), taken as rigid.
            held: As for inverse.

        Returns:
            Poses they belong to, rising (m,), and joint vectors [rad, m], shape (m, n).
        """
        form = self._form()
        P = np.ascontiguousarray(np.moveaxis(T[:, :3], 0, -1))
        found = form.solve(P, self._held(held, form.held, len(T)), None)
        shape = (*BRANCHES, len(T))
        inside = np.broadcast_to(self._inside(found), shape)
        pose, branch = np.nonzero(inside.reshape(math.prod(BRANCHES), -1).T)
        where = (*np.unravel_index(branch, BRANCHES), pose)
        return pose, np.stack([np.broadcast_to(value, shape)[where] for value in found], axis=1)

    def within_limits(self, q: ArrayLike, tolerance: float = LIMIT_TOLERANCE) -> NDArray[np.bool_]:
        """Tell whether joint vectors (..., n) keep every range; NaN never does. Shape (...)."""
        g = np.asarray(q, dtype=float) @ self.limit_matrix.T
        inside = (g >= self.limit_lower - tolerance) & (g <= self.limit_upper + tolerance)
        return np.asarray(inside.all(axis=-1))

    def _inside(self, q: Sequence[Array]) -> NDArray[np.bool_]:
        """Tell which candidates keep every range; arrays of joints that broadcast together."""
        inside: Any = True
        for i, joint in enumerate(self.joints):
            g = q[i] if len(joint.limit_sum) == 1 else sum(q[k - 1] for k in joint.limit_sum)
            inside = inside & ((g >= joint.lower - LIMIT_TOLERANCE) & (g <= joint.upper + LIMIT_TOLERANCE))
        return np.asarray(inside)

    def _near(self, near: ArrayLike, n: int) -> Array:
        q = self._check(near)
        if q.shape not in ((self.n,), (n, self.n)):
            raise InputError(f"near must have shape ({self.n},) or ({n}, {self.n}), not {q.shape}")
        return np.broadcast_to(q, (n, self.n))

    def _form(self) -> ClosedForm:
        if self._closed_form is None:
            raise InputError(
                f"machine {self.name} has no closed-form inverse: its joints match neither the "
                "shotcrete arm's structure nor the muck arm's"
            )
        return self._closed_form

    def _walk(self, q: ArrayLike, *, record: bool = False) -> tuple[Walk, tuple[int, ...]]:
        q = self._check(q)
        if q.ndim == 1:
            return walk_chain(self._chain, q.tolist(), record=record), ()
        columns = [np.ascontiguousarray(q[..., i]) for i in range(self.n)]
        return walk_chain(self._chain, columns, record=record), q.shape[:-1]

    def _check(self, q: ArrayLike) -> Array:
        q = np.asarray(q, dtype=float)
        if q.ndim == 0 or q.shape[-1] != self.n:
            raise InputError(f"joint vectors of {self.name} must have shape (..., {self.n}), not {q.shape}")
        finite = all(map(math.isfinite, q.tolist())) if q.ndim == 1 else np.isfinite(q).all()
        if not finite:
            raise InputError(f"joint vectors of {self.name} must be finite, but hold NaN or infinity")
        return q

    def _held(self, held: Mapping[int, Any], wanted: tuple[int, ...], n: int) -> list[Array]:
        if set(held) != set(wanted):
            names = ", ".join(map(str, wanted)) or "none"
            raise InputError(
                f"the inverse of {self.name} needs these joints held: {names}; got {sorted(held)}"
            )
        values = []
        for number in wanted:
            value = np.asarray(held[number], dtype=float)
            if value.shape not in ((), (1,), (n,)) or not np.isfinite(value).all():
                raise InputError(
                    f"held joint {number} must be a finite scalar or shape ({n},), not {value.shape}"
                )
            values.append(np.broadcast_to(value, (n,)))
        return values

    def _widest(self) -> tuple[Array, Array]:
        lower, upper = self.limit_lower.copy(), self.limit_upper.copy()
        for i, joint in enumerate(self.joints):
            others = [k - 1 for k in joint.limit_sum[:-1]]
            lower[i], upper[i] = lower[i] - upper[others].sum(), upper[i] - lower[others].sum()
        return lower, upper


def load_arm(name_or_path: str | Path) -> Arm:
    """Load an arm by name (kc, muck, duct) or from a YAML file.

    Raises:
        ConfigError: No such machine, or a file that breaks the schema.
    """
    return Arm(load_description(name_or_path))


def _describe(number: int, joint: Revolute | Prismatic) -> JointInfo:
    if isinstance(joint, Prismatic):
        lower, upper = joint.range_m
    else:
        lower, upper = (math.radians(end) for end in joint.range_deg)
    return JointInfo(
        number,
        joint.name,
        joint.name_zh,
        isinstance(joint, Prismatic),
        lower,
        upper,
        joint.limit_sum or (number,),
    )


def _rates(joint: Revolute | Prismatic) -> tuple[float, float, float]:
    if isinstance(joint, Prismatic):
        return joint.max_speed_m_s, joint.max_acceleration_m_s2, joint.max_jerk_m_s3
    return (
        math.radians(joint.max_speed_deg_s),
        math.radians(joint.max_acceleration_deg_s2),
        math.radians(joint.max_jerk_deg_s3),
    )


def _mount(mount: Mount | None) -> Array | None:
    if mount is None:
        return None
    x, y, z = np.radians(mount.rotate_deg)
    return transform(rotation("x", x) @ rotation("y", y) @ rotation("z", z), np.array(mount.translate))
