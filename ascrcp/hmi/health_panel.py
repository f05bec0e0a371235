"""How machine, bus and cycle are: load, ages, temperature, lateness, and the nozzle's pose with its error."""

import math

from ascrcp.core.machine_io import NEVER_NS, MachineInputs
from ascrcp.hmi import quantity
from ascrcp.hmi.panel import ValuePanel
from ascrcp.hmi.text import Language, say
from ascrcp.session.snapshot import Snapshot

BITRATE = 1_000_000
"""Of the bus [bit/s]: config/devices/can.yaml reckons with it."""
CYCLE_S = 0.02
FRAME_BITS, STUFFING = 47, 1.2
"""Bits of a base frame besides its data, and what stuffing adds at most (ISO 11898-1)."""

ROWS = (
    "position", "direction", "nozzle_error", "bus_load", "bus_bad", "sensor_age", "controller_age",
    "controller_state", "oil_temp", "pump_flow", "late_p50", "late_p99", "late_max", "late_missed",
)  # fmt: skip


def bus_load(frames: tuple[tuple[int, bytes], ...]) -> float:
    """Return the share of the bus that the frames of one cycle take."""
    bits = sum(STUFFING * (FRAME_BITS + 8 * len(data)) for _, data in frames)
    return bits / (BITRATE * CYCLE_S)


def show_age(age_ns: int, language: Language) -> str:
    """Return an age as text."""
    if age_ns >= NEVER_NS:
        return say("never", language)
    return say("ago", language).format(value=quantity.AGE_MS.show(age_ns * 1e-6))


def controller_key(inputs: MachineInputs) -> str:
    """Return the key of the motion controller's state."""
    if inputs.controller_tripped:
        return "controller_tripped"
    return "controller_on" if inputs.controller_enabled else "controller_off"


def describe_health(snapshot: Snapshot, language: Language) -> dict[str, str]:
    """Return the text of every row."""
    late = snapshot.lateness
    rate = say("bus_value", language).format(
        load=quantity.PROGRESS.show(bus_load(snapshot.frames)),
        frames=quantity.RATE.show(len(snapshot.frames) / CYCLE_S),
    )
    shown = {
        "position": quantity.show_point(snapshot.tip, quantity.STATION),
        "direction": quantity.show_point(snapshot.tip_direction, quantity.DIRECTION),
        "nozzle_error": f"{quantity.TIP_ERROR_MM.show(snapshot.tip_error_mm)}   "
        f"{quantity.TIP_ERROR_DEG.show(snapshot.tip_error_deg)}",
        "bus_load": rate,
        "oil_temp": quantity.TEMPERATURE.show(snapshot.oil_temp_c),
        "late_p50": quantity.LATENESS_MS.show(late.p50),
        "late_p99": quantity.LATENESS_MS.show(late.p99_9),
        "late_max": quantity.LATENESS_MS.show(late.max),
        "late_missed": str(late.missed),
    }
    inputs = snapshot.inputs
    if inputs is None:
        return {key: shown.get(key, quantity.NOTHING) for key in ROWS}
    oldest = max(inputs.age_ns, default=NEVER_NS)
    number = inputs.age_ns.index(oldest) + 1 if inputs.age_ns else 0
    shown |= {
        "bus_bad": str(inputs.bad_frames),
        "sensor_age": f"{number}: {show_age(oldest, language)}",
        "controller_age": show_age(inputs.controller_age_ns, language),
        "controller_state": say(controller_key(inputs), language),
        "pump_flow": quantity.PROGRESS.show(inputs.pump_flow)
        if math.isfinite(inputs.pump_flow)
        else quantity.NOTHING,
    }
    return shown


class HealthPanel(ValuePanel):
    """Bus, sensors, controller and cycle."""

    def __init__(self) -> None:
        super().__init__(ROWS)

    def set_language(self, language: Language) -> None:
        """Write title and names in a language."""
        super().set_language(language)
        self.title.setText(say("health", language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the values."""
        self.show_values(describe_health(snapshot, self.language))
