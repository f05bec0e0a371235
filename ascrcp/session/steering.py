"""What the stick is given: a round's plan or a jog, made ready beside the control thread."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ascrcp.control.steer import Kernel, Steering
from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.steer_jog import CartesianJog, Distance, JointJog
from ascrcp.control.steer_plan import SteerPlan
from ascrcp.control.steer_surface import SteerSurface
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import least_distance
from ascrcp.kinematics.obstacle import Obstacles

PLAN_ARRAYS = ("angle", "q", "position", "direction", "node", "cross", "point", "area")

Kind = Literal["plan", "nozzle", "joint"]


@dataclass(frozen=True, eq=False)
class SteerOrder:
    """What the stick is to move, as ordered and recorded.

    Attributes:
        kind: Along the plan, the nozzle freely, or one joint.
        plan: The surface, for "plan".
        row, column: Node the arm stands on, for "plan".
        joint: Number from 1, for "joint".
        q: Joints as measured when it began [rad, m], for the jogs.
        scan: Folder inside the round whose surface the jogs keep clear of, empty for the round itself.
    """

    kind: Kind
    plan: SteerPlan | None = None
    row: int = 0
    column: int = 0
    joint: int = 0
    q: tuple[float, ...] = ()
    scan: str = ""


class KernelMaker:
    """Makes the kernel of an order; what is slow is done ahead, in the worker's thread."""

    def __init__(
        self,
        arm: Arm,
        config: SteerConfig,
        payload_kg: float,
        find_around: Callable[[str], Obstacles | None] = lambda scan: None,
    ) -> None:
        """Args: find_around: gives the surroundings of a scan where nobody has set them, as in a replay."""
        self._arm, self._config, self._payload = arm, config, payload_kg
        self._find_around = find_around
        self._around: Obstacles | None = None
        self._around_of: str | None = None
        self._ready: tuple[SteerOrder, Kernel] | None = None

    def set_around(self, around: Obstacles | None, scan: str = "") -> None:
        """Give the surroundings for the jogs, and the scan they were seen in."""
        self._around, self._around_of = around, scan

    def prepare(self, order: SteerOrder) -> None:
        """Make a kernel now, for an order to come."""
        self._ready = (order, self._make(order))

    def take(self, order: SteerOrder) -> Kernel:
        """Return the kernel of an order; quick if it was prepared."""
        ready, self._ready = self._ready, None
        return ready[1] if ready is not None and ready[0] is order else self._make(order)

    def _make(self, order: SteerOrder) -> Kernel:
        if order.kind == "plan":
            assert order.plan is not None
            surface = SteerSurface(order.plan, self._arm, self._payload, self._config.turn_m)
            steering = Steering(surface, self._config, self._arm.max_speed)
            steering.begin(order.row, order.column)
            return steering
        if order.scan != self._around_of:
            self.set_around(self._find_around(order.scan), order.scan)
        jog: CartesianJog | JointJog
        if order.kind == "nozzle":
            jog = CartesianJog(self._arm, self._config, self._payload, self._distance())
        else:
            jog = JointJog(self._arm, order.joint, self._config, self._payload, self._distance())
        jog.begin(np.array(order.q))
        return jog

    def _distance(self) -> Distance | None:
        around, arm = self._around, self._arm
        if around is None or arm.description.clearance is None:
            return None
        least_distance(arm, arm.zero_pose, around)  # loads the machine code here, not in a control cycle
        return lambda q: float(least_distance(arm, q, around)[0])
