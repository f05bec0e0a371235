"""Where the nozzle aims: planned path + leans -> the path as it is sprayed and the arm's targets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.description import ClearanceModel
from ascrcp.kinematics.feedback import add_tilt, soften_tilt, spread_tilt, tilt_path
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.spacing import STAND_OFF, distances
from ascrcp.kinematics.task import spray_pose

SOFTENED = 3
"""Points to either side over which a tilt is smoothed; placeholder."""


@dataclass(frozen=True)
class Wish:
    """What single points asked for, and what came of it.

    Attributes:
        wanted: Rotation vectors that points asked for [rad], base frame, shape (n, 3).
        pinned: Points whose wish is met to the letter: it was chosen with its neighbours, shape (n,).
        tilt: From planned to sprayed: the wishes, smoothed along the path [rad], shape (n, 3).
    """

    wanted: Array
    pinned: NDArray[np.bool_]
    tilt: Array


class Aim:
    """Targets of a path, leaned where that is asked for.

    Attributes:
        planned: The path as planned.
        path: The same as leaned.
        T: Its poses raised by the sag, theta1 = 0, shape (n, 4, 4).
        wish: The leans.
        cut: Where the arm changes its posture before a point on purpose, so that leans on either side need
            not go over into each other, shape (n,).
    """

    def __init__(self, arm: Arm, planned: SprayPath, payload_kg: float, far: float) -> None:
        self._arm, self._payload_kg, self._far = arm, payload_kg, far
        self.planned = self.path = planned
        self.T = compensate(arm, spray_pose(planned), payload_kg)
        self.cut = np.zeros(len(planned), dtype=bool)
        none = np.zeros((len(planned), 3))
        self.wish = Wish(none, np.zeros(len(planned), dtype=bool), none)

    @property
    def tilt(self) -> Array:
        """Rotation vectors from planned to sprayed directions [rad], shape (n, 3)."""
        return self.wish.tilt

    @property
    def gaps(self) -> Array:
        """Distance from the point before [m], infinite where the nozzle does not spray through, (n,)."""
        return distances(self.T, self._far)

    @property
    def strokes(self) -> NDArray[np.int64]:
        """Number of the stroke each point is sprayed in, shape (n,)."""
        return np.cumsum(~np.isfinite(self.gaps))

    def lean(self, more: Array, model: ClearanceModel) -> None:
        """Add rotation vectors [rad] (n, 3) to the tilts, in whole steps, and spread them."""
        step, limit = np.radians(model.tilt_step_deg), np.radians(model.tilt_limit_deg)
        asked = np.asarray(more.any(axis=1))
        raised = add_tilt(self.tilt, more, self.planned.direction, step, limit)
        wanted = np.where(asked[:, None], raised, self.wish.wanted)
        self._take(wanted, self.wish.pinned & ~asked, step)

    def pin(self, rows: NDArray[np.int64], leans: Array, model: ClearanceModel) -> None:
        """Lean points (m,) by rotation vectors (m, 3) [rad] to the letter; the others follow."""
        wanted, pinned = self.wish.wanted.copy(), self.wish.pinned.copy()
        wanted[rows], pinned[rows] = leans, True
        self._take(wanted, pinned, np.radians(model.tilt_step_deg))

    def put_back(self, rows: NDArray[np.bool_], old: Wish) -> None:
        """Take the leans of marked points back to what they were."""
        self._set(
            Wish(
                np.where(rows[:, None], old.wanted, self.wish.wanted),
                np.where(rows, old.pinned, self.wish.pinned),
                np.where(rows[:, None], old.tilt, self.wish.tilt),
            )
        )

    def _take(self, wanted: Array, pinned: NDArray[np.bool_], step: float) -> None:
        strokes = np.cumsum((~np.isfinite(self.gaps) | self.cut).astype(np.int64))
        soft = soften_tilt(spread_tilt(wanted, strokes, step), strokes, SOFTENED)
        self._set(Wish(wanted, pinned, blend_pinned(soft, wanted, pinned, strokes)))

    def _set(self, wish: Wish) -> None:
        self.wish = wish
        self.path = tilt_path(self.planned, wish.tilt, STAND_OFF)
        self.T = compensate(self._arm, spray_pose(self.path), self._payload_kg)


def blend_pinned(soft: Array, wanted: Array, pinned: NDArray[np.bool_], stretch: NDArray[np.int64]) -> Array:
    """Let smoothed tilts go over into pinned ones within a few points.

    Args:
        soft: Smoothed tilts [rad], shape (n, 3).
        wanted: Tilts of the pinned points [rad], shape (n, 3).
        pinned: Which those are, shape (n,).
        stretch: Number of the stroke each point belongs to, shape (n,).

    Returns:
        Tilts [rad], exactly as wanted where pinned, shape (n, 3).
    """
    blended, left = soft.copy(), np.ones(len(soft))
    for k in range(SOFTENED, -1, -1):  # the nearest pinned point has the last word
        for shift in (-k, k):
            mine = np.flatnonzero(pinned) + shift
            other = mine - shift
            inside = (mine >= 0) & (mine < len(soft))
            mine, other = mine[inside], other[inside]
            mine, other = (each[stretch[mine] == stretch[other]] for each in (mine, other))
            left[mine] = k / (SOFTENED + 1)
            blended[mine] = wanted[other]
    return left[:, None] * soft + (1.0 - left[:, None]) * blended
