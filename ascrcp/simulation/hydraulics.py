"""Valves and cylinders: drive of eight joints -> true joint positions, in steps of 5 ms.

Plain floats: with eight joints a numpy call costs more than the arithmetic it saves.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from ascrcp.simulation.parameter import ArmConfig, JointConfig, OilConfig, ValveConfig

DEG = math.pi / 180.0
MM = 1e-3


class Spool:
    """A proportional valve's spool: second order with dead time, advanced exactly for held drive."""

    __slots__ = ("_a", "_b", "_delay", "position", "rate")

    def __init__(self, config: ValveConfig, step_s: float) -> None:
        w = 2.0 * math.pi * config.frequency_hz
        system = np.zeros((3, 3))
        system[0, 1] = 1.0
        system[1] = [-w * w, -2.0 * config.damping * w, w * w]
        held = expm(system * step_s)
        self._a = tuple(float(v) for v in held[:2, :2].ravel())
        self._b = tuple(float(v) for v in held[:2, 2])
        self._delay = deque([0.0] * round(config.dead_time_s / step_s))
        self.position = 0.0
        self.rate = 0.0

    def advance(self, drive: float) -> float:
        """Advance one step under a drive -1..1 and return the spool position."""
        if self._delay:
            self._delay.append(drive)
            drive = self._delay.popleft()
        a, b = self._a, self._b
        x, v = self.position, self.rate
        self.position = a[0] * x + a[1] * v + b[0] * drive
        self.rate = a[2] * x + a[3] * v + b[1] * drive
        return self.position


class Actuator:
    """One joint: spool, dead band, direction-dependent speed, stick-slip, end stops.

    Attributes:
        q: Joint position, SI.
        speed: Speed of the last step, SI per second.
    """

    __slots__ = (
        "_band", "_breakaway", "_creep", "_flow", "_full", "_high", "_hold", "_low", "_moving",
        "_sticks", "_want", "q", "speed", "spool",
    )  # fmt: skip

    def __init__(self, config: JointConfig, step_s: float) -> None:
        si = DEG if config.unit == "deg" else MM
        self.spool = Spool(config.valve, step_s)
        self._band = config.valve.dead_band
        self._full = (config.speed[0] * si, config.speed[1] * si)
        self._flow = (config.flow_lpm / self._full[0], config.flow_lpm / self._full[1])
        self._low, self._high = config.stops[0] * si, config.stops[1] * si
        self._breakaway = config.stiction.breakaway
        self._hold = config.stiction.hold
        self._creep = config.stiction.creep_speed * si
        self._sticks = config.stiction.breakaway > 0.0
        self._moving = False
        self._want = 0.0
        self.q = config.start * si
        self.speed = 0.0

    def open(self, drive: float, gain: tuple[float, float]) -> float:
        """Move the spool one step and work out the speed it asks for.

        Args:
            drive: Drive -1..1.
            gain: Factor on the full speed from load and oil, (negative, positive).

        Returns:
            Oil flow wanted [l/min].
        """
        x = self.spool.advance(drive)
        side = 1 if x > 0.0 else 0
        size = x if side else -x
        band = self._band[side]
        opening = (size - band) / (1.0 - band)
        if self._sticks:
            self._moving = size > (self._hold if self._moving else self._breakaway)
            if not self._moving:
                opening = 0.0
        if opening <= 0.0:
            self._want = 0.0
            return 0.0
        if opening > 1.0:
            opening = 1.0
        rate = opening * self._full[side] * gain[side]
        if self._sticks and rate < self._creep:
            rate = self._creep
        self._want = rate if side else -rate
        return rate * self._flow[side]

    def move(self, share: float, step_s: float) -> None:
        """Integrate one step with the share of the wanted flow that the supply delivers."""
        self.speed = self._want * share
        self.q += self.speed * step_s
        if not (self._low <= self.q <= self._high):
            self.q = self._low if self.q < self._low else self._high
            self.speed = 0.0


class Oil:
    """Temperature of the oil: warmed by the flow used, cooled by the surroundings."""

    def __init__(self, config: OilConfig) -> None:
        self._config = config
        self.temperature_c = config.start_c

    @property
    def gain(self) -> float:
        """Factor on every joint's speed: cold oil is thick and slow."""
        c = self._config
        return max(0.3, 1.0 + c.gain_per_c * (self.temperature_c - c.reference_c))

    def advance(self, used: float, step_s: float) -> None:
        """Advance by one step [s] with the fraction of the supply in use."""
        c = self._config
        goal = c.ambient_c + c.heating_c * used
        if goal < c.ambient_c + 0.4 * c.heating_c:
            goal = c.ambient_c + 0.4 * c.heating_c  # the pump idles against its relief valve
        self.temperature_c += (goal - self.temperature_c) * step_s / c.time_constant_s


class Hydraulics:
    """All actuators on one supply."""

    def __init__(self, config: ArmConfig, load_kg: float) -> None:
        self._config = config
        self.load(load_kg)
        self._step_s = config.substep_s
        self._loads = [joint.load for joint in config.joints.rows]
        self.actuators = [Actuator(joint, config.substep_s) for joint in config.joints.rows]
        self.oil = Oil(config.oil)

    def load(self, payload_kg: float) -> None:
        """Hang another payload on."""
        self._payload = payload_kg / self._config.payload_reference_kg

    @property
    def q(self) -> tuple[float, ...]:
        """Joint positions as driven, SI."""
        return tuple(actuator.q for actuator in self.actuators)

    def advance(self, drive: Sequence[float], reach: float, duration_s: float) -> None:
        """Advance all joints by one cycle.

        Args:
            drive: Drive per joint, -1..1.
            reach: Horizontal reach of the nozzle [m], for the load.
            duration_s: A multiple of the substep [s].
        """
        gains = self._gains(reach)
        actuators = self.actuators
        step_s = self._step_s
        supply = self._config.oil.supply_lpm
        pairs = list(zip(actuators, drive, gains, strict=True))
        used = 0.0
        steps = round(duration_s / step_s)
        for _ in range(steps):
            wanted = 0.0
            for actuator, u, gain in pairs:
                wanted += actuator.open(u, gain)
            share = 1.0 if wanted <= supply else supply / wanted
            used += wanted * share
            for actuator in actuators:
                actuator.move(share, step_s)
        self.oil.advance(used / (steps * supply), duration_s)

    def _gains(self, reach: float) -> list[tuple[float, float]]:
        """Factors on the full speeds: oil temperature, and orifice flow ~ sqrt(pressure left)."""
        boom, lance = self.actuators[1].q, self.actuators[1].q + self.actuators[3].q
        scale = {
            "none": 0.0,
            "reach": reach / self._config.flexure.reference_reach,
            "lance": math.cos(lance),
            "boom_slope": math.sin(boom),
            "lance_slope": math.sin(lance),
        }
        warm = self.oil.gain
        least = self._config.oil.pressure_margin
        gains = []
        for load in self._loads:
            share = (load.share + load.payload_share * self._payload) * scale[load.kind]
            against, along = max(least, 1.0 - share), max(least, 1.0 + share)
            gains.append((warm * math.sqrt(along), warm * math.sqrt(against)))
        return gains
