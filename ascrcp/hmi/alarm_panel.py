"""The alarm that came first, with cause, effect and action, and the last messages beside it."""

import html

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QVBoxLayout

from ascrcp.core.event import EVENTS, Event
from ascrcp.hmi.panel import Panel, make_label
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.snapshot import Announcement, Snapshot

PANEL_PX = 112
"""Four lines and a margin [px], with an alarm or without."""
LINE_PX = 19
"""Height of one line of a message, so that an older one that does not fit is left out whole [px]."""
MESSAGES = 4
"""Announcements shown at once; newest on top."""


def mark_message(message: Announcement, language: Language) -> str:
    """Return an announcement as rich text, with a mark that says success or failure without colour."""
    text = html.escape(message.text[language])
    return f"<b>✖ {text}</b>" if message.failure else f"✔ {text}"


class AlarmPanel(Panel):
    """First-out alarm at the left, announcements at the right."""

    def __init__(self) -> None:
        super().__init__(framed=False)
        self.setFixedHeight(PANEL_PX)
        self._newest = 0
        self._refusal: Announcement | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        alarm = Panel()
        grid = QGridLayout(alarm)
        grid.setContentsMargins(8, 4, 8, 4)
        grid.setVerticalSpacing(1)
        self.title = make_label("alarm")
        grid.addWidget(self.title, 0, 0, 1, 2)
        self.rows = {
            key: (make_label("title", width=60), make_label("value"))
            for key in ("cause", "consequence", "action")
        }
        for line, (name, value) in enumerate(self.rows.values(), 1):
            grid.addWidget(name, line, 0)
            grid.addWidget(value, line, 1)
        grid.setColumnStretch(1, 1)
        row.addWidget(alarm, 3)
        messages = Panel()
        column = QVBoxLayout(messages)
        column.setContentsMargins(8, 4, 8, 4)
        column.setSpacing(1)
        self.heading = make_label("title")
        column.addWidget(self.heading)
        self.messages = make_label("message", wrap=True)
        self.messages.setTextFormat(Qt.TextFormat.RichText)
        self.messages.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.messages.setFixedHeight(MESSAGES * LINE_PX)
        column.addWidget(self.messages)
        column.addStretch()
        row.addWidget(messages, 2)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.heading.setText(say("messages", language))
        for key, (name, _) in self.rows.items():
            name.setText(say(key, language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the first cause and the newest messages."""
        self._show_alarm(snapshot.causes)
        messages = snapshot.announcements
        self._newest = messages[-1].number if messages else 0
        if self._refusal is not None and self._refusal.number == self._newest:
            messages = (*messages, self._refusal)
        newest = messages[: -MESSAGES - 1 : -1]
        self.messages.setText("<br>".join(mark_message(message, self.language) for message in newest))

    def show_refusal(self, reason: tuple[str, str]) -> None:
        """Say why a pressed step did not start, until the session has a newer message."""
        self._refusal = Announcement(self._newest, reason, failure=True)

    def _show_alarm(self, causes: tuple[str, ...]) -> None:
        for name, _ in self.rows.values():
            name.setVisible(bool(causes))
        if not causes:
            self.title.setText(say("no_alarm", self.language))
            set_look(self.title, "calm")
            for _, value in self.rows.values():
                value.setText("")
            return
        event = EVENTS.get(causes[0])
        is_fault = event is None or event.fault != ""  # a stop or a start-up is no fault
        fault = event.fault if event is not None else ""
        title = say("alarm" if is_fault else "notice", self.language).format(fault=fault)
        if len(causes) > 1:
            title += f"   ({say('first_of', self.language).format(n=len(causes))})"
        self.title.setText(title)
        set_look(self.title, "danger" if is_fault else "abnormal")
        for key, (_, value) in self.rows.items():
            value.setText(self._describe(event, causes[0], key))

    def _describe(self, event: Event | None, code: str, key: str) -> str:
        if event is None:  # newer than this screen's table: show its code rather than nothing
            return code if key == "cause" else ""
        return {"cause": event.cause, "consequence": event.consequence, "action": event.action}[key][
            self.language
        ]
