"""Where a tool can get at all: Monte Carlo cloud and exact extremes of the reach (muck paper 2.2)."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from scipy.optimize import minimize

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.sag import sagged_forward

Count = Annotated[int, Meta(ge=1, le=31)]

EXTREMES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "radius_max")
"""Directions of the base frame; radius is the horizontal distance from the base's z axis. The muck
arm's base frame has z down: its depth is z_max."""

SAMPLES = 4096
"""Poses from which the best are taken as starts of a climb."""

FINE = 1e-15
"""Relative gain at which a climb ends: rounding."""


class ReachConfig(Struct):
    """Postures tried for a wall point: values of theta1, q5, q6, then a climb from the best.

    Attributes:
        roll_step_deg: Spacing of theta1 over the full turn.
        yaw_candidates: Values of q5 over its range.
        telescope_candidates: Values of q6 over its range.
        starts: Values of theta1 that are refined, the best ones of the grid.
        refine_rounds: Rounds of trying the neighbours, with half the step where none is better.
    """

    roll_step_deg: Annotated[float, Meta(ge=1.0, le=90.0)]
    yaw_candidates: Count
    telescope_candidates: Count
    starts: Count
    refine_rounds: Annotated[int, Meta(ge=0, le=30)]


class ParkingConfig(Struct):
    """Places along the machine's x axis to compare, and the coarser search used there."""

    from_m: Annotated[float, Meta(ge=-50.0, le=50.0)]
    to_m: Annotated[float, Meta(ge=-50.0, le=50.0)]
    step_m: Annotated[float, Meta(ge=0.05, le=10.0)]
    cell_m: Annotated[float, Meta(ge=0.05, le=5.0)]
    yaw_candidates: Count
    telescope_candidates: Count
    starts: Count

    def __post_init__(self) -> None:
        if not self.from_m <= 0.0 <= self.to_m:
            raise ConfigError(f"parking: from_m {self.from_m} .. to_m {self.to_m} must hold 0")


class HeadingConfig(Struct):
    """A heading to try where none is recognised: axis beside and above joint 1, stations [m]."""

    axis_left_m: Annotated[float, Meta(ge=-20.0, le=20.0)]
    axis_height_m: Annotated[float, Meta(ge=-20.0, le=20.0)]
    unsprayed_m: tuple[float, float]

    def __post_init__(self) -> None:
        if not 0.1 <= self.unsprayed_m[1] - self.unsprayed_m[0] <= 100.0:
            raise ConfigError(f"heading: unsprayed_m {self.unsprayed_m} must rise by 0.1..100 m")


class WorkspaceConfig(Struct):
    """Numbers of config/workspace.yaml."""

    cloud_samples: Annotated[int, Meta(ge=100, le=5_000_000)]
    search_starts: Annotated[int, Meta(ge=1, le=500)]
    reach: ReachConfig
    cell_m: Annotated[float, Meta(ge=0.05, le=5.0)]
    parking: ParkingConfig
    heading: HeadingConfig


def load_config() -> WorkspaceConfig:
    """Read config/workspace.yaml."""
    return load(CONFIG / "workspace.yaml", WorkspaceConfig)


@dataclass(frozen=True)
class Extreme:
    """Farthest value of one coordinate [m] and a joint vector that reaches it [rad, m], shape (n,)."""

    value: float
    q: Array


def sample_joints(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Draw joint vectors evenly over the limited quantities [rad, m], shape (count, n)."""
    g = rng.uniform(arm.limit_lower, arm.limit_upper, (count, arm.n))
    return np.asarray(g @ np.linalg.inv(arm.limit_matrix).T)


def sample_cloud(arm: Arm, count: int, rng: np.random.Generator, payload_kg: float = 0.0) -> Array:
    """Draw tool positions by Monte Carlo, sag included.

    Args:
        arm: The arm.
        count: Number of points.
        rng: Source of chance.
        payload_kg: Concrete in the hose [kg].

    Returns:
        Positions in the base frame [m], shape (count, 3).
    """
    return np.asarray(sagged_forward(arm, sample_joints(arm, count, rng), payload_kg)[:, :3, 3])


def find_extremes(arm: Arm, starts: int, rng: np.random.Generator) -> dict[str, Extreme]:
    """Find how far the rigid tool reaches in each direction: climbs from the best of many random poses.

    A Monte Carlo maximum alone falls short: by 20 mm with 30,000 samples of the muck arm (errata 1.4).

    Args:
        arm: The arm.
        starts: Number of climbs per direction.
        rng: Source of chance for the starts.

    Returns:
        One entry per name in EXTREMES.
    """
    q = sample_joints(arm, max(SAMPLES, starts), rng)
    p = arm.forward(q)[:, :3, 3]
    found = {}
    for name in EXTREMES:
        order = np.argsort(-_measure(name, p))[:starts]
        climbs = [_climb(arm, name, q[i]) for i in order]
        best = max(climbs, key=lambda end: float(_measure(name, arm.forward(end)[:3, 3])))
        x, y, z = arm.forward(best)[:3, 3]
        values = {"x": x, "y": y, "z": z, "radius": np.hypot(x, y)}
        found[name] = Extreme(float(values[name.partition("_")[0]]), best)
    return found


def _measure(name: str, p: Array) -> Array:
    """What is to be made large, at positions (..., 3); shape (...)."""
    axis, _, end = name.partition("_")
    if axis == "radius":
        return np.asarray(np.hypot(p[..., 0], p[..., 1]))
    return p[..., "xyz".index(axis)] * (1.0 if end == "max" else -1.0)


def _climb(arm: Arm, name: str, q: Array) -> Array:
    """Go uphill within the ranges of the limited quantities (L-BFGS-B, analytic gradient)."""
    L_inverse = np.linalg.inv(arm.limit_matrix)

    def descend(g: Array) -> tuple[float, Array]:
        q = L_inverse @ g
        p = arm.forward(q)[:3, 3]
        axis, _, end = name.partition("_")
        if axis == "radius":
            up = np.array([p[0], p[1], 0.0]) / max(float(np.hypot(p[0], p[1])), 1e-12)
        else:
            up = np.eye(3)["xyz".index(axis)] * (1.0 if end == "max" else -1.0)
        return -float(_measure(name, p)), -(up @ arm.jacobian(q)[:3]) @ L_inverse

    ranges = list(zip(arm.limit_lower, arm.limit_upper, strict=True))
    end = minimize(
        descend,
        arm.limit_matrix @ q,
        jac=True,
        bounds=ranges,
        method="L-BFGS-B",
        options={"ftol": FINE, "gtol": 1e-12, "maxiter": 300},
    )
    return np.asarray(L_inverse @ np.clip(end.x, arm.limit_lower, arm.limit_upper))
