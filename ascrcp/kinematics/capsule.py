"""The arm as capsules: joint vectors -> points along every link's axis, and the spheres round them.

They stand where gravity takes them: each point drops by the sag at its own reach, as the lidar's mount does
in sag.py. A cantilever's middle drops by up to a fifth of the tip's sag more (18 mm on 80).
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.sag import compute_sag

HALF_LOAD_KG = 90.0
"""Concrete in the hose for the sag [kg]: half of thesis 6.2.3's full hose, so that kc's tip is off by 9 mm
at most, empty or full."""

SPACING = (0.10, 0.25)
"""Least and largest spacing of the points along a capsule's axis [m]."""

SPACING_PER_RADIUS = 1.5
"""Spacing over radius between these. A wall at distance d beside two points h apart is seen too far by
h^2 / 8 (d + radius) at most: under 15 mm at 0.25 m for every link of kc."""


@dataclass(frozen=True)
class Body:
    """The shapes of an arm, sampled.

    Attributes:
        names: Capsules in the order of the machine file.
        joint: Joint each capsule moves with, from 1; 0 stands still, shape (c,).
        start, end: Its segment in that joint's frame [m], shape (c, 3).
        radius: Radii [m], shape (c,).
        owner: Capsule of each sample, rising, shape (m,).
        share: Where along its capsule each lies, 0 at the start, 1 at the end, shape (m,).
        first: First sample of each capsule, shape (c,).
        pairs: Capsules that are checked against each other, shape (k, 2).
    """

    names: tuple[str, ...]
    joint: NDArray[np.int64]
    start: Array
    end: Array
    radius: Array
    owner: NDArray[np.int64]
    share: Array
    first: NDArray[np.int64]
    pairs: NDArray[np.int64]

    @property
    def is_moving(self) -> NDArray[np.bool_]:
        """Whether a capsule moves more than the slew turns it on the carrier, shape (c,)."""
        return np.asarray(self.joint > 1)

    @cached_property
    def moving(self) -> slice | NDArray[np.int64]:
        """Samples of the capsules that move: as a slice where they lie side by side, which copies nothing."""
        found = np.flatnonzero(self.is_moving[self.owner])
        if len(found) and found[-1] - found[0] == len(found) - 1:
            return slice(int(found[0]), int(found[-1]) + 1)
        return found

    def place(self, arm: Arm, q: Array) -> Array:
        """Return the samples in the base frame at joint vectors (n, joints), sagged, shape (n, m, 3) [m]."""
        return self.sample(arm, *self.carry(arm, q))

    def segments(self, arm: Arm, q: Array) -> tuple[Array, Array]:
        """Return both ends of every capsule's segment in the base frame, sagged, each (n, c, 3) [m]."""
        a, b = self.carry(arm, q)
        return droop(arm, a), droop(arm, b)

    def carry(self, arm: Arm, q: Array) -> tuple[Array, Array]:
        """Return both ends of every segment without sag, component by component, each (3, n, c) [m]."""
        frames = arm.link_columns(q)
        ends = np.empty((2, 3, len(q), len(self.joint)))
        for c, number in enumerate(self.joint.tolist()):
            for end, local in zip(ends, (self.start[c].tolist(), self.end[c].tolist()), strict=True):
                if number == 0:
                    end[:, :, c] = np.array(local)[:, None]
                    continue
                *axes, origin = frames[number - 1]
                for i in range(3):
                    place = origin[i]
                    for length, axis in zip(local, axes, strict=True):
                        if length:  # most are zero: shapes lie along their link's axis
                            place = place + length * axis[i]
                    end[i, :, c] = place
        return ends[0], ends[1]

    def sample(self, arm: Arm, a: Array, b: Array) -> Array:
        """Return the sagged samples (n, m, 3) [m] between ends a and b, each (3, n, c)."""
        placed, way = np.empty((*a.shape[:2], len(self.owner))), b - a
        bounds = [*self.first.tolist(), len(self.owner)]
        for c, (first, last) in enumerate(pairwise(bounds)):
            part = placed[:, :, first:last]
            np.multiply(way[:, :, c, None], self.share[first:last], out=part)
            part += a[:, :, c, None]
        return droop(arm, placed)


def droop(arm: Arm, placed: Array) -> Array:
    """Lower rigid points (3, n, k) in place by the sag at each one's reach; a view of them, (n, k, 3)."""
    if arm.description.sag is not None:
        reach = np.hypot(placed[0], placed[1])
        placed[2] -= compute_sag(arm.description.sag, reach, HALF_LOAD_KG)[0]
    return np.moveaxis(placed, 0, -1)


@lru_cache(maxsize=8)
def make_body(arm: Arm, spread: float = 1.0) -> Body:
    """Sample the capsules of a machine file.

    Args:
        arm: The arm.
        spread: Factor on the spacing of the samples; above 1 for a rough look.

    Raises:
        InputError: The machine file names no shapes.
    """
    capsules = arm.description.capsules
    if not capsules:
        raise InputError(f"machine {arm.name} has no capsules, so nothing can be said about its clearance")
    start, end = (np.array([getattr(c, which) for c in capsules]) for which in ("start", "end"))
    radius = np.array([c.radius for c in capsules])
    length = np.linalg.norm(end - start, axis=1)
    spacing = spread * np.clip(SPACING_PER_RADIUS * radius, *SPACING)
    counts = np.maximum(np.ceil(length / spacing - 1e-9).astype(np.int64) + 1, 1)
    owner = np.repeat(np.arange(len(capsules)), counts)
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts.tolist()])
    names = tuple(c.name for c in capsules)
    pairs = [(names.index(a), names.index(b)) for a, b in arm.description.self_pairs]
    return Body(
        names=names,
        joint=np.array([c.joint for c in capsules], dtype=np.int64),
        start=start,
        end=end,
        radius=radius,
        owner=owner,
        share=share,
        first=np.searchsorted(owner, np.arange(len(capsules))),
        pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
    )


def between_segments(a0: Array, a1: Array, b0: Array, b1: Array) -> tuple[Array, Array]:
    """Find the closest points of segments a0-a1 and b0-b1, each (..., 3), and return them, (..., 3).

    Minimises the squared distance over both shares: the free minimum clamped, then each share once more
    for the other's value (Ericson, Real-Time Collision Detection, 5.1.9).
    """
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    a, b, c = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    d, e = (u * w).sum(-1), (v * w).sum(-1)
    tiny = 1e-12
    det = a * c - b * b
    s = np.clip(np.where(det > tiny, (b * e - c * d) / np.maximum(det, tiny), 0.0), 0.0, 1.0)
    t = np.clip((b * s + e) / np.maximum(c, tiny), 0.0, 1.0)
    s = np.clip((b * t - d) / np.maximum(a, tiny), 0.0, 1.0)
    return a0 + s[..., None] * u, b0 + t[..., None] * v
