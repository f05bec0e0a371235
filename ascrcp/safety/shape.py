"""Shapes of a command: finite gate and ramp (F15, R2)."""

from collections.abc import Sequence

from ascrcp.core.machine_io import Command

_INF = float("inf")
_ROUNDING = 1e-9
"""Share of a ramp step forgiven, so that ten steps of 0.1 do reach from 1 to 0."""


def is_finite(command: Command, joints: int) -> bool:
    """Whether a command has one finite drive per joint and finite spray values."""
    values = [*command.drive, command.pump, command.accelerator]
    if command.pan_target is not None:
        values.append(command.pan_target)
    return len(command.drive) == joints and all(abs(v) < _INF for v in values)


def ramped(last: Sequence[float], target: Sequence[float], ramp: Sequence[float]) -> tuple[float, ...]:
    """Move each drive toward its target by at most its ramp (thesis 5.2.2, ramp function).

    Args:
        last: Drives of the last cycle.
        target: Wanted drives, finite.
        ramp: Largest change per cycle and joint.
    """
    return tuple(_step(a, b, r) for a, b, r in zip(last, target, ramp, strict=True))


def _step(last: float, target: float, ramp: float) -> float:
    change = target - last
    if abs(change) <= ramp * (1.0 + _ROUNDING):
        return target
    return last + ramp if change > 0.0 else last - ramp
