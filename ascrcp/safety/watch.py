"""Checks that need memory: following error, late cycles, the controller's echo (F11, F26, F28, F42)."""

from collections.abc import Sequence

from ascrcp.core.machine_io import MachineInputs
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.limit import Limits

_MS = 1_000_000


class FollowingCheck:
    """Compare each joint's following error with what its commanded speed excuses (F11)."""

    def __init__(self, limits: Limits, config: SafetyConfig) -> None:
        self._least = limits.per_joint(config.following_min_deg, config.following_min_mm)
        self._most = limits.per_joint(config.following_max_deg, config.following_max_mm)
        self._cycles = config.following_cycles
        self._count = self._far_count = 0

    def update(self, error: Sequence[float] | None, drive: Sequence[float]) -> str | None:
        """Take in one cycle while the arm is under command.

        Args:
            error: Target minus measured joints [rad or m], None while nothing is followed.
            drive: Drives now on the wire.

        Returns:
            "following_far" at twice the allowed error, "following_error" beyond it, else None.
        """
        worst = 0.0
        if error is not None:
            for e, d, least, most in zip(error, drive, self._least, self._most, strict=False):
                ratio = abs(e) / (least + (most - least) * abs(d))
                if not ratio <= worst:
                    worst = ratio
        self._count = 0 if worst <= 1.0 else self._count + 1
        self._far_count = 0 if worst <= 2.0 else self._far_count + 1
        if self._far_count >= self._cycles:
            return "following_far"
        return "following_error" if self._count >= self._cycles else None

    def clear(self) -> None:
        """Forget what was counted: the arm is not under command."""
        self._count = self._far_count = 0


class CycleCheck:
    """Notice late control cycles from the instants of the inputs (F28, F42)."""

    def __init__(self, config: SafetyConfig) -> None:
        self._late_ns = config.late_cycle_ms * _MS
        self._stop_ns = config.stop_cycle_ms * _MS
        self._suspended_ns = config.suspended_ms * _MS
        self._late_count = config.late_count
        self._mask = (1 << config.late_window) - 1
        self._history = 0
        self._last_ns: int | None = None

    def update(self, t_ns: int) -> list[str]:
        """Return "suspended", "cycle_late" or "cycle_slow" for the gap since the last call."""
        last, self._last_ns = self._last_ns, t_ns
        gap = self._late_ns if last is None else t_ns - last
        is_late = not 0 < gap <= self._late_ns
        self._history = ((self._history << 1) | is_late) & self._mask
        causes = []
        if gap > self._suspended_ns:
            causes.append("suspended")
        if not 0 < gap <= self._stop_ns or self._history.bit_count() >= self._late_count:
            causes.append("cycle_late")
        elif is_late:
            causes.append("cycle_slow")
        return causes


class EchoCheck:
    """Compare the controller's echo of our enable bit with what was sent (F26)."""

    def __init__(self, config: SafetyConfig) -> None:
        self._cycles = config.echo_cycles
        self._count = 0

    def update(self, inputs: MachineInputs, sent_enable: bool) -> bool:
        """Return whether the controller has contradicted us for `echo_cycles` cycles.

        Args:
            inputs: This cycle's view; an echo takes one or two cycles to come back.
            sent_enable: Enable bit of the last command sent.
        """
        agrees = inputs.controller_enabled == sent_enable and not (sent_enable and inputs.controller_tripped)
        self._count = 0 if agrees else self._count + 1
        return self._count >= self._cycles
