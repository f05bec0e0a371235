"""The simulated machine and the platform's end of its bus, in lockstep: what tuning and benches drive."""

import itertools
import os
from types import TracebackType

from ascrcp.app import calibrated_can, open_gate
from ascrcp.core.clock import CYCLE_NS
from ascrcp.devices.bus import Bus, ChannelConfig
from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import DBC, MachineLink, load_can_config
from ascrcp.kinematics.arm import Arm
from ascrcp.simulation.rig import Rig, RigConfig

_CHANNELS = itertools.count(1)


class Cell:
    """One machine on one bus; time passes when it is told to.

    Attributes:
        rig: The machine; its truth judges.
        link: The platform's end of the bus.
        gate: What every command passes.
    """

    def __init__(self, config: RigConfig, true_arm: Arm, arm: Arm, seed: int, load_kg: float = 0.0) -> None:
        """Switch it on.

        Args:
            config: The machine's parameters.
            true_arm: Its true geometry.
            arm: Geometry the platform believes in; its calibrated sensor zeros are applied.
            seed: Of the machine.
            load_kg: Payload [kg].
        """
        channel = ChannelConfig(interface="virtual", channel=f"cell-{os.getpid()}-{next(_CHANNELS)}")
        self._near, self._far = Bus(channel), Bus(channel)
        codec = Codec(DBC)
        self.rig = Rig(config, true_arm, self._far, seed, load_kg, codec)
        self.link = MachineLink(self._near, codec, calibrated_can(load_can_config(), arm), joints=arm.n)
        self.gate = open_gate(arm)
        self._now_ns = 0

    def __enter__(self) -> "Cell":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def advance(self) -> int:
        """Let the machine live one cycle; return its instant [ns]."""
        self._now_ns += CYCLE_NS
        self.rig.step(self._now_ns)
        return self._now_ns

    def close(self) -> None:
        """Leave the bus."""
        self._near.close()
        self._far.close()
