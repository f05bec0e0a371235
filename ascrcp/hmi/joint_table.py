"""Joint positions as a table: actual, target, error, drive, limits, state (thesis 6.1.2)."""

import math
from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QEvent, QModelIndex, Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QHeaderView, QTableView

from ascrcp.hmi import quantity
from ascrcp.hmi.table import Index, show_whole
from ascrcp.hmi.text import Language, say
from ascrcp.kinematics import JointInfo
from ascrcp.session.snapshot import Snapshot

COLUMNS = ("joint", "actual", "target", "error", "drive")
WIDE_COLUMNS = (*COLUMNS, "limits", "state")
ROW_PX, HEADER_PX = 26, 28
STALE = "▲"
"""Set before a value that is too old."""

WIDEST = ("", f"{STALE} 2200 mm", "2200 mm", "-800 mm", "+100 %", "0…2200 mm", "■ near end")
"""Widest text of each column after the first, which takes what is left."""
PADDING_PX = 16

NEAR_LIMIT = 0.03
"""Share of a joint's range at its ends in which it counts as near its limit; placeholder."""


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


def joint_state(joint: JointInfo, snapshot: Snapshot, stale_ms: float) -> str:
    """Return the key of the word for a joint's state; the most serious wins."""
    index = joint.number - 1
    value = _at(snapshot.q, index)
    if not math.isfinite(value):
        return "joint_unknown"
    if snapshot.inputs is not None and not snapshot.inputs.in_range[index]:
        return "joint_range"
    if not _at(snapshot.age_ms, index) <= stale_ms:
        return "joint_stale"
    limited = sum(_at(snapshot.q, number - 1) for number in joint.limit_sum) if joint.limit_sum else value
    if not joint.lower <= limited <= joint.upper:
        return "joint_beyond"
    margin = NEAR_LIMIT * (joint.upper - joint.lower)
    if not joint.lower + margin <= limited <= joint.upper - margin:
        return "joint_near"
    return "joint_fresh"


def show_limits(joint: JointInfo) -> str:
    """Return a joint's range as text."""
    place = quantity.LENGTH if joint.prismatic else quantity.ANGLE_RANGE
    return f"{place.number(joint.lower)}…{place.show(joint.upper)}"


class JointModel(QAbstractTableModel):
    """The table's rows; one change signal a snapshot, and only if a shown text changed."""

    def __init__(
        self, joints: Sequence[JointInfo], stale_ms: float, columns: Sequence[str] = COLUMNS
    ) -> None:
        super().__init__()
        self.joints, self.columns = tuple(joints), tuple(columns)
        self._stale_ms = stale_ms
        self._language = Language.EN
        self._cells: tuple[tuple[str, ...], ...] = (("",) * (len(self.columns) - 1),) * len(self.joints)

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of joints."""
        return 0 if parent.isValid() else len(self.joints)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Return the number of columns."""
        return 0 if parent.isValid() else len(self.columns)

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
            return say(self.columns[section], self._language)
        if role == Qt.ItemDataRole.TextAlignmentRole:
            side = Qt.AlignmentFlag.AlignRight if section else Qt.AlignmentFlag.AlignLeft
            return int(side | Qt.AlignmentFlag.AlignVCenter)
        return None

    def set_language(self, language: Language) -> None:
        """Change titles and names."""
        self._language = language
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(self.columns) - 1)
        self._tell()

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Take the joints of a snapshot."""
        cells = tuple(self._row(joint, snapshot) for joint in self.joints)
        if cells != self._cells:
            self._cells = cells
            self._tell()

    def _row(self, joint: JointInfo, snapshot: Snapshot) -> tuple[str, ...]:
        shown = show_joint(joint, snapshot, self._stale_ms)
        if len(self.columns) == len(COLUMNS):
            return shown
        return (*shown, show_limits(joint), say(joint_state(joint, snapshot, self._stale_ms), self._language))

    def _tell(self) -> None:
        self.dataChanged.emit(self.index(0, 0), self.index(len(self.joints) - 1, len(self.columns) - 1))


class JointTable(QTableView):
    """The table itself: to look at, nothing in it can be pressed."""

    def __init__(
        self, joints: Sequence[JointInfo], stale_ms: float, columns: Sequence[str] = COLUMNS
    ) -> None:
        super().__init__()
        self.joint_model = JointModel(joints, stale_ms, columns)
        header = show_whole(self, self.joint_model, ROW_PX, HEADER_PX)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)

    def showEvent(self, event: QShowEvent) -> None:  # noqa: N802
        """Fit the columns to the font that is really there."""
        super().showEvent(event)
        self._fit()

    def changeEvent(self, event: QEvent) -> None:  # noqa: N802
        """Fit them again when the font or the style has changed."""
        super().changeEvent(event)
        if event.type() in (QEvent.Type.FontChange, QEvent.Type.StyleChange):
            self._fit()

    def _fit(self) -> None:
        metrics = self.fontMetrics()
        for column in range(1, len(self.joint_model.columns)):
            width = metrics.horizontalAdvance(WIDEST[column]) + PADDING_PX
            self.horizontalHeader().resizeSection(column, width)
