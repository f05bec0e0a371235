"""A rig and a link on one virtual bus, in lockstep: what the rig's tests drive."""

import itertools

import numpy as np

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.machine_io import Command, MachineInputs
from ascrcp.devices.bus import Bus, ChannelConfig
from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import DBC, MachineLink, load_can_config
from ascrcp.kinematics import load_arm
from ascrcp.simulation.rig import Rig, load_rig_config

ARM = load_arm("kc")
CODEC = Codec(DBC)
CAN = load_can_config()
UNITS = np.array([np.pi / 180, np.pi / 180, 1e-3, np.pi / 180, np.pi / 180, 1e-3, np.pi / 180, np.pi / 180])
MIDDLE = (-45.0, 25.0, 950.0, -20.0, 0.0, 1100.0, 180.0, 120.0)
REST = (0.0,) * 8
_CHANNELS = itertools.count()


class Bench:
    """One machine and one platform end; step() is one cycle."""

    def __init__(self, overlay=None, seed: int = 1, load_kg: float = 0.0) -> None:
        channel = ChannelConfig(interface="virtual", channel=f"rig-bench-{next(_CHANNELS)}")
        self.near, self.far = Bus(channel), Bus(channel)
        self.rig = Rig(load_rig_config(overlay), ARM, self.far, seed, load_kg, CODEC)
        self.link = MachineLink(self.near, CODEC, CAN)
        self.now_ns = 0

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        self.near.close()
        self.far.close()

    def step(self, drive=REST, *, enable: bool = True, silent: bool = False, **spray) -> MachineInputs:
        """Live one cycle: the rig first, then what the platform sees, then its command."""
        self.now_ns += CYCLE_NS
        self.rig.step(self.now_ns)
        inputs = self.link.receive(self.now_ns)
        if not silent:
            self.link.send(Command(tuple(drive), enable, **spray))
        return inputs

    def ready(self) -> "Bench":
        """Take the controller out of its power-up state: disabled, then enabled at rest."""
        for _ in range(3):
            self.step(enable=False)
        for _ in range(3):
            self.step()
        return self

    def run(self, drive, cycles: int) -> MachineInputs:
        """Hold one drive for some cycles."""
        for _ in range(cycles):
            inputs = self.step(drive)
        return inputs

    def q(self) -> np.ndarray:
        """True joints in deg and mm."""
        return self.rig.true_q() / UNITS


def only(joint: int, drive: float) -> tuple[float, ...]:
    """A drive on one joint (index from 0), the others at rest."""
    return tuple(drive if i == joint else 0.0 for i in range(8))


def middle(**change) -> dict:
    """Overlay: every joint in the middle of its range, joint entries changed further."""
    joints = {f"j{i + 1}": {"start": start} for i, start in enumerate(MIDDLE)}
    for name, more in change.items():
        joints[name] = {**joints[name], **more}
    return {"arm": {"joints": joints}}
