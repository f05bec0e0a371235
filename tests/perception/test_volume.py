"""Volumes, rock inside the line and sections, against surfaces whose wall is known exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Arch, Axis, Bay, Surface
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Profile, load_profile
from ascrcp.perception.cross_section import cut_section
from ascrcp.perception.features import build_features, shadow_volume
from ascrcp.perception.survey import UnderbreakParameters, load_survey
from ascrcp.perception.volume import bay_volumes, find_underbreak, volume_beyond

PROFILE = load_profile(CONFIG / "profiles" / "circle-5.9.yaml")
CELL = 0.05


def heading(
    offset: float | np.ndarray = 0.1,
    profile: Profile = PROFILE,
    arches: tuple[Arch, ...] = (),
    bays: tuple[Bay, ...] = (Bay((10.0, 13.0), None, None),),
) -> Surface:
    columns = int(np.ceil(profile.length / CELL))
    shape = (100, columns)
    return Surface(
        axis=Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])),
        profile=profile,
        unsprayed=(10.0, 13.0),
        arches=arches,
        overbreak=(),
        bays=bays,
        station=8.0 + CELL * (np.arange(100) + 0.5),
        along=profile.length / columns * (np.arange(columns) + 0.5),
        offset=np.broadcast_to(np.asarray(offset, dtype=np.float32), shape).copy(),
        filled=np.zeros(shape, dtype=bool),
        points=np.zeros((1, 3), dtype=np.float32),
        labels=np.zeros(1, dtype=np.uint8),
    )


@given(st.floats(0.0, 0.8), st.floats(-0.3, 0.3))
def test_the_volume_of_a_ring_is_that_of_a_ring(wall: float, line: float) -> None:
    found = volume_beyond(heading(wall), line).sum() / (100 * CELL)
    outer, inner = 5.9 + max(wall, line), 5.9 + line
    assert found == pytest.approx(np.radians(236) * (outer**2 - inner**2) / 2, rel=1e-5, abs=1e-6)


def test_bays_need_what_lies_between_the_wall_and_the_lines() -> None:
    surface = heading(0.1)
    (need,) = bay_volumes(surface)
    ring = np.radians(236) * 3.0 / 2
    assert need.to_design == pytest.approx(ring * (6.0**2 - 5.9**2), rel=1e-4)
    assert need.to_arch_line == pytest.approx(ring * (6.0**2 - 5.68**2), rel=1e-4)
    assert need.area == pytest.approx(ring * 2 * 5.9, rel=1e-3)
    assert (need.filled_share, need.unknown_share) == (0.0, 0.0)


def test_bays_follow_leaning_arches_and_say_what_was_not_seen() -> None:
    arch = Arch(station=11.5, width=0.2, lean_deg=4.0, span_deg=(0.0, 180.0))
    bays = (Bay((10.0, 11.4), None, 0), Bay((11.6, 13.0), 0, None))
    surface = heading(0.1, arches=(arch,), bays=bays)
    upright = heading(0.1, arches=(), bays=(Bay((10.0, 11.4), None, None), Bay((11.6, 13.0), None, None)))
    before, after = bay_volumes(surface)
    assert before.to_design < bay_volumes(upright)[0].to_design  # the foot lies farther back
    assert before.to_design + after.to_design == pytest.approx(
        sum(v.to_design for v in bay_volumes(upright)), rel=0.01
    )
    offset = surface.offset.copy()
    offset[:70] = np.nan
    (half,) = bay_volumes(heading(offset))
    assert half.unknown_share == pytest.approx(0.5, abs=0.02) and half.to_design < 0.6 * 60 * 3 * 0.1


def test_rock_inside_the_line_is_found_with_its_depth_and_volume() -> None:
    surface = heading(0.05)
    offset = surface.offset.copy()
    offset[50:60, 200:220] = -0.12  # 0.5 m x 1.0 m
    offset[70:72, 100:102] = -0.3  # too small to be named
    offset[10:20, 200:220] = -0.12  # sprayed part: meant to be inside
    (region,) = find_underbreak(heading(offset), load_survey().underbreak)
    column = float(surface.along[1] - surface.along[0])
    assert region.area_m2 == pytest.approx(10 * CELL * 20 * column)
    assert region.volume_m3 == pytest.approx(region.area_m2 * 0.12 * (1 - 0.06 / 5.9), rel=1e-4)
    assert region.max_depth_m == pytest.approx(0.12, abs=1e-5) and region.confidence == 1.0
    assert region.station == pytest.approx((10.5, 11.0))
    assert region.angle_deg[0] == pytest.approx(np.degrees(200 * column / 5.9) - 28.0, abs=0.01)
    assert not find_underbreak(heading(offset), UnderbreakParameters(tolerance=0.2, min_area=0.1))


@given(st.floats(8.0, 13.0), st.floats(-0.4, 0.9))
def test_a_section_holds_the_wall_at_its_station(station: float, wall: float) -> None:
    found = cut_section(heading(wall), station)
    assert np.hypot(*found.yz.T) == pytest.approx(5.9 + wall, abs=1e-6)
    area = np.radians(236) * ((5.9 + wall) ** 2 - 5.9**2) / 2
    assert found.area_beyond - found.area_inside == pytest.approx(area, rel=1e-3, abs=1e-6)


def test_sections_interpolate_know_the_unseen_and_refuse_other_stations() -> None:
    ramp = np.linspace(0.0, 0.99, 100)[:, None]
    found = cut_section(heading(ramp), 10.5)
    assert found.offset == pytest.approx((10.5 - 8.025) / CELL * 0.01, abs=1e-6)
    offset = heading(0.1).offset.copy()
    offset[:, :50] = np.nan
    hidden = cut_section(heading(offset), 11.0)
    assert np.isnan(hidden.offset[:50]).all() and np.isfinite(hidden.area_beyond)
    for station in (7.0, 14.0, float("nan")):
        with pytest.raises(InputError, match="station"):
            cut_section(heading(), station)


def test_features_keep_their_keys_and_gain_volumes() -> None:
    surface = heading(0.1)
    tree = build_features(surface, 10, {"crop": 0.1})
    assert {"axis", "unsprayed", "arches", "overbreak", "overbreak_volume_m3"} <= set(tree)
    assert {"overbreak_volume_shadow_m3", "bays", "points", "timing_s", "underbreak"} <= set(tree)
    (bay,) = tree["bays"]
    assert bay["station"] == [10.0, 13.0] and bay["arch_before"] is None
    assert tree["spray_volume_m3"]["to_design"] == bay["volume_to_design_m3"] > 0
    filled = heading(0.4)
    object.__setattr__(filled, "filled", np.ones(filled.offset.shape, dtype=bool))
    (need,) = bay_volumes(filled)
    assert need.filled_share == 1.0 and shadow_volume(filled) > 0.0
