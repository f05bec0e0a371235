"""Every text has both languages; every quantity shows what it should; the theme can be read."""

import math
import string
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.config import convert, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.event import EVENTS
from ascrcp.core.flow import Label
from ascrcp.core.paths import CONFIG
from ascrcp.hmi import quantity
from ascrcp.hmi.text import MODE_NAME, STEP_NAME, TEXT
from ascrcp.hmi.theme import Screen, colour_fields, contrast, style_sheet
from ascrcp.session.state import Mode, Refusal, Step

TABLES = {
    **{f"text {key}": pair for key, pair in TEXT.items()},
    **{f"step {step.name}": STEP_NAME[step] for step in Step},
    **{f"mode {mode.name}": MODE_NAME[mode] for mode in Mode},
    **{f"refusal {refusal.name}": refusal.value for refusal in Refusal},
    **{
        f"event {code} {name}": getattr(event, name)
        for code, event in EVENTS.items()
        for name in ("cause", "consequence", "action")
    },
}


def places(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


@pytest.mark.parametrize("key", TABLES)
def test_text_has_both_languages(key: str) -> None:
    english, chinese = TABLES[key]
    if key == "text language":  # each names the language it leads to
        english, chinese = chinese, english
    assert english and chinese
    assert not any("\u4e00" <= letter <= "\u9fff" for letter in english)
    assert any("\u4e00" <= letter <= "\u9fff" for letter in chinese)
    assert places(english) == places(chinese)


ALL = [value for value in vars(quantity).values() if isinstance(value, quantity.Quantity)]


@given(st.sampled_from(ALL), st.floats(-1e4, 1e4))
def test_shown_number_is_the_value_in_its_unit(shown: quantity.Quantity, value: float) -> None:
    number = float(shown.number(value))
    assert abs(number - value * shown.scale) <= 0.5 * 10.0**-shown.decimals * (1 + 1e-6)
    assert not shown.number(value).startswith("-0") or number != 0.0
    assert shown.show(value).endswith(shown.unit)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_unknown_is_no_number(value: float) -> None:
    assert {shown.show(value) for shown in ALL} == {quantity.NOTHING}
    assert quantity.show_duration(value) == quantity.NOTHING
    assert quantity.show_point((value,) * 3, quantity.POSITION) == quantity.NOTHING


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (754, "12:34"), (3661, "1:01:01")]
)
def test_duration(seconds: float, text: str) -> None:
    assert quantity.show_duration(seconds) == text


@pytest.mark.parametrize("theme", ["night", "day"])
def test_text_stands_out_from_what_is_behind_it(screen: Screen, theme: str) -> None:
    look = getattr(screen.themes, theme)
    c = look.colours
    pairs = [
        *((c.text, behind) for behind in (c.background, c.panel, c.button, c.pressed, c.off, c.bar)),
        *((c.muted, behind) for behind in (c.background, c.panel, c.off, c.button)),
        (c.on_danger, c.danger),
        (c.on_reset, c.reset),
        (c.on_abnormal, c.abnormal),
        (c.on_normal, c.normal),
        (c.text, c.void),
    ]
    for text, behind in pairs:
        assert contrast(text, behind) >= 4.5, (text, behind)
    for name, colour in colour_fields(look.scene).items():
        if name not in ("ground", "other", "face", "sprayed", "path_unsolved"):
            assert contrast(colour, c.void) >= 3.0, name
    for colour in (look.chart.actual, look.chart.target):
        assert contrast(colour, c.void) >= 3.0


@pytest.mark.parametrize("theme", ["night", "day"])
def test_every_label_has_a_colour_of_its_own(screen: Screen, theme: str) -> None:
    colours = colour_fields(getattr(screen.themes, theme).scene)
    named = [colours[label.name.lower()] for label in Label]
    assert len(set(named)) == len(Label)


def test_style_sheet_is_filled_in(screen: Screen) -> None:
    sheet = style_sheet(screen)
    assert "$" not in sheet
    assert sheet.count("{") == sheet.count("}")


@pytest.mark.parametrize(
    ("key", "value"),
    [("language", "de"), ("refresh_ms", 5), ("touch_px", 20), ("fonts", []), ("stale_ms", 0), ("extra", 1)],
)
def test_screen_refuses_bad_configuration(key: str, value: object) -> None:
    tree = {**read_yaml(CONFIG / "screen.yaml"), key: value}
    with pytest.raises(ConfigError, match=key if key != "extra" else "extra"):
        convert(tree, Screen, "screen.yaml")


def test_quantities_are_all_of_one_kind() -> None:
    assert {field.name for field in fields(quantity.Quantity)} == {"unit", "scale", "decimals", "signed"}
