"""A table of texts: to look at, rows told whole, columns of fixed width but one."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from ascrcp.hmi.text import Language, say

ROW_PX, HEADER_PX = 30, 30

Index = QModelIndex | QPersistentModelIndex


class TextModel(QAbstractTableModel):
    """Rows of texts; one change signal a call, and only if a text changed."""

    def __init__(self, columns: Sequence[str], rows: int) -> None:
        super().__init__()
        self._columns = tuple(columns)
        self._cells: list[tuple[str, ...]] = []
        self._rows = rows
        self._language = Language.EN

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of rows, empty ones included."""
        return 0 if parent.isValid() else self._rows

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self._columns)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return a cell's text."""
        row, column = index.row(), index.column()
        if role == Qt.ItemDataRole.DisplayRole and row < len(self._cells):
            return self._cells[row][column]
        return None

    def headerData(  # noqa: N802
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        """Return a column's title."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            return say(self._columns[section], self._language)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return int(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        return None

    def set_language(self, language: Language) -> None:
        """Change the titles."""
        self._language = language
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(self._columns) - 1)

    def show_rows(self, cells: list[tuple[str, ...]]) -> None:
        """Take all rows."""
        if cells != self._cells:
            self._cells = cells
            self.dataChanged.emit(self.index(0, 0), self.index(self._rows - 1, len(self._columns) - 1))


def show_whole(table: QTableView, model: QAbstractTableModel, row_px: int, header_px: int) -> QHeaderView:
    """Set a table up to look at: as high as its rows, nothing in it can be pressed; return its header."""
    table.setModel(model)
    table.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
    table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
    table.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    table.setWordWrap(False)
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(row_px)
    table.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    table.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    header = table.horizontalHeader()
    header.setFixedHeight(header_px)
    header.setSectionsClickable(False)
    header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
    table.setFixedHeight(header_px + row_px * model.rowCount() + 4)
    return header


class TextTable(QTableView):
    """The table itself: nothing in it can be pressed."""

    def __init__(self, columns: Sequence[str], widths: Sequence[int], rows: int) -> None:
        """Make an empty table.

        Args:
            columns: Keys of the titles' texts.
            widths: Of the columns [px]; 0 for the one that takes what is left.
            rows: Rows shown.
        """
        super().__init__()
        self.text_model = TextModel(columns, rows)
        header = show_whole(self, self.text_model, ROW_PX, HEADER_PX)
        for column, width in enumerate(widths):
            if width:
                header.resizeSection(column, width)
            else:
                header.setSectionResizeMode(column, QHeaderView.ResizeMode.Stretch)

    def set_language(self, language: Language) -> None:
        """Write the titles in a language."""
        self.text_model.set_language(language)

    def show_rows(self, cells: list[tuple[str, ...]]) -> None:
        """Show rows; the rest stays empty."""
        self.text_model.show_rows(cells)
