"""The nozzle: where it is, where it should be, how far off, and the points done (thesis 6.1.2)."""

from ascrcp.hmi import quantity
from ascrcp.hmi.panel import ValuePanel
from ascrcp.hmi.text import say
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import Mode

ROWS = ("position", "wanted", "direction", "nozzle_error", "points", "spray")


class NozzlePanel(ValuePanel):
    """Automatic module and semi-automatic module in one: the mode decides title and spray row."""

    def __init__(self) -> None:
        super().__init__(ROWS)

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
        self.show_values(shown)

    def _describe_spray(self, snapshot: Snapshot, is_semi: bool) -> str:
        text = say("spray_on" if snapshot.spraying else "spray_off", self.language)
        if not is_semi:
            return text
        joystick = "joystick_present" if snapshot.job.has_joystick else "joystick_absent"
        return f"{say('spray_operator', self.language)}, {say(joystick, self.language)}"
