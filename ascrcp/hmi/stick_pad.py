"""The stick on the screen: a finger held on it is the enable key, its way from the middle the deflection."""

import math

from PySide6.QtCore import QEvent, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFocusEvent, QFont, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QSizePolicy, QWidget

from ascrcp.hmi.theme import Screen

MIDDLE = 0.18
"""Share of the radius that counts as the middle, where a press must begin: below the stick's own limit."""
KEY_DEFLECTION = 0.6
"""Deflection of an arrow key; placeholder."""
KNOB_PX = 34
TEXT_PX = 15
HOLD_KEY = Qt.Key.Key_E
ARROWS = {
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_Up: (0.0, 1.0),
    Qt.Key.Key_Down: (0.0, -1.0),
}


class StickPad(QWidget):
    """A round pad; deflections -1..1, zero as soon as nothing is held.

    Attributes:
        across: Deflection to the right.
        upward: Deflection up.
        is_held: Whether the enable key is held: a finger that began in the middle, or the key E.
    """

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self._screen = screen
        self._names = ("", "", "", "")
        self._keys: set[int] = set()
        self._finger = self._key = False
        self.across = self.upward = 0.0
        self.setObjectName("stick_pad")
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(240, 240)

    @property
    def is_held(self) -> bool:
        """Whether the enable key is held."""
        return self._finger or self._key

    def set_names(self, right: str, left: str, up: str, down: str) -> None:
        """Say what the directions mean."""
        names = (right, left, up, down)
        if names != self._names:
            self._names = names
            self.update()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self._screen = screen
        self.update()

    def let_go(self) -> None:
        """Release everything."""
        self._finger = self._key = False
        self._keys.clear()
        self._set(0.0, 0.0)

    def mousePressEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Begin to hold, if the press is in the middle; a touch arrives as a mouse too."""
        x, y = self._share(event.position())
        self._finger = self.isEnabled() and math.hypot(x, y) <= MIDDLE
        self._set(0.0, 0.0)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Follow the finger."""
        if self._finger:
            self._set(*self._share(event.position()))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:  # noqa: N802
        """Let go."""
        self._finger = False
        self._follow_keys()

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Hold with E, deflect with the arrow keys."""
        self._turn_key(event, True)

    def keyReleaseEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Let go of a key."""
        self._turn_key(event, False)

    def focusOutEvent(self, event: QFocusEvent) -> None:  # noqa: N802
        """Let go when the keyboard goes elsewhere: its releases would not be seen."""
        self.let_go()
        super().focusOutEvent(event)

    def event(self, event: QEvent) -> bool:
        """Let go when the window goes away, to another program or altogether: no release would come."""
        if event.type() in (QEvent.Type.WindowDeactivate, QEvent.Type.Hide, QEvent.Type.UngrabMouse):
            self.let_go()
        return super().event(event)

    def _turn_key(self, event: QKeyEvent, down: bool) -> None:
        if event.isAutoRepeat():
            return
        key = event.key()
        if key == HOLD_KEY:
            self._key = down and self.isEnabled()
        elif key in ARROWS:
            self._keys = self._keys | {key} if down else self._keys - {key}
        else:
            event.ignore()
            return
        self._follow_keys()

    def _follow_keys(self) -> None:
        x = sum(ARROWS[Qt.Key(key)][0] for key in self._keys)
        y = sum(ARROWS[Qt.Key(key)][1] for key in self._keys)
        held = KEY_DEFLECTION if self._key else 0.0
        self._set(held * x, held * y)

    def _share(self, place: QPointF) -> tuple[float, float]:
        """Return a place on the pad as a share of its radius, no longer than 1."""
        x = (place.x() - 0.5 * self.width()) / self._radius
        y = (0.5 * self.height() - place.y()) / self._radius
        length = math.hypot(x, y)
        return (x, y) if length <= 1.0 else (x / length, y / length)

    @property
    def _radius(self) -> float:
        return max(1.0, 0.5 * min(self.width(), self.height()) - KNOB_PX)

    def _set(self, x: float, y: float) -> None:
        self.across, self.upward = x, y
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802
        """Draw ring, middle, directions and knob."""
        colours = self._screen.look.colours
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        centre, radius = QPointF(0.5 * self.width(), 0.5 * self.height()), self._radius
        edge = colours.focus if self.hasFocus() else colours.border
        painter.setPen(QPen(QColor(edge), 3))
        painter.setBrush(QColor(colours.button if self.isEnabled() else colours.off))
        painter.drawEllipse(centre, radius, radius)
        painter.setPen(QPen(QColor(colours.muted), 1, Qt.PenStyle.DashLine))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawEllipse(centre, MIDDLE * radius, MIDDLE * radius)
        self._write(painter, centre, radius)
        knob = QPointF(centre.x() + self.across * radius, centre.y() - self.upward * radius)
        painter.setPen(QPen(QColor(colours.text), 3))
        painter.setBrush(QColor(colours.normal if self.is_held else colours.panel))
        painter.drawEllipse(knob, KNOB_PX, KNOB_PX)
        painter.end()

    def _write(self, painter: QPainter, centre: QPointF, radius: float) -> None:
        font = QFont(self.font())
        font.setPixelSize(TEXT_PX)
        painter.setFont(font)
        painter.setPen(QColor(self._screen.look.colours.text))
        offset = radius - 24.0
        places = ((offset, 0.0), (-offset, 0.0), (0.0, -offset), (0.0, offset))
        for name, mark, (dx, dy) in zip(self._names, "▶◀▲▼", places, strict=True):
            box = QRectF(centre.x() + dx - 50, centre.y() + dy - 22, 100, 44)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, f"{mark}\n{name}")
