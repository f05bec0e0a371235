"""The nozzle: where it is, where it should be, how far off, and the points done (thesis 6.1.2)."""

from PySide6.QtWidgets import QGridLayout

from ascrcp.hmi import quantity
from ascrcp.hmi.panel import Panel, make_label
from ascrcp.hmi.text import Language, say
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Mode

ROWS = ("position", "wanted", "direction", "nozzle_error", "points", "spray")


NAME_PX = 124


class NozzlePanel(Panel):
    """Automatic module and semi-automatic module in one: the mode decides title and spray row."""

    def __init__(self) -> None:
        super().__init__()
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 4, 8, 4)
        grid.setVerticalSpacing(0)
        self.title = make_label("title")
        grid.addWidget(self.title, 0, 0, 1, 2)
        self.names = {key: make_label("muted", width=NAME_PX) for key in ROWS}
        self.values = {key: make_label("value") for key in ROWS}
        for line, key in enumerate(ROWS, 1):
            grid.addWidget(self.names[key], line, 0)
            grid.addWidget(self.values[key], line, 1)
        grid.setColumnStretch(1, 1)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        for key, label in self.names.items():
            label.setText(say(key, language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the nozzle's motion."""
        language = self.language
        is_semi = snapshot.job.mode is Mode.SEMI_AUTOMATIC
        self.title.setText(say("nozzle_semi" if is_semi else "nozzle_auto", language))
        error = (
            quantity.TIP_ERROR_MM.show(snapshot.tip_error_mm),
            quantity.TIP_ERROR_DEG.show(snapshot.tip_error_deg),
        )
        points = say("points_value", language).format(
            reached=snapshot.reached, points=snapshot.points, skipped=snapshot.skipped
        )
        shown = {
            "position": quantity.show_point(snapshot.tip, quantity.POSITION),
            "wanted": quantity.show_point(snapshot.tip_target, quantity.POSITION),
            "direction": quantity.show_point(snapshot.tip_direction, quantity.DIRECTION),
            # between strokes the nozzle is on its way, not off it
            "nozzle_error": "   ".join(error) if snapshot.spraying else quantity.NOTHING,
            "points": points,
            "spray": self._describe_spray(snapshot, is_semi),
        }
        for key, text in shown.items():
            self.values[key].setText(text)

    def _describe_spray(self, snapshot: Snapshot, is_semi: bool) -> str:
        text = say("spray_on" if snapshot.spraying else "spray_off", self.language)
        if not is_semi:
            return text
        joystick = "joystick_present" if snapshot.job.has_joystick else "joystick_absent"
        return f"{say('spray_operator', self.language)}, {say(joystick, self.language)}"
