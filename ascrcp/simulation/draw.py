"""Draw rigs at random: ranges of parameters -> one machine of the class, as an overlay (--rig)."""

from collections.abc import Callable
from typing import Annotated, Any

import msgspec
import numpy as np

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG
from ascrcp.simulation.parameter import ArmConfig, JointConfig

RANGE_FILE = CONFIG / "simulation" / "range.yaml"

CYLINDERS = (2, 3, 4, 5, 6)
"""Joints moved by differential cylinders, faster one way than the other."""

Span = Annotated[list[float], msgspec.Meta(min_length=2, max_length=2)]


class _Spans(Struct):
    """Base of the groups: every entry is [low, high]."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            low, high = getattr(self, name)
            if not low <= high:
                raise ConfigError(f"range {name}: {low} must not be above {high}")


class ValveRange(_Spans):
    """Ranges of proportional valves."""

    dead_band: Span
    frequency_hz: Span
    damping: Span
    dead_time_s: Span


class JointRange(_Spans):
    """Ranges of all joints."""

    speed_factor: Span
    area_ratio: Span
    load_factor: Span


class StickSlipRange(_Spans):
    """Ranges of the motors that stick."""

    breakaway: Span
    hold_share: Span
    creep_factor: Span


class SensorRange(_Spans):
    """Ranges of joint sensors."""

    noise_factor: Span
    lag_s: Span


class MachineRange(_Spans):
    """Ranges of slew drive and supply."""

    backlash_deg: Span
    supply_lpm: Span


class OilRange(_Spans):
    """Ranges of the oil."""

    start_c: Span
    gain_per_c: Span


class FlexureRange(_Spans):
    """Ranges of the boom's bending."""

    sag_mm: Span
    payload_sag_mm: Span
    exponent: Span
    frequency_hz: Span
    damping: Span
    participation: Span


class HoseRange(_Spans):
    """Ranges of what the hose adds."""

    fill_kg: Span
    surge_kg: Span


class RigRange(Struct):
    """Everything that is drawn: config/simulation/range.yaml."""

    valve: ValveRange
    joint: JointRange
    stick_slip: StickSlipRange
    sensor: SensorRange
    machine: MachineRange
    oil: OilRange
    flexure: FlexureRange
    hose: HoseRange


def load_range() -> RigRange:
    """Read config/simulation/range.yaml."""
    return load(RANGE_FILE, RigRange)


def draw_rig(arm: ArmConfig, ranges: RigRange, rng: np.random.Generator) -> dict[str, Any]:
    """Draw one machine.

    Args:
        arm: The machine factors are on.
        ranges: What to draw from, evenly.
        rng: Source of chance.

    Returns:
        Overlay of the rig's parameters: {"arm": ...}.
    """

    def pick(span: list[float]) -> float:
        return float(rng.uniform(span[0], span[1]))

    joints = {
        f"j{number}": _draw_joint(number, joint, ranges, pick)
        for number, joint in enumerate(arm.joints.rows, start=1)
    }
    f = ranges.flexure
    mode = {name: pick(getattr(f, name)) for name in ("frequency_hz", "damping", "participation")}
    lateral = {**mode, "frequency_hz": mode["frequency_hz"] * _stiffer(arm)}
    tree: dict[str, Any] = {
        "backlash_deg": pick(ranges.machine.backlash_deg),
        "joints": joints,
        "oil": {
            "supply_lpm": pick(ranges.machine.supply_lpm),
            "start_c": pick(ranges.oil.start_c),
            "gain_per_c": pick(ranges.oil.gain_per_c),
        },
        "flexure": {
            **{name: pick(getattr(f, name)) for name in ("sag_mm", "payload_sag_mm", "exponent")},
            "vertical": mode,
            "lateral": lateral,
        },
        "hose": {"fill_kg": pick(ranges.hose.fill_kg), "surge_kg": pick(ranges.hose.surge_kg)},
    }
    return {"arm": tree}


def _stiffer(arm: ArmConfig) -> float:
    """How much stiffer the boom is sideways."""
    return arm.flexure.lateral.frequency_hz / arm.flexure.vertical.frequency_hz


def _draw_joint(
    number: int, joint: JointConfig, ranges: RigRange, pick: Callable[[list[float]], float]
) -> dict[str, Any]:
    slow, fast = sorted(joint.speed)
    middle = (slow * fast) ** 0.5 * pick(ranges.joint.speed_factor)
    ratio = pick(ranges.joint.area_ratio) ** 0.5 if number in CYLINDERS else 1.0
    down_is_fast = joint.speed[0] >= joint.speed[1]
    speed = [middle * ratio, middle / ratio] if down_is_fast else [middle / ratio, middle * ratio]
    valve = ranges.valve
    tree: dict[str, Any] = {
        "speed": speed,
        "valve": {
            "dead_band": [pick(valve.dead_band), pick(valve.dead_band)],
            "frequency_hz": pick(valve.frequency_hz),
            "damping": pick(valve.damping),
            "dead_time_s": pick(valve.dead_time_s),
        },
        "sensor": {"noise": joint.sensor.noise * pick(ranges.sensor.noise_factor)},
    }
    if joint.sensor.lag_s > 0.0:
        tree["sensor"]["lag_s"] = pick(ranges.sensor.lag_s)
    if joint.load.kind != "none":
        factor = pick(ranges.joint.load_factor)
        tree["load"] = {"kind": joint.load.kind, "share": joint.load.share * factor}
        tree["load"]["payload_share"] = joint.load.payload_share * factor
    if joint.stiction.breakaway > 0.0:
        breakaway = pick(ranges.stick_slip.breakaway)
        tree["stiction"] = {
            "breakaway": breakaway,
            "hold": breakaway * pick(ranges.stick_slip.hold_share),
            "creep_speed": joint.stiction.creep_speed * pick(ranges.stick_slip.creep_factor),
        }
        tree["valve"]["dead_band"] = [
            min(b, 0.8 * tree["stiction"]["hold"]) for b in tree["valve"]["dead_band"]
        ]
    return tree
