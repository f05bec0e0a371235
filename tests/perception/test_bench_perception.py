"""Recognition on generated headings of the kinds the bench proves it on, and what it must refuse."""

from functools import cache

import numpy as np
import pytest

from ascrcp.cli.bench_perception import scaled, try_refusals
from ascrcp.cli.bench_survey import alignment_error, measure_pair
from ascrcp.cli.heading_verdict import Verdict, judge
from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Cloud
from ascrcp.core.profile import Profile
from ascrcp.perception.overbreak import across_shadow
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.recognise import recognise
from ascrcp.perception.wall import is_mixed
from ascrcp.simulation.variety import Sample, draw_sample, load_variety, pocket_of

VARIETY = load_variety()
KINDS = {kind.name: kind for kind in VARIETY.kinds}
SEEDS = {"leaning, not concentric": 41, "a busy site": 42, "dense cloud, open face": 2012, "sprayed only": 44}


@cache
def sample(name: str) -> Sample:
    return draw_sample(VARIETY, KINDS[name], SEEDS[name], (0.5, 0.5))


@cache
def verdict(name: str) -> Verdict:
    made = sample(name)
    return judge(recognise(made.cloud, made.heading.truth.profile, load_parameters()), made)


@pytest.mark.parametrize("name", SEEDS)
def test_arches_and_pockets_of_a_nasty_heading(name: str) -> None:
    v = verdict(name)
    assert not v.missed_arches and not v.false_arches
    assert not v.missed_pockets and not v.false_regions and not v.split
    assert all(abs(e) <= 20.0 for e in v.station_mm)
    assert all(abs(e) <= 0.5 for e in v.lean_deg)
    assert v.axis_deg <= 0.1 and v.axis_mm <= 10.0 and not v.bare


@pytest.mark.parametrize("name", [name for name in SEEDS if name != "sprayed only"])
def test_volume_in_sight_is_near_the_truth(name: str) -> None:
    v = verdict(name)
    assert abs(v.volume / v.volume_true - 1.0) <= 0.10


def test_every_kind_says_what_it_draws() -> None:
    assert len(KINDS) == len(VARIETY.kinds) >= 12
    made = sample("leaning, not concentric")
    again = draw_sample(VARIETY, made.kind, SEEDS[made.kind.name], (0.5, 0.5))
    assert np.array_equal(made.cloud.points, again.cloud.points)
    assert len(made.heading.truth.arches) == 3
    assert set(np.unique(pocket_of(made.heading))) == set(range(len(made.heading.truth.pockets)))


def test_no_heading_too_few_points_and_another_profile_are_refused() -> None:
    refusals = try_refusals(VARIETY, 5)
    assert [r.what for r in refusals if r.message is None] == []
    assert all("\n" not in str(r.message) for r in refusals)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("seed", [902000, 903002])
def test_one_side_wall_is_refused_however_long(seed: int, side: float) -> None:
    made = draw_sample(VARIETY, KINDS["plain"], seed, (0.2, 0.2))
    truth = made.heading.truth
    left = ((made.cloud.points - truth.axis.point) @ truth.axis.T_base_tunnel[:3, :3])[:, 1]
    with pytest.raises(RecognitionError, match=r"of the arc|m of wall"):
        recognise(Cloud(made.cloud.points[side * left > 4.0]), truth.profile, load_parameters())


def test_a_scaled_profile_keeps_its_lines() -> None:
    profile: Profile = sample("sprayed only").heading.truth.profile
    wider = scaled(profile, 0.5)
    assert wider.arcs[0].radius == profile.arcs[0].radius + 0.5
    assert (wider.arch_line, wider.overbreak_line) == (profile.arch_line, profile.overbreak_line)


def test_a_shadow_between_two_finds_joins_them_and_open_wall_does_not() -> None:
    seen, filled = np.zeros((20, 3), dtype=bool), np.zeros((20, 3), dtype=bool)
    seen[3:6], seen[12:15] = True, True
    filled[6:12, 0] = True  # all shadow
    filled[8:11, 1] = True  # shadow with narrow rims
    joined = across_shadow(seen, filled)  # column 2: open wall
    assert joined[6:12, :2].all() and not joined[:, 2].any()
    assert not joined[:6].any() and not joined[12:].any()


def test_an_echo_in_the_air_is_mixed_and_a_deep_cell_is_not() -> None:
    mean = np.full((20, 20), 0.3)
    mean[6:14] = np.nan
    mean[10, 5], mean[10, 15] = -0.1, 0.35
    near = np.ones(mean.shape, dtype=bool)
    assert np.argwhere(is_mixed(mean, near, 24)).tolist() == [[10, 5]]
    assert not is_mixed(mean, ~near, 24).any()


def test_survey_figures_of_one_pair_and_one_alignment() -> None:
    assert abs(alignment_error(np.random.default_rng(3))) <= 0.05
    pair = measure_pair(12)
    assert pair.away_mm <= 3.0
    assert len(pair.blocks_mm) > 20 and np.abs(pair.blocks_mm).max() <= 5.0
