"""One bar on every page: the alarm that came first with its cause and what to do, and the newest message."""

import html

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QVBoxLayout

from ascrcp.core.event import EVENTS, Event
from ascrcp.hmi.panel import Panel, make_label, set_text
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.snapshot import Announcement, Snapshot

BAR_PX = 92
MESSAGES = 3
"""Announcements shown at once; newest on top."""
LINE_PX = 22


def mark_message(message: Announcement, language: Language) -> str:
    """Return an announcement as rich text, with a mark that says success or failure without colour."""
    text = html.escape(message.text[language])
    return f"<b>✖ {text}</b>" if message.failure else f"✔ {text}"


def describe(event: Event | None, code: str, key: str, language: Language) -> str:
    """Return cause, consequence or action of an event; of one newer than this table its code."""
    if event is None:
        return code if key == "cause" else ""
    return {"cause": event.cause, "consequence": event.consequence, "action": event.action}[key][language]


def alarm_title(causes: tuple[str, ...], language: Language) -> tuple[str, str]:
    """Return title and look of the first cause; a stop or a start-up is a notice, no alarm."""
    if not causes:
        return say("no_alarm", language), "calm"
    event = EVENTS.get(causes[0])
    is_fault = event is None or event.fault != ""
    fault = event.fault if event is not None else ""
    title = say("alarm" if is_fault else "notice", language).format(fault=fault)
    if len(causes) > 1:
        title += f"   ({say('first_of', language).format(n=len(causes))})"
    return title, "danger" if is_fault else "abnormal"


class AlarmBar(Panel):
    """First-out alarm at the left, announcements at the right."""

    def __init__(self) -> None:
        super().__init__(framed=False)
        self.setFixedHeight(BAR_PX)
        self._newest = 0
        self._shown: tuple[object, ...] = ()
        self._refusal: Announcement | None = None
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(8)
        alarm = Panel()
        grid = QGridLayout(alarm)
        grid.setContentsMargins(8, 4, 8, 4)
        grid.setVerticalSpacing(0)
        self.title = make_label("alarm")
        grid.addWidget(self.title, 0, 0, 1, 2)
        self.rows = {key: (make_label("title", width=66), make_label("value")) for key in ("cause", "action")}
        for line, (name, value) in enumerate(self.rows.values(), 1):
            grid.addWidget(name, line, 0)
            grid.addWidget(value, line, 1)
        grid.setColumnStretch(1, 1)
        row.addWidget(alarm, 3)
        messages = Panel()
        column = QVBoxLayout(messages)
        column.setContentsMargins(8, 2, 8, 2)
        column.setSpacing(0)
        self.messages = make_label("message", wrap=True)
        self.messages.setTextFormat(Qt.TextFormat.RichText)
        self.messages.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.messages.setFixedHeight(BAR_PX - 8)
        column.addWidget(self.messages)
        row.addWidget(messages, 2)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self._shown = ()
        for key, (name, _) in self.rows.items():
            name.setText(say(key, language))

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the first cause and the newest messages, if they changed."""
        messages = snapshot.announcements
        self._newest = messages[-1].number if messages else 0
        if self._refusal is not None and self._refusal.number == self._newest:
            messages = (*messages, self._refusal)
        shown = (snapshot.causes, messages, self.language)
        if shown == self._shown:
            return
        self._shown = shown
        self._show_alarm(snapshot.causes)
        newest = messages[: -MESSAGES - 1 : -1]
        self.messages.setText("<br>".join(mark_message(message, self.language) for message in newest))

    def show_refusal(self, reason: tuple[str, str]) -> None:
        """Say why a pressed step did not start, until the session has a newer message."""
        self._refusal = Announcement(self._newest, reason, failure=True)

    def _show_alarm(self, causes: tuple[str, ...]) -> None:
        title, look = alarm_title(causes, self.language)
        set_text(self.title, title)
        set_look(self.title, look)
        event = EVENTS.get(causes[0]) if causes else None
        for key, (name, value) in self.rows.items():
            name.setVisible(bool(causes))
            set_text(value, describe(event, causes[0], key, self.language) if causes else "")
