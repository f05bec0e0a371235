"""What was wrong and when: the gate's causes, cycle by cycle -> the history the screen lists."""

from dataclasses import dataclass, replace

KEPT = 200
"""Alarms remembered; older ones are in the round's journal."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One cause from its coming to its going.

    Attributes:
        number: Running number from 1.
        code: Of core.event.EVENTS.
        began_s: Job time at which it came [s].
        ended_s: Job time at which it went [s], None while it is there.
        first: Whether it came while nothing else was wrong: the first-out alarm.
    """

    number: int
    code: str
    began_s: float
    ended_s: float | None = None
    first: bool = True


class AlarmHistory:
    """Alarms by rising number; read from any thread, written by the control thread alone."""

    def __init__(self) -> None:
        self.alarms: tuple[Alarm, ...] = ()

    def update(self, t_s: float, causes: tuple[str, ...]) -> None:
        """Take the causes in force from this instant on, first cause first."""
        open_codes = [alarm.code for alarm in self.alarms if alarm.ended_s is None]
        alarms = [
            replace(alarm, ended_s=t_s) if alarm.ended_s is None and alarm.code not in causes else alarm
            for alarm in self.alarms
        ]
        was_calm = not open_codes
        for code in causes:
            if code not in open_codes:
                number = alarms[-1].number + 1 if alarms else 1
                alarms.append(Alarm(number, code, t_s, first=was_calm))
                was_calm = False
        self.alarms = tuple(alarms[-KEPT:])
