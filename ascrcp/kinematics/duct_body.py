"""The duct arm as spheres along its links: joints -> their centres and Jacobians (duct paper 2.1, fig. 3)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from ascrcp.core.config import Struct
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.duct import Duct, Gap

Size = Annotated[float, Meta(gt=0.0, le=1.0)]


class BodyParameters(Struct):
    """Envelope radii and the spacing of spheres along a link [m].

    Between two spheres h apart a link is nearer to a wall of curvature c by h^2 c / 8 at most: 2 mm in the
    trial bend, within the clearance wanted.
    """

    joint_radius: Size
    link_radius: Size
    lance_radius: Size
    gun_radius: Size
    spacing: Size


@dataclass(frozen=True)
class SphereBody:
    """Spheres on the lines between joint origins.

    Sphere (i, s) lies at share s of the way from the origin of joint i to that of joint i + 1, the last
    link's far end being the gun. So joint i moves it, and joints beyond i do not; for s = 0 joint i only
    turns it in place, and it is named after that joint.

    Attributes:
        names: J4 a joint, L5 a link, lance, gun.
        link: i, from 1, shape (m,).
        share: s, 0..1, shape (m,).
        radius: Radii [m], shape (m,).
    """

    names: tuple[str, ...]
    link: NDArray[np.int64]
    share: Array
    radius: Array

    @property
    def number(self) -> NDArray[np.int64]:
        """The paper's t: the joint nearest to each sphere, from 1, shape (m,)."""
        return self.link + (self.share > 0.5)

    @classmethod
    def of(cls, arm: Arm, parameters: BodyParameters) -> "SphereBody":
        """Cover joints 2.. and every link of an arm whose first joint carries it along."""
        origin = _origins(arm, arm.zero_pose[None])[0]
        rows: list[tuple[str, int, float, float]] = []
        for i in range(2, arm.n + 1):
            last = i == arm.n
            length = float(np.linalg.norm(origin[i] - origin[i - 1]))
            radius = parameters.lance_radius if last else parameters.link_radius
            if not last:
                rows.append((f"J{i}", i, 0.0, parameters.joint_radius))
            count = int(np.ceil(length / parameters.spacing))
            name = "lance" if last else f"L{i}"
            rows += [(name, i, k / count, radius) for k in range(1, count)]
        rows.append(("gun", arm.n, 1.0, parameters.gun_radius))
        names, link, share, radii = zip(*rows, strict=True)
        return cls(names, np.array(link), np.array(share), np.array(radii))

    def place(self, arm: Arm, q: Array) -> Array:
        """Return the centres at joint vectors (n, joints) in the base frame [m], shape (n, m, 3)."""
        origin = _origins(arm, q)
        near, far = origin[:, self.link - 1], origin[:, self.link]
        return np.asarray(near + self.share[:, None] * (far - near))

    def measure(self, arm: Arm, q: Array, duct: Duct) -> Gap:
        """Measure every sphere at joint vectors (n, joints) against a duct, each shape (n, m, ...)."""
        p = self.place(arm, q)
        gap = duct.measure(p.reshape(-1, 3), np.tile(self.radius, len(q)))
        shape = p.shape[:2]
        return Gap(gap.clearance.reshape(shape), gap.inward.reshape(*shape, 3), gap.escape.reshape(*shape, 3))

    def jacobian(self, arm: Arm, q: Array) -> Array:
        """Return how the centres move with the joints at q (n, joints): shape (n, m, 3, joints)."""
        frames = arm.frames(q)
        start = np.broadcast_to(np.eye(4), (len(q), 1, 4, 4))
        before = np.concatenate([start, frames[:, : arm.n - 1]], axis=1)  # the frame each joint moves in
        axis, origin = before[:, :, :3, 2], before[:, :, :3, 3]
        arm_of = self.place(arm, q)[:, :, None] - origin[:, None]
        turning = np.cross(axis[:, None], arm_of)
        J = np.where(arm.prismatic[:, None], axis[:, None], turning)
        moves = np.arange(1, arm.n + 1) <= self.link[:, None]
        return np.swapaxes(np.where(moves[None, :, :, None], J, 0.0), 2, 3)


def _origins(arm: Arm, q: Array) -> Array:
    """Origins of the base and of the frames that end each joint's step, shape (n, joints + 1, 3) [m]."""
    frames = arm.frames(q)[:, : arm.n, :3, 3]
    return np.concatenate([np.zeros((len(q), 1, 3)), frames], axis=1)
