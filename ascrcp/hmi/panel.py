"""The pieces every panel is built of: labels, buttons and frames with a role in the style sheet."""

from collections.abc import Mapping, Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QPushButton, QSizePolicy, QWidget

from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen

NAME_PX = 124
"""Width of the names at the left of values [px]."""


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


class ValuePanel(Panel):
    """A title, then names at the left and values at the right."""

    def __init__(self, rows: Sequence[str]) -> None:
        """Args: rows: keys of the names' texts, in order; values are kept by them too."""
        super().__init__()
        grid = QGridLayout(self)
        grid.setContentsMargins(8, 4, 8, 4)
        grid.setVerticalSpacing(0)
        self.title = make_label("title")
        grid.addWidget(self.title, 0, 0, 1, 2)
        self.names = {key: make_label("muted", width=NAME_PX) for key in rows}
        self.values = {key: make_label("value") for key in rows}
        for line, key in enumerate(rows, 1):
            grid.addWidget(self.names[key], line, 0)
            grid.addWidget(self.values[key], line, 1)
        grid.setColumnStretch(1, 1)

    def set_language(self, language: Language) -> None:
        """Write the names in a language."""
        super().set_language(language)
        for key, label in self.names.items():
            label.setText(say(key, language))

    def show_values(self, shown: Mapping[str, str]) -> None:
        """Write values, by their rows' keys."""
        for key, text in shown.items():
            set_text(self.values[key], text)


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
