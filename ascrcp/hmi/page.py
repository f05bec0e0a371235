"""A page: what the middle of the window shows, chosen on the strip of pages."""

from typing import ClassVar

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QPushButton

from ascrcp.hmi.panel import Panel, make_button
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.snapshot import Scene, Snapshot


class Page(Panel):
    """One page. Only the one in front draws; all may take notes.

    Attributes:
        key: Its name among the texts and the pictures.
    """

    key: ClassVar[str] = ""

    def __init__(self) -> None:
        super().__init__(framed=False)

    def note_snapshot(self, snapshot: Snapshot) -> None:
        """Take from every snapshot what must not be missed, in front or not; microseconds."""

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw a snapshot; called while the page is in front."""

    def show_scene(self, scene: Scene) -> None:
        """Take a new scene; called once for each version, in front or not."""

    def keep_stick(self) -> None:
        """Say again what the stick on this page does; called every `stick_ms` while it is in front."""

    def leave(self) -> None:
        """End what must not go on while another page is in front."""


class PageStrip(Panel):
    """One button a page, F1 to F6 on the keyboard; the alarm page's says how many are active."""

    chosen = Signal(str)

    def __init__(self, keys: tuple[str, ...]) -> None:
        super().__init__(framed=False)
        self.buttons: dict[str, QPushButton] = {}
        self._alarms = 0
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(6)
        for key in keys:
            button = make_button("page", name=f"page_{key}", checkable=True)
            button.clicked.connect(lambda _=False, key=key: self.chosen.emit(key))
            row.addWidget(button, 1)
            self.buttons[key] = button

    def show_front(self, front: str) -> None:
        """Mark the page in front."""
        for key, button in self.buttons.items():
            button.setChecked(key == front)

    def set_language(self, language: Language) -> None:
        """Write the pages' names."""
        super().set_language(language)
        for number, (key, button) in enumerate(self.buttons.items(), 1):
            button.setText(f"{say(f'page_{key}', language)}\nF{number}")
        self._mark()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Say on the alarm page's button how many alarms there are."""
        if len(snapshot.causes) != self._alarms:
            self._alarms = len(snapshot.causes)
            self._mark()

    def _mark(self) -> None:
        button = self.buttons.get("alarms")
        if button is None:
            return
        name = say("page_alarms", self.language)
        number = list(self.buttons).index("alarms") + 1
        button.setText(f"▲ {name}: {self._alarms}\nF{number}" if self._alarms else f"{name}\nF{number}")
        set_look(button, "alarm" if self._alarms else "calm")
