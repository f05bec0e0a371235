"""The wall page: the unrolled wall as a map, and the section at any station beside it."""

import math

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QVBoxLayout

from ascrcp.hmi import quantity
from ascrcp.hmi.page import Page
from ascrcp.hmi.panel import Panel, make_button, make_label, set_text
from ascrcp.hmi.preparation import Prepared
from ascrcp.hmi.section_view import SectionView
from ascrcp.hmi.text import Language, say
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.wall_figures import describe_layer
from ascrcp.hmi.wall_map import WallMap
from ascrcp.session.snapshot import Snapshot

LAYERS = ("offset", "predicted", "achieved")
FIGURES_PX = 84
"""Four lines below the map [px], so that it keeps its size whatever they say."""


class WallPage(Page):
    """Where rock is missing, where the layer will be and is, and one section through it."""

    key = "wall"

    def __init__(self, screen: Screen) -> None:
        super().__init__()
        self._step = screen.view.section_step_m
        self._range = (math.nan, math.nan)
        self._follows = False
        self._layer = LAYERS[0]
        self.map = WallMap(screen)
        self.section = SectionView(screen)
        self.layers: dict[str, QPushButton] = {}
        left, right = Panel(), Panel()
        column = QVBoxLayout(left)
        column.setContentsMargins(4, 4, 4, 4)
        column.addLayout(self._make_layers())
        column.addWidget(self.map, 1)
        self.figures = make_label("small", wrap=True)
        self.figures.setFixedHeight(FIGURES_PX)
        self.figures.setAlignment(Qt.AlignmentFlag.AlignTop)
        column.addWidget(self.figures)
        other = QVBoxLayout(right)
        other.setContentsMargins(4, 4, 4, 4)
        self.title = make_label("title", centred=True)
        self.back, self.at_nozzle, self.on = (
            make_button("view", name=key) for key in ("section_back", "section_nozzle", "section_on")
        )
        self.at_nozzle.setCheckable(True)
        keys = QHBoxLayout()
        for button in (self.back, self.at_nozzle, self.on):
            button.setAutoRepeat(button is not self.at_nozzle)
            keys.addWidget(button, 1)
        other.addLayout(keys)
        other.addWidget(self.title)
        other.addWidget(self.section, 1)
        whole = QHBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.setSpacing(8)
        whole.addWidget(left, 9)
        whole.addWidget(right, 5)
        self.back.clicked.connect(lambda: self._move(-self._step))
        self.on.clicked.connect(lambda: self._move(self._step))
        self.at_nozzle.clicked.connect(self._follow)
        self.map.chosen.connect(self._touch)
        self._choose_layer("offset")

    def _make_layers(self) -> QHBoxLayout:
        row = QHBoxLayout()
        for name in LAYERS:
            button = make_button("view", name=f"wall_{name}", checkable=True)
            button.clicked.connect(lambda _=False, name=name: self._choose_layer(name))
            button.setEnabled(False)
            row.addWidget(button, 1)
            self.layers[name] = button
        return row

    def set_language(self, language: Language) -> None:
        """Write the fixed texts in a language."""
        super().set_language(language)
        self.map.set_language(language)
        self.section.set_language(language)
        for name, button in self.layers.items():
            button.setText(say(f"wall_{name}", language))
        self.back.setText(say("section_back", language))
        self.at_nozzle.setText(say("section_nozzle", language))
        self.on.setText(say("section_on", language))
        self._write_title()
        self._write_figures()

    def set_theme(self, screen: Screen) -> None:
        """Take a theme's colours."""
        self.map.set_theme(screen)
        self.section.set_theme(screen)

    def draw(self, prepared: Prepared) -> None:
        """Take another wall."""
        self.map.draw_scene(prepared.scene)
        self.section.draw(prepared)
        surface = prepared.scene.surface
        for name, button in self.layers.items():
            button.setEnabled(self.map.layer(name) is not None)
        self._write_figures()
        if surface is None or not len(surface.station):
            return
        self._range = (float(surface.station[0]), float(surface.station[-1]))
        if not self._range[0] <= self.map.station <= self._range[1]:
            self._show(sum(surface.unsprayed) / 2)

    def show_snapshot(self, snapshot: Snapshot) -> None:
        """Mark the nozzle, and let the section follow it if it is to."""
        self.map.show_nozzle(snapshot.tip, snapshot.tip_direction)
        if self._follows and math.isfinite(self.map.nozzle_station()):
            self._show(self.map.nozzle_station())

    def _choose_layer(self, name: str) -> None:
        self.map.choose_layer(name)
        for key, button in self.layers.items():
            button.setChecked(key == name)
        self._layer = name
        self._write_figures()

    def _touch(self, station: float) -> None:
        self._follow(False)
        self._show(station)

    def _move(self, step: float) -> None:
        self._follow(False)
        if math.isfinite(self.map.station):
            self._show(self.map.station + step)

    def _follow(self, follows: bool) -> None:
        self._follows = follows
        self.at_nozzle.setChecked(follows)

    def _show(self, station: float) -> None:
        station = round(max(self._range[0], min(self._range[1], station)), 2)
        if not math.isfinite(station):
            return
        self.map.choose_station(station)
        self.section.choose_station(station)
        self._write_title()

    def _write_figures(self) -> None:
        layer = self.map.layer(self._layer)
        text = "" if layer is None else describe_layer(layer.figures, self.language)
        set_text(self.figures, text)
        self.figures.setVisible(bool(text))  # the map may have its place

    def _write_title(self) -> None:
        station = quantity.STATION.show(self.map.station)
        set_text(self.title, say("section_title", self.language).format(station=station))
