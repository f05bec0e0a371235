"""What the stages answer the session: light to load, for the answers cross from process to process."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import JointSequence, Surface
from ascrcp.core.geometry import Array
from ascrcp.session.snapshot import WallLayer


@dataclass(frozen=True)
class Solution:
    """Outcome of `solve`; rows belong to the planned points.

    Attributes:
        solved: Which points are sprayed, shape (n,).
        reasons: Why the others are not, None for those that are.
        duration_s: Length of the sequence [s].
        tilt: Angle by which a pose was tilted to keep clear [rad], shape (n,).
        clearance: Distance to the surroundings [m], NaN where unsolved or not known, shape (n,).
        move_clearance: The least of it between strokes [m]; None without moves or surroundings.
    """

    solved: NDArray[np.bool_]
    reasons: tuple[str | None, ...]
    duration_s: float
    tilt: Array
    clearance: Array
    move_clearance: float | None


@dataclass(frozen=True)
class Loaded:
    """A checked sequence and the number of points that were planned, solved or not."""

    sequence: JointSequence
    planned: int


@dataclass(frozen=True)
class Measured:
    """What a further scan found: the heading as it is now, the layer laid so far with its figures."""

    surface: Surface
    layer: WallLayer
