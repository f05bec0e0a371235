"""The bottom line: cycle lateness, oil temperature, job time, speed, round."""

from pathlib import PurePath

from PySide6.QtWidgets import QHBoxLayout

from ascrcp.hmi import quantity
from ascrcp.hmi.panel import Panel, make_label
from ascrcp.hmi.text import say
from ascrcp.session.snapshot import Snapshot

FIELDS = {"cycle": 6, "oil": 2, "job_time": 2, "speed": 2, "round": 4}
"""Shown fields and their share of the width."""


def describe_status(snapshot: Snapshot) -> dict[str, dict[str, str]]:
    """Return the numbers of each field, with units."""
    late = snapshot.lateness
    return {
        "cycle": {
            "p50": quantity.LATENESS_MS.number(late.p50),
            "p99_9": quantity.LATENESS_MS.number(late.p99_9),
            "max": quantity.LATENESS_MS.show(late.max),
            "missed": str(late.missed),
        },
        "oil": {"value": quantity.TEMPERATURE.show(snapshot.oil_temp_c)},
        "job_time": {"value": quantity.show_duration(snapshot.t_s)},
        "speed": {"value": quantity.SPEED.show(snapshot.realtime_factor)},
        "round": {"value": PurePath(snapshot.round_dir).name or quantity.NOTHING},
    }


class StatusLine(Panel):
    """One line of small print."""

    def __init__(self) -> None:
        super().__init__(framed=False)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(12)
        self.fields = {key: make_label("small") for key in FIELDS}
        for key, label in self.fields.items():
            row.addWidget(label, FIELDS[key])

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the numbers."""
        for key, values in describe_status(snapshot).items():
            self.fields[key].setText(say(key, self.language).format(**values))
