"""The semi-automatic page: the operator's stick moves the nozzle along the plan (thesis 6.1.2)."""

from PySide6.QtWidgets import QVBoxLayout

from ascrcp.hmi.contract import Session
from ascrcp.hmi.nozzle_panel import NozzlePanel
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import make_label
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.session.snapshot import Snapshot


class SemiAutomaticPage(Page):
    """Where the nozzle is and what the stick may do."""

    key = "semi"

    def __init__(self, session: Session, screen: Screen) -> None:
        super().__init__()
        self.hint = make_label("value", wrap=True)
        self.nozzle = NozzlePanel()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.hint)
        column.addWidget(self.nozzle)
        column.addStretch()

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.hint.setText(say("semi_hint", language))
        self.nozzle.set_language(language)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Draw the nozzle."""
        self.nozzle.show_snapshot(snapshot)
