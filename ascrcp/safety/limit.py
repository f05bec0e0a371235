"""Joint limits: who is beyond, and how much drive outward the room left allows (F12, F13)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from ascrcp.core.errors import ConfigError
from ascrcp.safety.config import SafetyConfig


class LimitedJoint(Protocol):
    """What an arm says of one joint: range of the sum of joints `limit_sum` [rad or m]."""

    @property
    def prismatic(self) -> bool:
        """Whether it slides."""
        ...

    @property
    def lower(self) -> float:
        """Lower end of the range."""
        ...

    @property
    def upper(self) -> float:
        """Upper end of the range."""
        ...

    @property
    def limit_sum(self) -> tuple[int, ...]:
        """Joints whose sum the range limits, numbered from 1."""
        ...


@dataclass(frozen=True, slots=True)
class Range:
    """One limited coordinate: the sum of one or more joints [rad or m].

    The lance inclination of kc is the sum of joints 2 and 4, because its inclinometer is absolute.
    """

    joints: tuple[int, ...]
    lower: float
    upper: float

    def __post_init__(self) -> None:
        if not (self.joints and abs(self.lower) < math.inf and self.lower < self.upper < math.inf):
            raise ConfigError(f"joint range {self}: needs joints and finite lower < upper")

    def value(self, q: Sequence[float]) -> float:
        """Return the coordinate of a joint vector."""
        return sum(q[j] for j in self.joints)


@dataclass(frozen=True, slots=True)
class Limits:
    """What the gate knows of the arm.

    Attributes:
        revolute: Whether each joint is revolute (rad) or prismatic (m).
        max_speed: Largest speed of each joint at full drive [rad/s or m/s].
        ranges: Limited coordinates; a joint may stand in several.
    """

    revolute: tuple[bool, ...]
    max_speed: tuple[float, ...]
    ranges: tuple[Range, ...]

    def __post_init__(self) -> None:
        n = len(self.revolute)
        if len(self.max_speed) != n or any(j not in range(n) for r in self.ranges for j in r.joints):
            raise ConfigError(f"limits: {n} joints, but speeds or ranges name others")
        if not all(0.0 < v < math.inf for v in self.max_speed):
            raise ConfigError(f"limits: max_speed {self.max_speed} must be positive and finite")

    @classmethod
    def of_arm(cls, joints: Sequence["LimitedJoint"], max_speed: Iterable[float]) -> "Limits":
        """Take the limits over from an arm's joint descriptions, as plain floats.

        Args:
            joints: Description of each joint; `limit_sum` numbers joints from 1.
            max_speed: Largest speed of each [rad/s or m/s].
        """
        return cls(
            revolute=tuple(not joint.prismatic for joint in joints),
            max_speed=tuple(float(v) for v in max_speed),
            ranges=tuple(
                Range(tuple(number - 1 for number in j.limit_sum), float(j.lower), float(j.upper))
                for j in joints
            ),
        )

    def per_joint(self, deg: float, mm: float) -> tuple[float, ...]:
        """Spread a pair of settings over the joints, in SI: degrees to revolute, mm to prismatic."""
        return tuple(math.radians(deg) if r else mm * 1e-3 for r in self.revolute)

    def is_revolute(self, coordinate: Range) -> bool:
        """Whether a limited coordinate is an angle."""
        return self.revolute[coordinate.joints[0]]


class LimitCheck:
    """Find joints beyond their hard limits and hold drives back from the soft ones."""

    def __init__(self, limits: Limits, config: SafetyConfig) -> None:
        self._limits = limits
        self._brake_s = config.brake_s
        self._dead_band = config.dead_band
        slack = (math.radians(config.soft_slack_deg), config.soft_slack_mm * 1e-3)
        margin = (math.radians(config.hard_margin_deg), config.hard_margin_mm * 1e-3)
        prismatic = [not limits.is_revolute(r) for r in limits.ranges]
        self._slack = tuple(slack[p] for p in prismatic)
        self._margin = tuple(margin[p] for p in prismatic)

    def find_beyond(self, q: Sequence[float]) -> frozenset[int]:
        """Return the indices of the ranges whose coordinate lies beyond its hard limit (F13)."""
        beyond = []
        for i, r in enumerate(self._limits.ranges):
            value, margin = r.value(q), self._margin[i]
            if not (r.lower - margin <= value <= r.upper + margin):
                beyond.append(i)
        return frozenset(beyond)

    def hold_back(self, q: Sequence[float], drive: Sequence[float]) -> tuple[tuple[float, ...], bool]:
        """Scale down drives that could not stop before a soft limit (F12); inward passes freely.

        Args:
            q: Joint vector as measured.
            drive: Wanted drives, finite.

        Returns:
            Allowed drives, and whether anything was held back.
        """
        allowed = list(drive)
        held = False
        for i, r in enumerate(self._limits.ranges):
            value, slack = r.value(q), self._slack[i]
            for sign, room in ((1.0, r.upper + slack - value), (-1.0, value - r.lower + slack)):
                scale = self._scale(r, sign, room, allowed)
                if scale < 1.0:
                    held = True
                    for j in r.joints:
                        if allowed[j] * sign > 0.0:
                            allowed[j] = sign * self._reduced(abs(allowed[j]), scale)
        return tuple(allowed), held

    def _scale(self, r: Range, sign: float, room: float, drive: Sequence[float]) -> float:
        """Return the fraction 0..1 of outward speed that stops within the room left."""
        outward = inward = 0.0
        for j in r.joints:
            moving = abs(drive[j]) - self._dead_band
            speed = moving * self._limits.max_speed[j] if moving > 0.0 else 0.0
            if drive[j] * sign > 0.0:
                outward += speed
            else:
                inward += speed
        if not room > 0.0:
            blocked = any(drive[j] * sign > 0.0 for j in r.joints)
            return 0.0 if blocked else 1.0
        may = room / self._brake_s + inward
        return 1.0 if outward <= may else may / outward

    def _reduced(self, drive: float, scale: float) -> float:
        """Return the drive whose speed is `scale` times as large; zero when nothing is allowed."""
        if not scale > 0.0:
            return 0.0
        return self._dead_band + (drive - self._dead_band) * scale if drive > self._dead_band else drive
