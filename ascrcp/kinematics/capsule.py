"""The arm as capsules: machine file -> points along every link's axis, and the spheres round them.

They stand where gravity takes them: each point drops by the sag at its own reach, as the lidar's mount does
in sag.py. A cantilever's middle drops by up to a fifth of the tip's sag more (18 mm on 80).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.chain import compute_reach
from ascrcp.kinematics.kernel_call import as_rows, kernel
from ascrcp.kinematics.kernel_table import ChainTable, ShapeTable, freeze, tabulate_sag

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
        chain: The arm's motions, which carry them.
        shape: The capsules and the samples on their axes.
    """

    names: tuple[str, ...]
    chain: ChainTable
    shape: ShapeTable

    def segments(self, q: Array) -> tuple[Array, Array]:
        """Return both ends of every capsule in the base frame, sagged, at (n, joints); (n, c, 3) [m]."""
        ends = kernel("clearance").place_ends(self.chain, self.shape, as_rows(q))
        return ends[:, :, 0], ends[:, :, 1]


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
    ends = np.array([(c.start, c.end) for c in capsules], dtype=float)
    radius = np.array([c.radius for c in capsules], dtype=float)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    spacing = spread * np.clip(SPACING_PER_RADIUS * radius, *SPACING)
    counts = np.maximum(np.ceil(length / spacing - 1e-9).astype(np.int64) + 1, 1)
    names = tuple(c.name for c in capsules)
    pairs = [(names.index(a), names.index(b)) for a, b in arm.description.self_pairs]
    reach = compute_reach(arm.chain, [(joint.lower, joint.upper) for joint in arm.joints])
    shape = ShapeTable(
        joint=np.array([c.joint for c in capsules], dtype=np.int64),
        ends=ends,
        radius=radius,
        first=np.concatenate([[0], np.cumsum(counts)]),
        share=np.concatenate([np.linspace(0.0, 1.0, count) for count in counts.tolist()]),
        pairs=np.array(pairs, dtype=np.int64).reshape(-1, 2),
        sag=tabulate_sag(arm.description.sag, reach, HALF_LOAD_KG),
    )
    return Body(names, arm.table, freeze(shape))
