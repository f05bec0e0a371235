"""What a further spraying is to lay, on a wall whose lacks are set by hand."""

import dataclasses

import numpy as np
import pytest
from planning_heading import heading

from ascrcp.core.errors import InputError, NothingToSprayError
from ascrcp.planning.dose import find_exposed, find_stretches
from ascrcp.planning.misfit import find_need
from ascrcp.planning.parameter import change, load_parameters
from ascrcp.planning.prune import _worth_driving
from ascrcp.planning.respray import LEAST_SHARE, Respray, find_budget, find_respray
from ascrcp.planning.spray_plan import plan_spray, walls_before
from ascrcp.planning.target import Left, mean_finish

PARAMETERS = load_parameters()
PROCESS = PARAMETERS.process
TOLERANCE = PROCESS.target.tolerance_m
SURFACE = heading(floor_z=-1.9)
PLAN = plan_spray(SURFACE, PARAMETERS.path, PROCESS)
TARGET = PLAN.target


def strip(first: float, last: float) -> np.ndarray:
    """Cells of the wall between two arc lengths."""
    return TARGET.inside & (TARGET.along > first) & (TARGET.along < last)


def respray(lack: np.ndarray, reserve: float | None = None) -> Respray:
    process = PROCESS if reserve is None else change(PROCESS, dose=change(PROCESS.dose, reserve=reserve))
    return find_respray(TARGET, TARGET.wanted + lack, SURFACE.unsprayed, process)


def patches(found: Respray) -> np.ndarray:
    need = find_need(found.target, PROCESS)
    return mean_finish(need, found.target.inside, found.target, PROCESS.target.patch_m)


def test_the_budget_is_what_the_wall_lacks_but_for_the_reserve() -> None:
    nothing = find_budget(TARGET, TARGET.offset, PROCESS)
    whole = TARGET.volume(TARGET.thickness)[TARGET.inside & ~TARGET.arch].sum()
    assert nothing == pytest.approx((1.0 - PROCESS.dose.reserve) * whole, rel=0.02)
    assert find_budget(TARGET, TARGET.wanted, PROCESS) == pytest.approx(
        -PROCESS.dose.reserve * whole, rel=0.1
    )
    unseen = np.where(TARGET.along > TARGET.along.mean(), TARGET.offset, np.nan)
    assert 0.3 * nothing < find_budget(TARGET, unseen, PROCESS) < 0.7 * nothing


def test_the_more_concrete_is_left_the_smaller_the_lacks_that_are_sprayed() -> None:
    """A wall whose lack rises along the arc from nothing to twice the tolerance."""
    lack = np.broadcast_to(2.0 * TOLERANCE * TARGET.along / TARGET.along[-1], TARGET.offset.shape)
    least = [
        float(np.nanmin(patches(found)[found.thin]))
        for found in (respray(lack, reserve) for reserve in (0.0, 0.06, 0.12))
    ]
    assert LEAST_SHARE * TOLERANCE - 1e-3 < least[0] < least[1] < least[2] < TOLERANCE + 1e-3
    for reserve in (0.0, 0.06, 0.12, 0.5):
        found = respray(lack, reserve)
        beyond = np.nan_to_num(patches(found)) > TOLERANCE
        assert found.thin[beyond].all(), "what lacks more than the tolerance is sprayed whatever it takes"


def test_patches_that_take_the_budget_are_chosen() -> None:
    lack = np.broadcast_to(2.0 * TOLERANCE * TARGET.along / TARGET.along[-1], TARGET.offset.shape)
    found = respray(lack, 0.06)
    process = change(PROCESS, dose=change(PROCESS.dose, reserve=0.06))
    budget = find_budget(TARGET, TARGET.wanted + lack, process)
    layer = np.where(found.thin, np.nan_to_num(patches(found)) - found.leave, 0.0)
    assert (TARGET.area * layer)[found.target.inside].sum() == pytest.approx(budget, rel=0.2)


def test_what_is_left_thinner_is_less_where_the_tolerance_is_passed_and_nothing_where_nothing_lacks() -> None:
    lack = np.where(strip(11.0, 12.0), 0.015, np.where(strip(14.0, 15.0), 0.05, 0.0))
    found = respray(lack, 0.0)
    middle = TARGET.along[np.newaxis, :] * np.ones(lack.shape)
    near, far = (found.leave[found.target.inside & (np.abs(middle - a) < 0.2)] for a in (11.5, 14.5))
    assert 0.0 < far.mean() < near.mean() < TOLERANCE
    np.testing.assert_allclose(found.leave[strip(17.0, 18.0)], 0.0, atol=1e-9)


def test_what_is_too_thick_does_not_make_up_for_what_is_too_thin_beside_it() -> None:
    row = np.abs(TARGET.along - 13.0) < 1.0
    thin = row & (np.abs(TARGET.station[:, None] - 11.7) < 0.16) & ~TARGET.arch
    beside = row & (np.abs(TARGET.station[:, None] - 12.0) < 0.13) & ~TARGET.arch
    found = respray(np.where(thin, 0.06, np.where(beside, -0.20, 0.0)))
    edge = thin & ~np.roll(thin, -1, axis=0)
    assert found.thin[edge].all(), "the row next to the excess counts too"
    assert find_need(found.target, PROCESS).min() == pytest.approx(-TOLERANCE)


def test_what_is_not_seen_is_left_out_and_a_wall_within_tolerance_is_left_alone() -> None:
    lack = np.full(TARGET.offset.shape, 0.06)
    lack[:, TARGET.along > 12.0] = np.nan
    found = respray(lack)
    assert (found.target.left[strip(12.1, 20.0)] == Left.UNSEEN).all() and not found.thin[
        strip(12.3, 20.0)
    ].any()
    with pytest.raises(NothingToSprayError, match=r"every patch of 0\.3 m lacks less than 20 mm"):
        respray(np.zeros(lack.shape))
    with pytest.raises(InputError, match="shows none of the wall"):
        respray(np.full(lack.shape, np.nan))


def test_where_the_nozzle_hardly_moves_as_it_turns_the_wall_is_exposed_all_the_same() -> None:
    """The same jets on the wall, their nozzles drawn together to a tenth of their way."""
    lines, everywhere = PLAN.lines, np.ones(len(PLAN.lines.along), dtype=bool)
    walls = walls_before(lines, TARGET, PLAN.layout.layers)
    found = find_stretches(lines, lines.jet, everywhere, TARGET, walls, PROCESS)
    turned = dataclasses.replace(found, length=found.length / 10.0, growth=found.growth / 10.0)
    for again in (False, True):
        ours, theirs = (find_exposed(each, lines, TARGET, PROCESS, again) for each in (found, turned))
        np.testing.assert_array_equal(ours, theirs)
        assert ours[TARGET.inside].mean() > 0.9
    short = dataclasses.replace(lines, wall=lines.wall * 0.2)
    assert find_exposed(found, short, TARGET, PROCESS, False).sum() < 0.1 * TARGET.inside.sum()


def test_strokes_that_lay_too_little_each_are_driven_where_one_does_for_those_close_by() -> None:
    places = [0.0, 0.1, 0.2, 0.9, 2.0, 2.1]
    wall = np.array([[10.0 + x, 5.0, 0.0] for x in places])
    pieces = [np.array([k]) for k in range(len(places))]
    kept = _worth_driving(pieces, [0.0004, 0.0005, 0.0003, 0.0009, 0.002, 0.0001], wall, 0.21)
    assert [int(piece[0]) for piece in kept] == [1, 4], (
        "three do with one; one alone is too little; one is enough"
    )
