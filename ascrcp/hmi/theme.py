"""How the screen looks: config/screen.yaml and resources/screen.qss -> one style sheet, one colour table."""

from pathlib import Path
from string import Template
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from PySide6.QtCore import Qt
from PySide6.QtGui import QFont, QFontDatabase
from PySide6.QtWidgets import QApplication, QStackedWidget, QWidget

from ascrcp.core import paths
from ascrcp.core.config import Struct, load

Colour = Annotated[str, Meta(pattern="^#[0-9a-f]{6}$")]
BORDER_PX = 3
"""Border of every button [px], the same in all its states so that nothing moves."""

OPENED = (QWidget, QStackedWidget)
"""Containers of Qt that draw nothing; so do panels without a frame."""
SECTION_WIDGETS = 12
"""Restyled in one call at most, where a container can be opened."""

Positive = Annotated[float, Meta(gt=0)]


class Size(Struct):
    """Smallest window [px]."""

    width: Annotated[int, Meta(ge=1024, le=7680)]
    height: Annotated[int, Meta(ge=768, le=4320)]


class Autopilot(Struct):
    """How patient the autopilot is [s]."""

    patience_s: Positive
    reset_every_s: Positive


class View(Struct):
    """The 3-D view's level of detail, its first camera, and the steps of the view's buttons."""

    points: Annotated[int, Meta(ge=1000, le=2_000_000)]
    chunk_gl: Annotated[int, Meta(ge=1000, le=500_000)]
    chunk_drawn: Annotated[int, Meta(ge=1000, le=500_000)]
    fov_deg: Annotated[float, Meta(ge=10, le=120)]
    azimuth_deg: Annotated[float, Meta(ge=-360, le=360)]
    elevation_deg: Annotated[float, Meta(ge=-90, le=90)]
    distance: Annotated[float, Meta(ge=1, le=200)]
    centre: tuple[float, float, float]
    turn_deg: Annotated[float, Meta(gt=0, le=90)]
    zoom: Annotated[float, Meta(gt=1, le=4)]
    section_step_m: Annotated[float, Meta(gt=0, le=1)]


class Colours(Struct):
    """Colours of the controls; `on_x` is text upon x."""

    background: Colour
    panel: Colour
    border: Colour
    text: Colour
    muted: Colour
    button: Colour
    pressed: Colour
    off: Colour
    danger: Colour
    on_danger: Colour
    abnormal: Colour
    on_abnormal: Colour
    normal: Colour
    on_normal: Colour
    reset: Colour
    on_reset: Colour
    focus: Colour
    void: Colour
    bar: Colour


class SceneColours(Struct):
    """Colours of 3-D view and section; the first seven are named like core.flow.Label."""

    other: Colour
    sprayed: Colour
    bay: Colour
    arch: Colour
    overbreak: Colour
    ground: Colour
    face: Colour
    path: Colour
    path_done: Colour
    path_unsolved: Colour
    arm: Colour
    joint: Colour
    spray: Colour
    design: Colour
    target: Colour


class ChartColours(Struct):
    """Colours of trends and maps; the scales run from low to high."""

    grid: Colour
    actual: Colour
    target: Colour
    unknown: Colour
    signed: Annotated[list[Colour], Meta(min_length=2)]
    layer: Annotated[list[Colour], Meta(min_length=2)]


class Theme(Struct):
    """One look of the whole screen."""

    colours: Colours
    scene: SceneColours
    chart: ChartColours


class Themes(Struct):
    """The two looks."""

    night: Theme
    day: Theme


ThemeName = Literal["night", "day"]


