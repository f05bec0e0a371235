"""Commissioning: numbers of a configuration file, changed one by one, checked whole before they are saved."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout

from ascrcp.core.errors import InputError
from ascrcp.hmi.config_text import Key, Number, change, find_numbers, is_number, save_checked
from ascrcp.hmi.number_pad import NumberPad
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.table import TextTable
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import set_look
from ascrcp.session.snapshot import Snapshot

ROWS = 7
CHOSEN = "▶ "


@dataclass(frozen=True)
class EditedFile:
    """A file that may be changed, and its own reader, which refuses what is wrong."""

    path: Path
    check: Callable[[Path], object]


class EditorPart(Panel):
    """The file's numbers at the left, a pad for the new value at the right."""

    def __init__(self, files: tuple[EditedFile, ...]) -> None:
        super().__init__(framed=False)
        self._files, self._file = files, files[0]
        self._numbers: list[Number] = []
        self._text, self._changes = "", dict[Key, str]()
        self._row, self._is_moving = 0, False
        self._told: tuple[str, str] = ("", "")
        self.table = TextTable(("edit_key", "edit_value"), (0, 190), ROWS)
        self.status = make_label("message", wrap=True)
        self.pad = NumberPad(is_secret=False)
        self.up, self.down = make_button("view", name="edit_up"), make_button("view", name="edit_down")
        self.file_button = make_button("view", name="edit_file")
        self.save_button = make_button("view", name="edit_save")
        self.undo_button = make_button("view", name="edit_undo")
        self.up.setText("▲")
        self.down.setText("▼")
        left, middle = QVBoxLayout(), QVBoxLayout()
        left.addWidget(self.table)
        left.addWidget(self.status, 1)
        for button in (self.file_button, self.up, self.down, self.save_button, self.undo_button):
            button.setFixedWidth(150)
            middle.addWidget(button)
        middle.addStretch()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addLayout(left, 1)
        row.addLayout(middle)
        row.addWidget(self.pad)
        for button, step in ((self.up, -1), (self.down, 1)):
            button.setAutoRepeat(True)
            button.clicked.connect(lambda _=False, step=step: self.choose(self._row + step))
        self.file_button.clicked.connect(self._next_file)
        self.file_button.setEnabled(len(files) > 1)
        self.save_button.clicked.connect(self.save)
        self.undo_button.clicked.connect(self.read)
        self.pad.entered.connect(self._take)

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.table.set_language(language)
        self.pad.set_language(language)
        self.save_button.setText(say("edit_save", language).replace(" ", "\n", 1))
        self.undo_button.setText(say("edit_undo", language))
        self._write()

    def showEvent(self, event: object) -> None:  # noqa: N802
        """Read the file when the part comes to the front; unsaved changes stay."""
        if not self._changes:
            self.read()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Allow saving at rest only."""
        job = snapshot.job
        is_moving = job.jogging or job.active is not None
        if is_moving != self._is_moving:
            self._is_moving = is_moving
            self._write()

    def read(self) -> None:
        """Read the file anew; changes are forgotten."""
        self._changes = {}
        try:
            self._text = self._file.path.read_text(encoding="utf-8")
            self._numbers = find_numbers(self._text)
            self._told = ("", "")
        except (OSError, InputError) as error:
            self._text, self._numbers = "", []
            self._told = ("failure", say("edit_refused", self.language).format(reason=error))
        self.choose(min(self._row, max(0, len(self._numbers) - 1)))

    def choose(self, row: int) -> None:
        """Go to a number."""
        self._row = max(0, min(len(self._numbers) - 1, row))
        if self._numbers:
            self.pad.show_text(self._value(self._numbers[self._row]))
        self._write()

    def save(self) -> None:
        """Check the changed file by its own reader and put it in place."""
        try:
            text = change(self._text, self._changes)
            save_checked(self._file.path, text, self._file.check)
        except InputError as error:
            self._told = ("failure", say("edit_refused", self.language).format(reason=error))
            self._write()
            return
        self.read()
        self._told = ("", say("edit_saved", self.language))
        self._write()

    def _next_file(self) -> None:
        self._file = self._files[(self._files.index(self._file) + 1) % len(self._files)]
        self._row = 0
        self.read()

    def _take(self, text: str) -> None:
        if not self._numbers or not is_number(text):
            return
        number = self._numbers[self._row]
        if text == number.text:
            self._changes.pop(number.key, None)
        else:
            self._changes[number.key] = text
        self._told = ("", "")
        self.choose(self._row + 1)

    def _value(self, number: Number) -> str:
        return self._changes.get(number.key, number.text)

    def _write(self) -> None:
        first = max(0, min(self._row - ROWS // 2, len(self._numbers) - ROWS))
        rows: list[tuple[str, ...]] = []
        for index, number in enumerate(self._numbers[first : first + ROWS], first):
            mark = CHOSEN if index == self._row else ""
            value = self._value(number)
            was = f"   ({number.text})" if number.key in self._changes else ""
            rows.append((mark + number.name, value + was))
        self.table.show_rows(rows)
        self.file_button.setText(f"{self._file.path.parent.name}/\n{self._file.path.name}")
        count = len(self._changes)
        self.save_button.setEnabled(count > 0 and not self._is_moving)
        self.undo_button.setEnabled(count > 0)
        plain = (
            say("edit_changed", self.language).format(n=count) if count else say("edit_good", self.language)
        )
        look, told = self._told
        set_text(self.status, told or plain)
        set_look(self.status, look)
