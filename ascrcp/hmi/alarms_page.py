"""The alarm page: the first alarm with cause, effect and action, and everything that came before."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QVBoxLayout

from ascrcp.core.event import EVENTS
from ascrcp.hmi import quantity
from ascrcp.hmi.alarm_bar import alarm_title, describe
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.quantity import show_duration
from ascrcp.hmi.table import TextTable
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.alarm_history import Alarm
from ascrcp.session.snapshot import Snapshot

ROWS = 6
"""Alarms on one page of the history."""
KEYS = ("cause", "consequence", "action")


def alarm_row(alarm: Alarm, now_s: float, language: Language) -> tuple[str, ...]:
    """Return an alarm's cells: time, rank, fault, cause, how long it lasted."""
    event = EVENTS.get(alarm.code)
    lasted = (
        f"{say('alarm_active', language)} {show_duration(now_s - alarm.began_s)}"
        if alarm.ended_s is None
        else show_duration(alarm.ended_s - alarm.began_s)
    )
    fault = (event.fault if event is not None else alarm.code) or quantity.NOTHING
    rank = say("alarm_first" if alarm.first else "alarm_also", language)
    return (
        show_duration(alarm.began_s),
        rank,
        fault,
        describe(event, alarm.code, "cause", language),
        lasted,
    )


class AlarmsPage(Page):
    """First out above, history below, newest on top."""

    key = "alarms"

    def __init__(self) -> None:
        super().__init__()
        self._first_row = 0
        self._shown: tuple[object, ...] = ()
        top = Panel()
        grid = QGridLayout(top)
        grid.setContentsMargins(10, 6, 10, 6)
        self.title = make_label("alarm")
        grid.addWidget(self.title, 0, 0, 1, 2)
        self.rows = {key: (make_label("title", width=80), make_label("value", wrap=True)) for key in KEYS}
        for line, (name, value) in enumerate(self.rows.values(), 1):
            grid.addWidget(name, line, 0, Qt.AlignmentFlag.AlignTop)
            grid.addWidget(value, line, 1)
        grid.setColumnStretch(1, 1)
        self.table = TextTable(
            ("alarm_time", "alarm_first", "alarm_code", "cause", "alarm_lasted"), (140, 80, 90, 0, 190), ROWS
        )
        self.heading, self.place = make_label("title"), make_label("small", centred=True, width=190)
        self.newer, self.older = make_button("plain", name="newer"), make_button("plain", name="older")
        self.newer.clicked.connect(lambda: self._page(-ROWS))
        self.older.clicked.connect(lambda: self._page(ROWS))
        buttons = QHBoxLayout()
        buttons.addWidget(self.heading, 1)
        for widget in (self.newer, self.place, self.older):
            buttons.addWidget(widget)
        self.newer.setFixedWidth(140)
        self.older.setFixedWidth(140)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(6)
        column.addWidget(top)
        column.addLayout(buttons)
        column.addWidget(self.table)
        column.addStretch(1)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self._shown = ()
        self.heading.setText(say("history", language))
        self.newer.setText(say("alarm_newer", language))
        self.older.setText(say("alarm_older", language))
        self.table.set_language(language)
        for key, (name, _) in self.rows.items():
            name.setText(say(key, language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the first cause and the history, if they changed."""
        alarms = snapshot.alarms[::-1]
        self._first_row = max(0, min(self._first_row, len(alarms) - 1))
        shown = (snapshot.causes, alarms, self._first_row, int(snapshot.t_s), self.language)
        if shown == self._shown:
            return
        self._shown = shown
        self._show_first(snapshot.causes)
        rows = alarms[self._first_row : self._first_row + ROWS]
        self.table.show_rows([alarm_row(alarm, snapshot.t_s, self.language) for alarm in rows])
        last = self._first_row + len(rows)
        place = say("alarm_page_of", self.language).format(
            first=self._first_row + 1, last=last, all=len(alarms)
        )
        set_text(self.place, place if alarms else say("history_none", self.language))
        self.newer.setEnabled(self._first_row > 0)
        self.older.setEnabled(last < len(alarms))

    def _show_first(self, causes: tuple[str, ...]) -> None:
        title, look = alarm_title(causes, self.language)
        set_text(self.title, title)
        set_look(self.title, look)
        event = EVENTS.get(causes[0]) if causes else None
        for key, (_, value) in self.rows.items():
            set_text(value, describe(event, causes[0], key, self.language) if causes else quantity.NOTHING)

    def _page(self, rows: int) -> None:
        self._first_row = max(0, self._first_row + rows)
        self._shown = ()
