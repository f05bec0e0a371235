"""The wall page says what a layer comes to, in both languages, and names every reason of what is left out."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from PySide6.QtCore import Qt
from rehearsal import Rehearsal, make_scene

from ascrcp.hmi.text import Language, say
from ascrcp.hmi.wall_figures import describe_layer
from ascrcp.hmi.window import Window
from ascrcp.planning.target import LEFT_TEXT
from ascrcp.session.state import Finding, Refusal, Step

WRAP = int(Qt.TextFlag.TextWordWrap)
FIGURES: dict[str, Any] = {
    "within_tolerance": 0.934,
    "area_m2": 19.3,
    "thinnest_mm": 41.2,
    "thickest_mm": 12.0,
    "pumped_m3": 2.01,
    "left_out_m2": dict.fromkeys(LEFT_TEXT, 0.7),
}


@pytest.mark.parametrize("language", Language)
def test_every_reason_and_figure_is_said(language: Language) -> None:
    said = describe_layer(FIGURES, language)
    for part in ("93.4", "19.3", "41", "12", "2.01"):
        assert part in said
    for code in LEFT_TEXT:
        assert say(f"left_{code}", language) in said
    assert describe_layer({}, language) == ""
    assert "0.7" not in describe_layer({**FIGURES, "left_out_m2": {}}, language)


def test_the_page_shows_the_figures_of_the_layer_chosen(open_window: Callable[..., Window]) -> None:
    session = Rehearsal()
    scene = make_scene()
    assert scene.predicted is not None
    session.drawn = replace(
        scene,
        predicted=replace(scene.predicted, figures=FIGURES),
        achieved=replace(scene.predicted, figures={**FIGURES, "within_tolerance": 0.871}),
    )
    window = open_window(session)
    window.settle()
    page = window.wall
    assert page.figures.text() == ""
    for name, share in (("predicted", "93.4"), ("achieved", "87.1")):
        assert page.layers[name].isEnabled()
        page.layers[name].click()
        assert share in page.figures.text()
    window.show_page(page.key)
    for language in (Language.ZH, Language.EN):
        window.set_language(language)
        window.settle()
        assert page.figures.text() == describe_layer(page.map.layer("achieved").figures, language)
        wide = page.figures.width()
        room = page.figures.fontMetrics().boundingRect(0, 0, wide, 1000, WRAP, page.figures.text())
        assert room.height() <= page.figures.height(), "nothing is clipped, all reasons at once"


def test_scan_again_is_offered_after_a_run_and_explains_itself(open_window: Callable[..., Window]) -> None:
    session = Rehearsal(ticks=1)
    session.reset()
    window = open_window(session)
    button, reason = window.steps.buttons[Step.RESCAN], window.steps.reasons[Step.RESCAN]

    def press(*steps: Step) -> None:
        for step in steps:
            window.steps.buttons[step].click()
            window.refresh()
            window.refresh()

    assert not button.isEnabled() and reason.text() == Refusal.NEEDS_RUN.value[0]
    press(Step.ZERO, Step.RECOGNISE, Step.LOAD, Step.GO_TO_START, Step.RUN)
    assert not button.isEnabled() and reason.text() == Refusal.NEEDS_ZERO.value[0]
    press(Step.ZERO)
    assert button.isEnabled()
    session.findings = [Finding.COVERED]
    press(Step.RESCAN)
    assert Step.RESCAN in session.job.done
    assert not button.isEnabled() and reason.text() == Refusal.COVERED.value[0]
