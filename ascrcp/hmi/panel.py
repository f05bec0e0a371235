"""The pieces every panel is built of: labels, buttons and frames with a role in the style sheet."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel, QPushButton, QSizePolicy, QWidget

from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen


class Panel(QFrame):
    """A part of the window that draws snapshots in the language and theme it is set to."""

    def __init__(self, parent: QWidget | None = None, *, framed: bool = True) -> None:
        super().__init__(parent)
        self.language = Language.EN
        self.setProperty("panel", framed)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language; the next snapshot brings the others."""
        self.language = language

    def set_theme(self, screen: Screen) -> None:
        """Take the colours that the style sheet cannot give: of what is painted by hand."""


def make_label(role: str = "value", *, wrap: bool = False, centred: bool = False, width: int = 0) -> QLabel:
    """Return a label with a role of the style sheet.

    Its width is the one given [px] or follows the layout, never the text: a longer number does not
    move its neighbours.
    """
    label = QLabel()
    label.setProperty("role", role)
    label.setTextFormat(Qt.TextFormat.PlainText)
    label.setWordWrap(wrap)
    if width:
        label.setFixedWidth(width)
    else:
        label.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    if centred:
        label.setAlignment(Qt.AlignmentFlag.AlignCenter)
    return label


def make_button(role: str = "", *, name: str = "", checkable: bool = False) -> QPushButton:
    """Return a button for gloves.

    A touch gives it no keyboard focus; the tab key does, and Enter presses it: the space bar means
    stop everywhere.
    """
    button = QPushButton()
    button.setProperty("role", role)
    button.setObjectName(name)
    button.setCheckable(checkable)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    return button


def set_text(label: QLabel, text: str) -> None:
    """Write a label's text; costs little when it has it already."""
    if label.text() != text:
        label.setText(text)
