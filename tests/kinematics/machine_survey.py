"""A machine that is not as its file says, and a survey of it: what the calibration tests begin with."""

from dataclasses import dataclass

import numpy as np

from ascrcp.kinematics import load_arm, sagged_forward
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.calibration import load_config
from ascrcp.kinematics.observation import Observations
from ascrcp.kinematics.parameter import (
    Parameter,
    change_description,
    find_independent,
    list_parameters,
    zero_change,
)

ARM = load_arm("kc")
CONFIG = load_config()
PARAMETERS = find_independent(ARM, list_parameters(ARM, CONFIG.expected), 181.0)[0]
SIZES = {"deg": 1.0, "m": 0.02, "mm": 20.0, "mm/kg": 0.05, "": 1.0}


@dataclass(frozen=True)
class Truth:
    """What is really different, in the machine file's units, and the survey."""

    change: dict[str, float]
    seen: Observations


def draw_joints(arm: Arm, n: int, rng: np.random.Generator, still: dict[int, float] | None = None):
    """Joint vectors over the ranges; joints in `still` (from 1) keep one limited quantity."""
    g = rng.uniform(arm.limit_lower, arm.limit_upper, (n, arm.n))
    for joint, value in (still or {}).items():
        g[:, joint - 1] = value
    return g @ np.linalg.inv(arm.limit_matrix).T


def survey(
    n: int,
    seed: int = 0,
    *,
    noise: bool = True,
    still: dict[int, float] | None = None,
    payload_kg: float | None = None,
    parameters: list[Parameter] = PARAMETERS,
    arm: Arm = ARM,
) -> Truth:
    """Survey a machine with lengths 2 cm, zeros 1 deg and sag 20 mm wrong, signs drawn."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], len(parameters))
    change = np.array(
        [
            SIZES[p.unit] * (1.0 if p.group == "sag" else sign)
            for p, sign in zip(parameters, signs, strict=True)
        ]
    )
    true = Arm(change_description(arm.description, parameters, change))
    q = draw_joints(arm, n, rng, still)
    payload = rng.uniform(0.0, 181.0, n) if payload_kg is None else np.full(n, payload_kg)
    # the sensors read q; the joints really stand at q + zero
    position = sagged_forward(true, q + zero_change(arm, parameters, change), payload)[:, :3, 3]
    if noise:
        step = np.where(arm.prismatic, 1e-3, np.radians(0.1))
        q = np.round(q @ arm.limit_matrix.T / step) * step @ np.linalg.inv(arm.limit_matrix).T
        position = position + rng.normal(0.0, 0.003, position.shape)
    names = {p.name: float(c) for p, c in zip(parameters, change, strict=True)}
    return Truth(names, Observations(q, payload, position, np.arange(2, n + 2), "survey.csv"))
