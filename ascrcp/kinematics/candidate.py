"""Candidates of a path point: closed-form solutions over a grid of theta1, q5 and q6."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.description import PathModel
from ascrcp.kinematics.task import roll_pose

CHUNK = 2048
"""Poses solved at once: small enough for the cache."""


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


def find_candidates(arm: Arm, T: Array, grid: Grid) -> list[Array]:
    """Find each pose's candidates within limits, a list of m arrays (k_i, joints); may be empty."""
    found: list[Array] = []
    for start in range(0, len(T), 8):
        block = solve_grid(arm, T[start : start + 8], grid)
        inside = arm.within_limits(block)
        found.extend(block[i][inside[i]] for i in range(len(block)))
    return found


def find_rolls(arm: Arm, T: Array, grid: Grid) -> Array:
    """Find the values of theta1 at which any of the poses (m, 4, 4) has a candidate."""
    rolls: set[float] = set()
    for start in range(0, len(T), 8):
        block = solve_grid(arm, T[start : start + 8], grid)
        useful = arm.within_limits(block).any(axis=(0, 2))
        rolls.update(grid.rows[useful, 0].tolist())
    return np.array(sorted(rolls))
