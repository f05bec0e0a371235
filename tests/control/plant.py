"""A small hydraulic arm for control tests: not the simulated rig, so nothing is tuned to one plant."""

import math
from dataclasses import dataclass

from ascrcp.core.clock import CYCLE_NS, CYCLE_S
from ascrcp.core.machine_io import Command, MachineInputs

D = math.pi / 180.0
STEPS = 4
FULL = (8 * D, 5 * D, 0.25, 6 * D, 8 * D, 0.25, 30 * D, 20 * D)
RESOLUTION = (0.1 * D, 0.1 * D, 1e-3, 0.1 * D, 0.1 * D, 1e-3, 0.1 * D, 0.1 * D)


@dataclass
class PlantSettings:
    """What may be detuned; each list is per joint."""

    gain: float = 1.0
    dead_band: tuple[float, ...] = (0.05, 0.07, 0.04, 0.06, 0.05, 0.08, 0.05, 0.05)
    frequency_hz: tuple[float, ...] = (6.0, 5.0, 6.0, 5.0, 7.0, 6.0, 9.0, 8.0)
    ratio: tuple[float, ...] = (1.0, 1.4, 1.5, 1.3, 1.3, 1.6, 1.0, 1.0)
    damping: float = 0.8
    stiction: float = 0.03
    lag_s: float = 0.1


class Plant:
    """Valve of second order, dead band, direction-dependent integrator, stiction, sensors."""

    def __init__(self, q: tuple[float, ...], settings: PlantSettings | None = None) -> None:
        self.settings = settings or PlantSettings()
        self.q = list(q)
        self.spool = [0.0] * 8
        self.spool_rate = [0.0] * 8
        self.speed = [0.0] * 8
        self.shown = [q[0], q[1], q[2], q[1] + q[3], *q[4:]]
        self.t_ns = 0
        self.enabled = False
        self.pending = Command(drive=(0.0,) * 8)

    def step(self, command: Command) -> None:
        """Advance one cycle under the command of the cycle before: one cycle of bus delay."""
        active, self.pending = self.pending, command
        self.enabled = active.enable
        dt = CYCLE_S / STEPS
        for _ in range(STEPS):
            for j in range(8):
                self._move(j, active.drive[j] if active.enable else 0.0, dt)
            self._sense(dt)
        self.t_ns += CYCLE_NS

    def _move(self, j: int, drive: float, dt: float) -> None:
        s = self.settings
        w = 2 * math.pi * s.frequency_hz[j]
        acceleration = w * w * (drive - self.spool[j]) - 2 * s.damping * w * self.spool_rate[j]
        self.spool_rate[j] += acceleration * dt
        self.spool[j] += self.spool_rate[j] * dt
        edge = s.dead_band[j]
        if j >= 6 and self.speed[j] == 0.0:
            edge += s.stiction
        opening = abs(self.spool[j])
        if opening <= edge:
            self.speed[j] = 0.0
            return
        share = min(1.0, (opening - s.dead_band[j]) / (1 - s.dead_band[j]))
        full = FULL[j] * s.gain * (s.ratio[j] ** (0.5 if self.spool[j] > 0 else -0.5))
        self.speed[j] = math.copysign(share * full, self.spool[j])
        self.q[j] += self.speed[j] * dt

    def _sense(self, dt: float) -> None:
        true = [self.q[0], self.q[1], self.q[2], self.q[1] + self.q[3], *self.q[4:]]
        for j in range(8):
            lag = self.settings.lag_s if j in (1, 3) else 0.0
            self.shown[j] += (true[j] - self.shown[j]) * (dt / (lag + dt))

    def inputs(self) -> MachineInputs:
        """The machine as measured now."""
        shown = [round(x / r) * r for x, r in zip(self.shown, RESOLUTION, strict=True)]
        shown[3] -= shown[1]
        return MachineInputs(
            t_ns=self.t_ns,
            q=tuple(shown),
            age_ns=(0,) * 8,
            in_range=(True,) * 8,
            estop=False,
            estop_age_ns=0,
            controller_age_ns=0,
            controller_enabled=self.enabled,
        )
