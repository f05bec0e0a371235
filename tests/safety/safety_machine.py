"""A healthy machine for gate tests, cycle by cycle, with one thing changed at a time."""

import math
from dataclasses import replace

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.config import load
from ascrcp.core.machine_io import Command, MachineInputs
from ascrcp.core.paths import CONFIG
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.gate import Gate, GateState, Verdict
from ascrcp.safety.limit import Limits, Range

JOINTS = 8
CONFIG_SAFETY = load(CONFIG / "safety.yaml", SafetyConfig)
D = math.radians
LIMITS = Limits(
    revolute=(True, True, False, True, True, False, True, True),
    max_speed=(D(8), D(5), 0.25, D(6), D(8), 0.25, D(30), D(20)),
    ranges=(
        Range((0,), D(-180), D(90)),
        Range((1,), D(-25), D(75)),
        Range((2,), 0.0, 1.9),
        Range((1, 3), D(-25), D(75)),
        Range((4,), D(-37.5), D(37.5)),
        Range((5,), 0.0, 2.2),
        Range((6,), 0.0, D(360)),
        Range((7,), 0.0, D(240)),
    ),
)
MIDDLE = (0.0, 0.3, 1.0, -0.1, 0.0, 1.0, 3.0, 2.0)


def moving(*drive: float, **more: object) -> Command:
    """An enabled request with the given drives, the last one repeated."""
    full = (*drive, *([drive[-1]] * JOINTS))[:JOINTS]
    return Command(drive=full, enable=True, **more)  # type: ignore[arg-type]


class Bench:
    """A gate in its cycle, fed by a machine whose controller echoes one cycle late."""

    def __init__(self) -> None:
        self.gate = Gate(LIMITS, CONFIG_SAFETY)
        self.t_ns = 0
        self.sent = Command(drive=(0.0,) * JOINTS)
        self.q = MIDDLE

    def inputs(self, **changes: object) -> MachineInputs:
        healthy = MachineInputs(
            t_ns=self.t_ns,
            q=self.q,
            age_ns=(0,) * JOINTS,
            in_range=(True,) * JOINTS,
            estop=False,
            estop_age_ns=0,
            controller_age_ns=0,
            controller_enabled=self.sent.enable,
        )
        return replace(healthy, **changes)  # type: ignore[arg-type]

    def cycle(self, request: Command | None = None, **more: object) -> Verdict:
        """One 20 ms cycle; words the gate's `check` knows go there, others change the inputs."""
        self.t_ns += CYCLE_NS
        buttons = {k: more.pop(k) for k in ("reset", "start", "stop", "error_q") if k in more}
        verdict = self.gate.check(self.inputs(**more), request or moving(0.0), **buttons)  # type: ignore[arg-type]
        self.sent = verdict.command
        return verdict

    def arm(self) -> "Bench":
        """Release, reset, start."""
        self.cycle()
        self.cycle(reset=True)
        assert self.cycle(start=True).state is GateState.ARMED
        return self

    def run(self, cycles: int, request: Command) -> Verdict:
        for _ in range(cycles):
            verdict = self.cycle(request)
        return verdict
