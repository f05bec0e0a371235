"""Slow jogs for set-up: the nozzle freely in the base frame, or one joint alone, kept clear (fault F18)."""

import math
from collections.abc import Callable

import numpy as np

from ascrcp.control.reference import Sample
from ascrcp.control.steer import Smooth, SteerStatus, shape_stick
from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.steer_pose import find_joints
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.sag import sagged_forward

Distance = Callable[[Array], float]
"""Distance of a joint vector (joints,) from the surroundings [m]."""

MISS = 0.005
"""A pose missed by more than this [m + rad] is out of reach, or singular."""

JOINT_ACCELERATION_S = 0.5
"""Time in which a joint's jog reaches its speed [s]; placeholder."""


class Jog:
    """What both jogs share: joints that move only inside their ranges and no nearer to anything.

    Args:
        arm: The arm.
        config: Speeds and clearance.
        payload_kg: Concrete in the hose [kg].
        distance: Measures the clearance; None if nothing is known of the surroundings.
    """

    point = -1

    def __init__(
        self, arm: Arm, config: SteerConfig, payload_kg: float = 0.0, distance: Distance | None = None
    ) -> None:
        self._arm, self._config, self._payload = arm, config, payload_kg
        self._distance = distance
        self._max_step = config.joint_share * arm.max_speed * CYCLE_S
        self._cycle = 0
        self._room = math.inf
        self.status = SteerStatus.FREE

    def begin(self, q: Array) -> None:
        """Stand where the arm stands."""
        self._q = np.array(q, dtype=float)
        self._cycle = 0
        self._room = self._distance(self._q) if self._distance is not None else math.inf
        self.rest()

    def rejoin(self, q: Array) -> None:
        """Go on from where the arm stands."""
        self.begin(q)

    def rest(self) -> None:
        """Stand at once."""
        self._speed = np.zeros_like(self._q)

    def sample(self) -> Sample:
        """Return the reference as it is now."""
        T = sagged_forward(self._arm, self._q, self._payload)
        x, y, z = T[:3, 3].tolist()
        return Sample(
            q=tuple(self._q.tolist()),
            speed=tuple(self._speed.tolist()),
            position=(x, y, z),
            direction=tuple(T[:3, 0].tolist()),
            spraying=False,
        )

    def _take(self, q: Array) -> bool:
        """Go to joints if they are in range, not too fast and no nearer to anything; else stand."""
        excess = float((np.abs(q - self._q) / self._max_step).max())
        if excess > 1.0:
            q = self._q + (q - self._q) / excess
        if not bool(self._arm.within_limits(q)):
            self.status = SteerStatus.LIMIT
        elif not self._keeps_clear(q):
            self.status = SteerStatus.NEAR
        else:
            self._speed = (q - self._q) / CYCLE_S
            self._q = q
            return True
        self.rest()
        return False

    def _keeps_clear(self, q: Array) -> bool:
        """Look at the clearance: every few cycles while far, in every one near; there it may only grow."""
        self._cycle += 1
        is_far = self._room > 2.0 * self._config.clearance_m
        if self._distance is None or (is_far and self._cycle % self._config.clearance_every):
            return True
        room = self._distance(q)
        allowed = room >= self._config.clearance_m or room > self._room
        self._room = room if allowed else self._distance(self._q)
        return allowed


class CartesianJog(Jog):
    """Deflections move the nozzle left, into the tunnel and up; the spray direction is held."""

    def __init__(
        self, arm: Arm, config: SteerConfig, payload_kg: float = 0.0, distance: Distance | None = None
    ) -> None:
        super().__init__(arm, config, payload_kg, distance)
        self._smooth = Smooth(3, config.acceleration_m_s2, config.jerk_m_s3)

    def begin(self, q: Array) -> None:
        """Stand where the arm stands, and hold its spray direction."""
        super().begin(q)
        T = sagged_forward(self._arm, self._q, self._payload)
        self._place, self._direction = T[:3, 3].copy(), T[:3, 0].copy()

    def rest(self) -> None:
        """Stand at once."""
        super().rest()
        self._smooth.rest()

    def step(self, x: float, y: float, scale: float, z: float = 0.0) -> Sample:
        """Advance one cycle.

        Args:
            x: Deflection to the left (base +y), -1..1.
            y: Deflection into the tunnel (base +x).
            scale: Pace 0..1.
            z: Deflection up.
        """
        self.status = SteerStatus.FREE
        left, forward = shape_stick(x, y, self._config)
        up, _ = shape_stick(z, 0.0, self._config)
        speed = self._config.jog_m_s * scale
        moved = np.array(self._smooth.step([speed * forward, speed * left, speed * up])) * CYCLE_S
        if not moved.any():
            self._speed = np.zeros_like(self._q)
            return self.sample()
        wanted = self._place + moved
        q, miss = find_joints(self._arm, self._q, wanted, self._direction, self._payload)
        if not miss <= MISS:
            self.status = SteerStatus.EDGE
            self.rest()
        elif self._take(q):
            self._place = sagged_forward(self._arm, self._q, self._payload)[:3, 3].copy()
        return self.sample()


class JointJog(Jog):
    """The stick's along axis moves one joint."""

    def __init__(
        self,
        arm: Arm,
        joint: int,
        config: SteerConfig,
        payload_kg: float = 0.0,
        distance: Distance | None = None,
    ) -> None:
        """Args: joint: number from 1."""
        super().__init__(arm, config, payload_kg, distance)
        self._joint = joint - 1
        self._most = config.jog_share * float(arm.max_speed[self._joint])
        rate = self._most / JOINT_ACCELERATION_S
        self._smooth = Smooth(1, rate, 4.0 * rate / JOINT_ACCELERATION_S)

    def rest(self) -> None:
        """Stand at once."""
        super().rest()
        self._smooth.rest()

    def step(self, x: float, y: float, scale: float, z: float = 0.0) -> Sample:
        """Advance one cycle by the along deflection, -1..1; the others mean nothing here."""
        self.status = SteerStatus.FREE
        share, _ = shape_stick(x, 0.0, self._config)
        (speed,) = self._smooth.step([self._most * scale * share])
        q = self._q.copy()
        q[self._joint] += speed * CYCLE_S
        if speed:
            self._take(q)
        else:
            self._speed = np.zeros_like(self._q)
        return self.sample()
