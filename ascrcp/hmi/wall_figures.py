"""What a layer on the wall comes to, in words: figures of plan.json or achieved.json -> lines of text."""

from collections.abc import Mapping
from typing import Any

from ascrcp.hmi.text import Language, say

APART = " · "
LEAST_M2 = 0.05
"""Left-out areas below this are not named [m2]."""


def describe_layer(figures: Mapping[str, Any], language: Language) -> str:
    """Say how much of the wall is within tolerance and how thin the rest is; below it what is left out.

    Args:
        figures: Of a `WallLayer`; empty if nobody knows them.
        language: To say it in.
    """
    if "within_tolerance" not in figures:
        return ""
    line = say("finish", language).format(
        share=100.0 * figures["within_tolerance"],
        area=figures["area_m2"],
        thin=figures["thinnest_mm"],
        thick=figures["thickest_mm"],
    )
    if "pumped_m3" in figures:
        line += say("finish_pumped", language).format(volume=figures["pumped_m3"])
    left = [
        f"{area:.1f} m² {say(f'left_{code}', language)}"
        for code, area in figures.get("left_out_m2", {}).items()
        if area >= LEAST_M2
    ]
    return f"{line}\n{say('finish_left', language)}{APART.join(left)}" if left else line
