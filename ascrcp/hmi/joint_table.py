"""Joint positions as a table: actual, target, error, drive (thesis 6.1.2, joint position module)."""

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView

from ascrcp.hmi import quantity
from ascrcp.hmi.text import Language, say
from ascrcp.kinematics import JointInfo
from ascrcp.session.snapshot import Snapshot

COLUMNS = ("joint", "actual", "target", "error", "drive")
ROW_PX, HEADER_PX = 26, 28
STALE = "▲"
"""Set before a value that is too old."""

WIDEST = ("", f"{STALE} 2200 mm", "2200 mm", "-800 mm", "+100 %")
"""Widest text of each column after the first, which takes what is left."""
PADDING_PX = 17

Index = QModelIndex | QPersistentModelIndex


def _at(values: Sequence[float], index: int) -> float:
    return values[index] if index < len(values) else float("nan")


def show_joint(joint: JointInfo, snapshot: Snapshot, stale_ms: float) -> tuple[str, ...]:
    """Return one row's texts: actual, target, error, drive, in degrees or millimetres."""
    index = joint.number - 1
    actual, target = _at(snapshot.q, index), _at(snapshot.q_target, index)
    place = quantity.LENGTH if joint.prismatic else quantity.ANGLE
    difference = quantity.LENGTH_ERROR if joint.prismatic else quantity.ANGLE_ERROR
    shown = place.show(actual)
    if _at(snapshot.age_ms, index) > stale_ms:
        shown = f"{STALE} {shown}"
    error = difference.show(target - actual)
    return shown, place.show(target), error, quantity.DRIVE.show(_at(snapshot.drive, index))


class JointModel(QAbstractTableModel):
    """The table's rows; one change signal a snapshot, and only if a shown text changed."""

    def __init__(self, joints: Sequence[JointInfo], stale_ms: float) -> None:
        super().__init__()
        self.joints = tuple(joints)
        self._stale_ms = stale_ms
        self._language = Language.EN
        self._cells: tuple[tuple[str, ...], ...] = (("",) * 4,) * len(self.joints)

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of joints."""
        return 0 if parent.isValid() else len(self.joints)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of columns."""
        return 0 if parent.isValid() else len(COLUMNS)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Return a cell's text or alignment."""
        column = index.column()
        if role == Qt.ItemDataRole.DisplayRole:
            if column == 0:
                joint = self.joints[index.row()]
                return f"{joint.number} {(joint.name, joint.name_zh)[self._language]}"
            return self._cells[index.row()][column - 1]
        if role == Qt.ItemDataRole.TextAlignmentRole and column > 0:
            return int(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        return None

    def headerData(  # noqa: N802
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        """Return a column's title."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            return say(COLUMNS[section], self._language)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            side = Qt.AlignmentFlag.AlignRight if section else Qt.AlignmentFlag.AlignLeft
            return int(side | Qt.AlignmentFlag.AlignVCenter)
        return None

    def set_language(self, language: Language) -> None:
        """Change titles and names."""
        self._language = language
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(COLUMNS) - 1)
        self._tell()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Take the joints of a snapshot."""
        cells = tuple(show_joint(joint, snapshot, self._stale_ms) for joint in self.joints)
        if cells != self._cells:
            self._cells = cells
            self._tell()

    def _tell(self) -> None:
        self.dataChanged.emit(self.index(0, 0), self.index(len(self.joints) - 1, len(COLUMNS) - 1))


class JointTable(QTableView):
    """The table itself: to look at, nothing in it can be pressed."""

    def __init__(self, joints: Sequence[JointInfo], stale_ms: float) -> None:
        super().__init__()
        self.joint_model = JointModel(joints, stale_ms)
        self.setModel(self.joint_model)
        self.setSelectionMode(QAbstractItemView.SelectionMode.NoSelection)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(ROW_PX)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        header = self.horizontalHeader()
        header.setFixedHeight(HEADER_PX)
        header.setSectionsClickable(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.Fixed)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.setFixedHeight(HEADER_PX + ROW_PX * len(joints) + 4)

    def showEvent(self, event: QShowEvent) -> None:  # noqa: N802
        """Fit the columns to the font that is really there."""
        metrics = self.fontMetrics()
        for column in range(1, len(COLUMNS)):
            width = metrics.horizontalAdvance(WIDEST[column]) + PADDING_PX
            self.horizontalHeader().resizeSection(column, width)
        super().showEvent(event)
