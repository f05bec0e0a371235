"""Candidates of a path point: closed-form solutions over a grid of theta1, q5 and q6."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.task import roll_pose

CHUNK = 2048
"""Poses solved at once: small enough for the cache."""

ROLLS_BESIDE = 2
"""Steps of theta1 by which a lean may move the rolls that serve; 1 lost a third of the candidates of one
point in 26, 2 one in a thousand of all."""


@dataclass(frozen=True)
class Grid:
    """Values of the three redundant coordinates, one row per candidate: theta1, q5 [rad], q6 [m]."""

    rows: Array

    def keep(self, rolls: Array) -> "Grid":
        """Return the rows whose theta1 is among rolls [rad]."""
        near = np.abs(self.rows[:, :1] - rolls).min(axis=1) < 1e-9
        return Grid(self.rows[near])


def make_grid(arm: Arm, model: PathModel, refine: int = 1) -> Grid:
    """Spread candidates over the full roll and the ranges of joints 5 and 6.

    Args:
        arm: The arm.
        model: Number of candidates.
        refine: Factor by which each spacing is divided.
    """
    rolls = np.radians(np.arange(-180.0, 180.0, model.roll_step_deg / refine))
    yaws = _spread(arm.lower[4], arm.upper[4], model.yaw_candidates * refine)
    reaches = _spread(arm.lower[5], arm.upper[5], model.telescope_candidates * refine)
    return Grid(np.stack(np.meshgrid(rolls, yaws, reaches, indexing="ij"), axis=-1).reshape(-1, 3))


def _spread(lower: float, upper: float, count: int) -> Array:
    return np.linspace(lower, upper, count) if count > 1 else np.array([(lower + upper) / 2])


def solve_grid(arm: Arm, T: Array, grid: Grid) -> Array:
    """Solve every pose at every grid row, limits not looked at.

    Args:
        arm: An arm whose closed form holds joints 5 and 6.
        T: Poses at theta1 = 0, shape (m, 4, 4).
        grid: g rows.

    Returns:
        Joint vectors [rad, m], NaN where not real, shape (m, g, k, joints).
    """
    m, g = len(T), len(grid.rows)
    rolls, yaws, reaches = (np.tile(grid.rows[:, i], m) for i in range(3))
    poses = np.repeat(T, g, axis=0)
    parts = []
    for start in range(0, m * g, CHUNK):
        cut = slice(start, start + CHUNK)
        aimed = roll_pose(poses[cut], rolls[cut])
        parts.append(arm.candidates(aimed, {5: yaws[cut], 6: reaches[cut]}))
    return np.concatenate(parts).reshape(m, g, -1, arm.n)


def solve_inside(
    arm: Arm, T: Array, grid: Grid, tried: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Solve every pose at every grid row and return the candidates within limits only.

    Args:
        arm: An arm whose closed form holds joints 5 and 6.
        T: Poses at theta1 = 0, shape (m, 4, 4).
        grid: g rows.
        tried: Which rows to try at which pose, shape (m, g); all if None.

    Returns:
        Pose and grid row of each, in that order, (k,) each, and joint vectors [rad, m], (k, joints).
    """
    pairs = np.arange(len(T) * len(grid.rows)) if tried is None else np.flatnonzero(tried)
    parts = []
    for start in range(0, max(len(pairs), 1), CHUNK):
        pose, row = np.divmod(pairs[start : start + CHUNK], len(grid.rows))
        rolls, yaws, reaches = grid.rows[row].T
        at, q = arm.candidates_inside(roll_pose(T[pose], rolls), {5: yaws, 6: reaches})
        parts.append((pose[at], row[at], q))
    poses, rows, found = zip(*parts, strict=True)
    return np.concatenate(poses), np.concatenate(rows), np.concatenate(found)


def find_candidates(arm: Arm, T: Array, grid: Grid) -> list[Array]:
    """Find each pose's candidates within limits, a list of m arrays (k_i, joints); may be empty."""
    pose, _, q = solve_inside(arm, T, grid)
    return np.split(q, np.searchsorted(pose, np.arange(1, len(T))))


def find_rolls(arm: Arm, T: Array, grid: Grid) -> Array:
    """Find the values of theta1 at which any of the poses (m, 4, 4) has a candidate."""
    return np.unique(grid.rows[solve_inside(arm, T, grid)[1], 0])


def spread_rolls(
    grid: Grid, pose: NDArray[np.int64], row: NDArray[np.int64], count: int
) -> NDArray[np.bool_]:
    """Mark the grid rows worth trying where the nozzle is leaned: rolls near those of use before.

    A posture within limits exists for 2 to 5 of 24 rolls of a pose; leaning moves them by a step or two.

    Args:
        grid: g rows over the full turn of theta1.
        pose, row: Candidates found without a lean, each shape (k,).
        count: Poses, m of them.

    Returns:
        Shape (m, g); all rows of a pose without any candidate.
    """
    rolls, which = np.unique(grid.rows[:, 0], return_inverse=True)
    useful = np.zeros((count, len(rolls)), dtype=bool)
    useful[pose, which.reshape(-1)[row]] = True
    near = np.any([np.roll(useful, step, axis=1) for step in range(-ROLLS_BESIDE, ROLLS_BESIDE + 1)], axis=0)
    near[~useful.any(axis=1)] = True
    return np.asarray(near[:, which.reshape(-1)])
