"""Features as the outside world reads them: Surface -> features.json (design.md section 9)."""

from typing import Any

import numpy as np

from ascrcp.core.flow import Arch, Bay, Overbreak, Surface
from ascrcp.perception.profile_line import crown_height
from ascrcp.perception.survey import UnderbreakParameters, load_survey
from ascrcp.perception.volume import BayVolume, Underbreak, bay_volumes, find_underbreak, volume_beyond


def build_features(
    surface: Surface,
    points_in: int,
    timing: dict[str, float],
    underbreak: UnderbreakParameters | None = None,
) -> dict[str, Any]:
    """Describe a recognised heading in plain values, metres and degrees.

    Stations of arches are where their middle plane meets the axis (what "metres along the tunnel
    axis" means for a plane that leans); `station_crown` is the same plane at the crown.

    Args:
        surface: The recognised heading.
        points_in: Points in the cloud before the crop.
        timing: Seconds per step.
        underbreak: What counts as rock inside the line; config/survey.yaml by default.

    Returns:
        Values that json writes as they are.
    """
    inside = find_underbreak(surface, underbreak or load_survey().underbreak)
    volumes = bay_volumes(surface)
    volume = sum(region.volume_m3 for region in surface.overbreak)
    return {
        "axis": {
            "point": _list(surface.axis.point),
            "direction": _list(surface.axis.direction),
            "direction_sigma_deg": float(surface.axis.direction_sigma_deg),
            "position_sigma_m": float(surface.axis.position_sigma),
            "evidence": list(surface.axis.evidence),
        },
        "unsprayed": _list(surface.unsprayed),
        "arches": [_arch(arch, crown_height(surface.profile)) for arch in surface.arches],
        "overbreak": [_region(region) for region in surface.overbreak],
        "overbreak_volume_m3": float(volume),
        "overbreak_volume_shadow_m3": shadow_volume(surface),
        "underbreak": [_region(region) for region in inside],
        "underbreak_volume_m3": float(sum(region.volume_m3 for region in inside)),
        "bays": [_bay(bay, need) for bay, need in zip(surface.bays, volumes, strict=True)],
        "spray_volume_m3": {
            "to_design": float(sum(need.to_design for need in volumes)),
            "to_arch_line": float(sum(need.to_arch_line for need in volumes)),
        },
        "profile": surface.profile.name,
        "points": {"in": int(points_in), "kept": len(surface.points)},
        "timing_s": {**timing, "total": float(sum(timing.values()))},
    }


def shadow_volume(surface: Surface) -> float:
    """Estimate the overbreak in cells that were not seen but filled [m3]."""
    mine = surface.filled & (surface.station > surface.unsprayed[0])[:, None]
    return float(volume_beyond(surface, surface.profile.overbreak_line)[mine].sum())


def _arch(arch: Arch, crown: float) -> dict[str, Any]:
    return {
        "station": float(arch.station - np.tan(np.radians(arch.lean_deg)) * crown),
        "station_crown": float(arch.station),
        "width": float(arch.width),
        "lean_deg": float(arch.lean_deg),
        "span_deg": _list(arch.span_deg),
    }


def _region(region: Overbreak | Underbreak) -> dict[str, Any]:
    return {
        "station": _list(region.station),
        "angle_deg": _list(region.angle_deg),
        "area_m2": float(region.area_m2),
        "volume_m3": float(region.volume_m3),
        "max_depth_m": float(region.max_depth_m),
        "confidence": float(region.confidence),
    }


def _bay(bay: Bay, need: BayVolume) -> dict[str, Any]:
    return {
        "station": _list(bay.station),
        "arch_before": bay.arch_before,
        "arch_after": bay.arch_after,
        "area_m2": need.area,
        "volume_to_design_m3": need.to_design,
        "volume_to_arch_line_m3": need.to_arch_line,
        "filled_share": need.filled_share,
        "unknown_share": need.unknown_share,
    }


def _list(values: Any) -> list[float]:
    return [float(value) for value in values]
