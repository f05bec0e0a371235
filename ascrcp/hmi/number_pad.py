"""A pad of digits for gloves, and the entry it writes: no keyboard, no dialog."""

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QPushButton

from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.text import Language, say

DIGITS = ("7", "8", "9", "4", "5", "6", "1", "2", "3")
ENTRY_PX = 60
BACK = "⌫"
LONGEST = 12
"""Characters of an entry."""


class NumberPad(Panel):
    """Digits, sign and point; a PIN shows as dots.

    Signals:
        entered: The text, when enter was pressed.
    """

    entered = Signal(str)

    def __init__(self, *, is_secret: bool) -> None:
        super().__init__(framed=False)
        self._is_secret = is_secret
        self.text = ""
        self.entry = make_label("entry")
        self.entry.setFixedHeight(ENTRY_PX)
        self.keys: dict[str, QPushButton] = {}
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(4)
        grid.addWidget(self.entry, 0, 0, 1, 4)
        for index, digit in enumerate(DIGITS):
            self._add(grid, digit, 1 + index // 3, index % 3)
        for key, row, column in (("−", 4, 0), ("0", 4, 1), (".", 4, 2), (BACK, 1, 3), ("clear", 2, 3)):
            self._add(grid, key, row, column)
        for key in ("−", "."):
            self.keys[key].setVisible(not is_secret)
        self.enter = make_button("plain", name="pad_enter")
        grid.addWidget(self.enter, 3, 3, 2, 1)
        grid.setRowStretch(5, 1)  # a taller screen does not blow the entry up
        self.enter.clicked.connect(lambda: self.entered.emit(self.text))
        self._write()

    def set_language(self, language: Language) -> None:
        """Write the two keys that have words."""
        super().set_language(language)
        self.enter.setText(say("pin_enter", language))
        self.keys["clear"].setText(say("pin_clear", language))

    def show_text(self, text: str) -> None:
        """Take an entry to begin with."""
        self.text = text
        self._write()

    def press(self, key: str) -> None:
        """Take one key: a digit, sign, point, back or clear."""
        if key == "clear":
            self.text = ""
        elif key == BACK:
            self.text = self.text[:-1]
        elif key == "−":
            self.text = self.text[1:] if self.text.startswith("-") else "-" + self.text
        elif len(self.text) < LONGEST and not (key == "." and "." in self.text):
            self.text += key
        self._write()

    def _add(self, grid: QGridLayout, key: str, row: int, column: int) -> None:
        button = make_button("plain", name=f"pad_{key}")
        button.setText(key)
        button.setMinimumWidth(64)
        button.clicked.connect(lambda _=False, key=key: self.press(key))
        grid.addWidget(button, row, column)
        self.keys[key] = button

    def _write(self) -> None:
        set_text(self.entry, "●" * len(self.text) if self._is_secret else self.text or " ")