class Screen(Struct):
    """Everything in config/screen.yaml."""

    language: Literal["zh", "en"]
    theme: ThemeName
    refresh_ms: Annotated[int, Meta(ge=20, le=200)]
    stick_ms: Annotated[int, Meta(ge=10, le=40)]
    size: Size
    touch_px: Annotated[int, Meta(ge=60, le=200)]
    stale_ms: Positive
    frozen_ms: Positive
    quit_confirm_s: Positive
    clearance_warn_m: Positive
    trend_s: Annotated[float, Meta(ge=10, le=3600)]
    lock_s: Positive
    pin_sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
    autopilot: Autopilot
    view: View
    fonts: Annotated[list[str], Meta(min_length=1)]
    themes: Themes

    @property
    def look(self) -> Theme:
        """The theme in use."""
        return self.themes.night if self.theme == "night" else self.themes.day

    @property
    def other_theme(self) -> ThemeName:
        """The theme the switch leads to."""
        return "day" if self.theme == "night" else "night"


def load_screen(path: Path | None = None) -> Screen:
    """Read the screen's configuration.

    Raises:
        ConfigError: A key is missing, unknown or outside its range.
    """
    return load(path or paths.CONFIG / "screen.yaml", Screen)


def with_theme(screen: Screen, theme: ThemeName) -> Screen:
    """Return the configuration with another theme."""
    changed: Screen = msgspec.structs.replace(screen, theme=theme)  # type: ignore[type-var]
    return changed


def colour_fields(colours: Colours | SceneColours | ChartColours) -> dict[str, str]:
    """Return the colours of a table by name."""
    fields: dict[str, str] = msgspec.to_builtins(colours)
    return fields


def style_sheet(screen: Screen) -> str:
    """Return the style sheet with the configured colours and sizes filled in."""
    template = Template((paths.RESOURCES / "screen.qss").read_text(encoding="utf-8"))
    inside = screen.touch_px - 2 * BORDER_PX  # Qt's min-height does not count the border
    return template.substitute(
        colour_fields(screen.look.colours), border_px=BORDER_PX, touch=inside, stop=inside + screen.touch_px
    )


def colour_scale(colours: list[str], steps: int = 256) -> NDArray[np.uint8]:
    """Return a scale between colours as a table of red, green, blue, shape (steps, 3)."""
    known = np.array([rgb(colour) for colour in colours], dtype=float)
    at = np.linspace(0.0, len(known) - 1.0, steps)
    table = np.stack([np.interp(at, np.arange(len(known)), channel) for channel in known.T], -1)
    return np.rint(table).astype(np.uint8)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green, blue of "#rrggbb", 0..255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def find_chinese_font() -> str | None:
    """Return an installed font family with simplified Chinese, None if there is none."""
    families = QFontDatabase.families(QFontDatabase.WritingSystem.SimplifiedChinese)
    proportional = [name for name in families if "Mono" not in name]
    return next(iter(proportional or families), None)


def apply_theme(application: QApplication, screen: Screen) -> bool:
    """Give the application its fonts; a window styles itself, section by section.

    Returns:
        Whether Chinese text can be shown.
    """
    chinese = find_chinese_font()
    font = QFont()
    font.setFamilies([*screen.fonts, *([chinese] if chinese else [])])
    application.setFont(font)
    return chinese is not None


def style_sections(widget: QWidget) -> list[QWidget]:
    """Return the parts of a widget that get the style sheet each on its own.

    One sheet for the whole application restyles it in one call of 0.1 s (measured), this many calls take
    1 ms each. A container that draws nothing itself is opened up when much is in it.
    """
    draws_nothing = type(widget) in OPENED or widget.property("panel") is False
    if not draws_nothing or len(widget.findChildren(QWidget)) <= SECTION_WIDGETS:
        return [widget]
    children = widget.findChildren(QWidget, options=Qt.FindChildOption.FindDirectChildrenOnly)
    return [section for child in children for section in style_sections(child)]


def set_look(widget: QWidget, look: str) -> None:
    """Choose one of the style sheet's looks for a widget; costs nothing when it has it already."""
    if widget.property("look") != look:
        widget.setProperty("look", look)
        widget.style().unpolish(widget)
        widget.style().polish(widget)


def contrast(first: str, second: str) -> float:
    """Compute the contrast ratio of two colours "#rrggbb" (WCAG 2.1): 1..21, text needs 4.5."""

    def luminance(colour: str) -> float:
        channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted((luminance(first), luminance(second)))
    return (light + 0.05) / (dark + 0.05)
