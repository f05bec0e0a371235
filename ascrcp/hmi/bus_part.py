"""Commissioning: what is on the CAN bus, by message, decoded."""

from collections import deque

from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout

from ascrcp.devices.codec import Codec, Layout
from ascrcp.devices.machine_link import DBC
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.table import TextTable
from ascrcp.hmi.text import Language, say
from ascrcp.session.snapshot import Snapshot

ROWS = 9
WINDOW = 50
"""Cycles over which the rate is counted."""
CYCLE_S = 0.02
REDRAW = 5
"""Refreshes from one drawing to the next: numbers that change faster cannot be read."""


def describe_frame(layout: Layout | None, data: bytes) -> str:
    """Return a frame's values with their names and units; nothing for one the DBC does not know."""
    if layout is None or len(data) != layout.length:
        return ""
    pairs = zip(layout.fields, layout.decode(data), strict=True)
    return "  ".join(f"{field.name} {value:g} {field.unit}".rstrip() for field, value in pairs)


class BusPart(Panel):
    """A row a message: identifier, name, rate, bytes, values."""

    def __init__(self) -> None:
        super().__init__(framed=False)
        codec = Codec(DBC)
        self._layouts = {layout.can_id: layout for layout in codec.by_name.values()}
        self._newest: dict[int, bytes] = {}
        self._seen: deque[tuple[int, ...]] = deque(maxlen=WINDOW)
        self._t_s = -1.0
        self._first, self._count = 0, 0
        self.table = TextTable(
            ("bus_identifier", "bus_name", "bus_rate", "bus_data", "bus_decoded"),
            (74, 144, 66, 158, 0),
            ROWS,
        )
        self.note = make_label("small")
        self.up, self.down = make_button("view", name="bus_up"), make_button("view", name="bus_down")
        self.up.setText("▲")
        self.down.setText("▼")
        self.up.clicked.connect(lambda: self._scroll(-ROWS))
        self.down.clicked.connect(lambda: self._scroll(ROWS))
        keys = QVBoxLayout()
        keys.addWidget(self.up)
        keys.addWidget(self.down)
        keys.addStretch()
        for button in (self.up, self.down):
            button.setFixedWidth(72)
        left = QVBoxLayout()
        left.addWidget(self.table)
        left.addWidget(self.note)
        left.addStretch()
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addLayout(left, 1)
        row.addLayout(keys)

    def set_language(self, language: Language) -> None:
        """Write the titles in a language."""
        super().set_language(language)
        self.table.set_language(language)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Count the newest cycle's frames and draw the table now and then."""
        if snapshot.t_s != self._t_s:
            self._t_s = snapshot.t_s
            self._seen.append(tuple(number for number, _ in snapshot.frames))
            self._newest.update(snapshot.frames)
        self._count += 1
        if self._count % REDRAW != 1:
            return
        numbers = sorted(self._newest)
        self._first = max(0, min(self._first, len(numbers) - 1))
        shown = numbers[self._first : self._first + ROWS]
        self.table.show_rows([self._row(number) for number in shown])
        set_text(self.note, "" if numbers else say("bus_silent", self.language))
        self.up.setEnabled(self._first > 0)
        self.down.setEnabled(self._first + ROWS < len(numbers))

    def _row(self, number: int) -> tuple[str, ...]:
        layout, data = self._layouts.get(number), self._newest[number]
        times = sum(cycle.count(number) for cycle in self._seen)
        rate = times / (max(1, len(self._seen)) * CYCLE_S)
        name = layout.name if layout is not None else "?"
        return f"0x{number:03X}", name, f"{rate:.0f}", data.hex().upper(), describe_frame(layout, data)

    def _scroll(self, rows: int) -> None:
        self._first = max(0, self._first + rows)
        self._count = 0
