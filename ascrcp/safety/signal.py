"""Checks of what the bus told us: age, range, finiteness, jumps (F1, F3, F6, F7, F15, F20, F25, F30)."""

from ascrcp.core.clock import CYCLE_S, NS
from ascrcp.core.machine_io import MachineInputs
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.limit import Limits

_MS = 1_000_000
_INF = float("inf")


def find_signal_causes(inputs: MachineInputs, config: SafetyConfig, joints: int) -> list[str]:
    """Name the event of every signal that is pressed, stale, out of range or not finite.

    Args:
        inputs: This cycle's view of the machine.
        config: Limits of age and count.
        joints: Number of joints the arm has.

    Returns:
        Codes of core.event.EVENTS, hardest first.
    """
    causes = []
    if inputs.estop:
        causes.append("estop")
    if not inputs.estop_age_ns <= config.estop_stale_ms * _MS:
        causes.append("estop_stale")
    if not inputs.bus_ok:
        causes.append("bus_error")
    stale_ns = config.stale_ms * _MS
    complete = len(inputs.q) == len(inputs.age_ns) == len(inputs.in_range) == joints
    if not complete or any(not age <= stale_ns for age in inputs.age_ns):
        causes.append("joint_stale")
    if not all(inputs.in_range):
        causes.append("joint_range")
    if any(age <= stale_ns and not abs(q) < _INF for q, age in zip(inputs.q, inputs.age_ns, strict=False)):
        causes.append("not_finite")
    if not inputs.controller_age_ns <= config.controller_stale_ms * _MS:
        causes.append("controller_stale")
    if not inputs.bad_frames < config.bad_frames:
        causes.append("bad_frames")
    return causes


class JumpCheck:
    """Notice a joint value that moved faster than the joint can (F7).

    One such value is ignored (the last good one is held), `jump_count` in a row are a fault. Once
    the sensor has been steady at its new value for `jump_settle` new values, that value counts.
    """

    def __init__(self, limits: Limits, config: SafetyConfig) -> None:
        n = len(limits.revolute)
        self._noise = limits.per_joint(config.jump_noise_deg, config.jump_noise_mm)
        self._speed = tuple(v * config.jump_factor for v in limits.max_speed)
        self._count_limit = config.jump_count
        self._settle = config.jump_settle
        self._good: list[float | None] = [None] * n
        self._good_ns = [0] * n
        self._newest = [0.0] * n
        self._newest_ns = [-1] * n
        self._count = [0] * n

    def update(self, inputs: MachineInputs) -> bool:
        """Take in this cycle's values; return whether any joint has jumped."""
        jumped = False
        for j, (q, age) in enumerate(zip(inputs.q, inputs.age_ns, strict=False)):
            stamp = inputs.t_ns - age
            if j < len(self._good) and abs(q) < _INF and stamp > self._newest_ns[j]:
                self._take(j, q, stamp)
            if j < len(self._good) and self._count[j] >= self._count_limit:
                jumped = True
        return jumped

    def held(self, q: tuple[float, ...]) -> tuple[float, ...]:
        """Return the joint vector with the last good value where a jump is in doubt."""
        return tuple(
            q[j] if good is None or self._count[j] == 0 else good for j, good in enumerate(self._good)
        )

    def _take(self, j: int, q: float, stamp: int) -> None:
        good = self._good[j]
        if good is None or self._is_near(j, q - good, stamp - self._good_ns[j]):
            self._accept(j, q, stamp)
        elif self._count[j] == 0 or self._is_near(j, q - self._newest[j], stamp - self._newest_ns[j]):
            self._count[j] += 1
            if self._count[j] >= self._count_limit + self._settle:
                self._accept(j, q, stamp)
        else:
            self._count[j] = min(self._count[j] + 1, self._count_limit)
        self._newest[j], self._newest_ns[j] = q, stamp

    def _accept(self, j: int, q: float, stamp: int) -> None:
        self._good[j], self._good_ns[j], self._count[j] = q, stamp, 0

    def _is_near(self, j: int, step: float, elapsed_ns: int) -> bool:
        elapsed = max(elapsed_ns / NS, CYCLE_S)
        return abs(step) <= self._speed[j] * elapsed + self._noise[j]
