"""Survey the simulated machine: poses -> what its sensors read and where its nozzle really is."""

import itertools
from typing import Any

import msgspec
import numpy as np

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.geometry import Array
from ascrcp.devices.bus import Bus, ChannelConfig
from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import MachineLink, load_can_config
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.observation import Observations
from ascrcp.simulation.rig import DBC, Rig, RigConfig

SETTLE = 3
"""Cycles until every sensor has reported; the machine stands still all the time."""

NOISES = 40
"""The reading is taken up to so many cycles later, pose by pose: the same zero errors, other noise."""

PRISM = 0.003
"""One sigma of the surveyed point [m]: a prism held to the nozzle by hand; placeholder."""

MARGIN = 0.02
"""Share of each range kept free at its ends."""

_CHANNELS = itertools.count()


def draw_poses(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Draw joint vectors evenly over the ranges [rad, m], shape (count, joints)."""
    room = MARGIN * (arm.limit_upper - arm.limit_lower)
    g = rng.uniform(arm.limit_lower + room, arm.limit_upper - room, (count, arm.n))
    return np.asarray(g @ np.linalg.inv(arm.limit_matrix).T)


def survey_rig(
    config: RigConfig,
    arm: Arm,
    poses: Array,
    payload_kg: Array,
    seed: int,
    rng: np.random.Generator,
    prism: float = PRISM,
) -> Observations:
    """Stand the simulated machine in poses, read its sensors off the bus and measure its nozzle.

    Args:
        config: The rig's parameters.
        arm: Geometry of the true machine; the platform's may differ.
        poses: True joint vectors [rad, m], shape (n, 8).
        payload_kg: Concrete in the hose [kg], shape (n,).
        seed: The rig's: the same seed is the same machine, with the same zero errors of its sensors.
        rng: Source of chance: when the sensors are read, and the surveyor.
        prism: One sigma of the surveyed points [m], 0 for the truth.
    """
    codec, can = Codec(DBC), load_can_config()
    q, position = np.empty_like(poses), np.empty((len(poses), 3))
    for i, pose in enumerate(poses):
        channel = ChannelConfig(interface="virtual", channel=f"survey-{next(_CHANNELS)}")
        near, far = Bus(channel), Bus(channel)
        try:
            rig = Rig(_standing(config, arm, pose), arm, far, seed, float(payload_kg[i]), codec)
            link = MachineLink(near, codec, can, joints=arm.n)
            for cycle in range(1, SETTLE + int(rng.integers(NOISES))):
                rig.step(cycle * CYCLE_NS)
                inputs = link.receive(cycle * CYCLE_NS)
            q[i] = inputs.q
            position[i] = rig.true_nozzle()[:3, 3] + rng.normal(0.0, prism, 3)
        finally:
            near.close()
            far.close()
    return Observations(
        q, payload_kg.astype(float), position, np.arange(2, len(poses) + 2), "survey of the rig"
    )


def _standing(config: RigConfig, arm: Arm, pose: Array) -> RigConfig:
    """Return the configuration of the rig standing in a pose."""
    joints: dict[str, Any] = {}
    for name, value, slides in zip(config.arm.joints.__struct_fields__, pose, arm.prismatic, strict=True):
        joint: Any = getattr(config.arm.joints, name)
        start = float(value) * 1e3 if slides else float(np.degrees(value))
        joints[name] = msgspec.structs.replace(joint, start=start)
    rows: Any = config.arm.joints
    whole: Any = config.arm
    outer: Any = config
    standing: RigConfig = msgspec.structs.replace(
        outer, arm=msgspec.structs.replace(whole, joints=msgspec.structs.replace(rows, **joints))
    )
    return standing
