import dataclasses

import numpy as np
import pytest
from planning_heading import heading, scan_of

from ascrcp.core.errors import ConfigError, InputError, NothingToSprayError
from ascrcp.core.flow import JointSequence, Surface
from ascrcp.planning import misfit, prune
from ascrcp.planning.deposition import Jet, deposit
from ascrcp.planning.dose import SAMPLES, explain, find_stretches, renew_stretches, solve_dose
from ascrcp.planning.finish import judge_finish
from ascrcp.planning.layer import limit_layer, take_turns
from ascrcp.planning.learning import learn_rebound
from ascrcp.planning.misfit import held_back, steepness
from ascrcp.planning.parameter import change, check_parameters, load_parameters
from ascrcp.planning.prediction import predict
from ascrcp.planning.pump import fill_flow, laid_amount
from ascrcp.planning.rescan import find_after
from ascrcp.planning.spray_plan import SprayPlan, plan_spray, replan, walls_before
from ascrcp.planning.target import LEFT_TEXT, Left
from ascrcp.planning.wall import find_floor, fit_wall

PARAMETERS = load_parameters()
PROCESS = PARAMETERS.process
SURFACE = heading(pockets=((10.7, 63.0, 0.4, 0.35), (12.8, 120.0, 0.35, 0.3)), floor_z=-1.9)


def make(surface: Surface = SURFACE, **more: object) -> SprayPlan:
    return plan_spray(surface, PARAMETERS.path, PROCESS, **more)  # type: ignore[arg-type]


PLAN = make()


def test_the_prediction_meets_the_target() -> None:
    found = predict(PLAN, PROCESS)
    finish = found.finish
    assert finish.within > 0.97 and finish.deviation < 0.010 and finish.thickest < 0.03
    assert finish.area > 35.0
    # what is pumped is what is wanted, what lands beside it, and what rebounds
    assert found.laid == pytest.approx(found.wanted, rel=0.15)
    assert 0.2 < found.rebound < 0.45


def test_a_constant_dose_is_far_worse() -> None:
    dose = PLAN.dose
    even = np.full(len(dose.amount), dose.volume / dose.stretches.length.sum())
    flat = PLAN.target.offset - PLAN.grown(even) - PLAN.target.wanted
    ours = PLAN.target.offset - PLAN.growth - PLAN.target.wanted
    assert flat[PLAN.exposed].std() > 2.0 * ours[PLAN.exposed].std()


def test_deep_places_come_first_in_layers_then_bay_by_bay() -> None:
    lines = PLAN.lines
    assert lines.overbreak[0] and not lines.overbreak[-1]
    assert (np.diff(lines.overbreak.astype(int)) <= 0).all()
    assert lines.layer.max() >= 3 and set(lines.layer[~lines.overbreak]) == {1}
    assert (np.diff(lines.bay[~lines.overbreak]) >= 0).all()
    deep = lines.overbreak & (np.abs(lines.wall[:, 0] - 10.7) < 0.5)
    assert (np.diff(lines.layer[deep]) <= 0).all()


def test_no_layer_is_thicker_than_stays_up() -> None:
    found = predict(PLAN, PROCESS)
    assert found.layer <= 1.15 * limit_layer(PLAN.target, PROCESS.layer).max()


def test_nozzles_keep_stand_off_side_of_the_seam_and_floor() -> None:
    lines, p = PLAN.lines, PARAMETERS.path
    away = np.linalg.norm(lines.nozzle - lines.wall, axis=1)
    once = lines.layer == 1
    np.testing.assert_allclose(away[once], p.stand_off_m, atol=0.02)
    assert away[~once].min() > PROCESS.dose.near_stand_off_m - 1e-9
    assert lines.nozzle[:, 2].min() >= find_floor(SURFACE) + p.floor_clearance_m - 1e-9
    for number in np.unique(lines.pass_index):
        theta3 = lines.theta3[lines.pass_index == number]
        assert (theta3 >= -1e-9).all() or (theta3 <= 1e-9).all()


def test_arches_are_sprayed_from_both_sides_and_covered() -> None:
    lines, target = PLAN.lines, PLAN.target
    tilt = np.round(np.degrees(lines.theta2))
    for arch in (11.2, 12.18):
        for side, wanted in ((-1, 75), (1, 105)):
            near = (np.abs(lines.wall[:, 0] - arch - 0.22 * side) < 0.03) & (lines.layer == 1)
            assert near.any() and (tilt[near] == wanted).all()
    lack = (target.offset - PLAN.growth - target.wanted)[target.arch & PLAN.exposed]
    assert abs(lack.mean()) < 0.01
    # before the face the nozzle stays back
    assert (tilt[lines.wall[:, 0] > 13.0] == PROCESS.dose.face_tilt_deg).all()


def test_speed_and_flow_lay_the_dose_within_what_pump_and_nozzle_can() -> None:
    first, amount = PLAN.dose.stretches.first, PLAN.dose.amount
    speed, flow = PLAN.path.speed[first], PLAN.path.flow[first]
    slow, fast = PROCESS.dose.speed_m_s
    assert (speed >= slow - 1e-12).all() and (speed <= fast + 1e-12).all()
    np.testing.assert_allclose(flow * PROCESS.spray.pump_m3_s / speed, amount, rtol=1e-9, atol=1e-12)
    ends = np.setdiff1d(np.arange(len(PLAN.path)), first)
    assert (PLAN.path.flow[ends] == 0.0).all()
    full = flow[(flow > 0.0) & (speed < fast - 1e-9) & (speed > slow + 1e-9)]
    assert np.isclose(full[:, None], PROCESS.spray.pump_steps, atol=1e-9).any(axis=1).all()


def test_what_cannot_be_covered_is_named() -> None:
    left = predict(PLAN, PROCESS).left
    assert Left.FLOOR.code in left and all(area > 0.0 for area in left.values())
    holes = heading(holes=0.2)
    offset = holes.offset.copy()
    offset[:, 150:200] = np.nan
    unseen = predict(make(dataclasses.replace(holes, offset=offset)), PROCESS).left
    assert unseen[Left.UNSEEN.code] > 1.0


def test_points_the_arm_does_not_reach_are_left_out_and_their_neighbours_help() -> None:
    reached = np.ones(len(PLAN.path), dtype=bool)
    gone = (np.abs(PLAN.lines.wall[:, 0] - 11.7) < 0.3) & (np.abs(np.degrees(PLAN.path.angle) - 90) < 10)
    reached[gone] = False
    found = replan(PLAN.layout, SURFACE, PLAN.path, reached, PROCESS)
    assert not np.isin(found.dose.stretches.first, np.flatnonzero(gone)).any()
    assert predict(found, PROCESS).left[Left.ARM.code] > 0.3
    same = replan(PLAN.layout, SURFACE, PLAN.path, np.ones(len(PLAN.path), bool), PROCESS)
    assert np.abs(same.growth - PLAN.growth)[PLAN.exposed].mean() < 0.001
    assert predict(same, PROCESS).finish.within > predict(PLAN, PROCESS).finish.within - 0.005


def rows(plan: SprayPlan, slower: float = 1.0) -> JointSequence:
    """The path at its own speeds, or so much slower everywhere, as rows 50 ms apart."""
    path = plan.path
    way = np.linalg.norm(np.diff(path.position, axis=0), axis=1)
    t = np.concatenate([[0.0], np.cumsum(np.maximum(way, 0.02) / path.speed[:-1] * slower)])
    fine = np.unique(np.concatenate([t, np.arange(0.0, t[-1], 0.05)]))
    index = np.searchsorted(fine, t)
    point = np.full(len(fine), -1)
    point[index] = np.arange(len(t))
    position = np.column_stack([np.interp(fine, t, x) for x in path.position.T])
    direction = np.column_stack([np.interp(fine, t, x) for x in path.direction.T])
    return JointSequence(
        t=fine,
        q=np.zeros((len(fine), 8)),
        position=position,
        direction=direction,
        point=point,
        spraying=np.arange(len(fine)) < len(fine) - 1,
    )


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_the_pump_follows_a_slower_nozzle_so_that_the_dose_stays(slower: float) -> None:
    sequence = fill_flow(rows(PLAN, slower), PLAN.path, PROCESS.spray)
    stretches = PLAN.dose.stretches
    laid = laid_amount(sequence, stretches.first, stretches.length, len(PLAN.path), PROCESS.spray)
    held = PLAN.path.flow[stretches.first] / slower > PROCESS.spray.pump_least
    error = (laid - PLAN.dose.amount)[held]
    assert np.abs(error).mean() < 0.04 * PLAN.dose.amount.mean()
    on = sequence.flow[sequence.flow > 0.0]
    assert on.min() >= PROCESS.spray.pump_least - 1e-12
    assert predict(PLAN, PROCESS, sequence).pumped == pytest.approx(PLAN.dose.volume, rel=0.02)


def test_a_second_plan_sprays_the_thin_patch_only() -> None:
    thin = (np.abs(PLAN.target.station[:, None] - 11.7) < 0.3) & (np.abs(PLAN.target.along - 13.0) < 0.5)
    layer = PLAN.target.offset - PLAN.target.wanted
    after = find_after(scan_of(SURFACE, PLAN.target, layer - 0.05 * thin), SURFACE, PLAN.target)
    lack = after - PLAN.target.wanted
    assert np.nanmean(lack[thin]) == pytest.approx(0.05, abs=0.005)
    assert np.nanmean(np.abs(lack[PLAN.exposed & ~thin])) < 0.005
    again = make(after=after)
    assert len(again.path) < 0.1 * len(PLAN.path)
    assert np.abs(again.lines.wall[:, 0] - 11.7).max() < 0.5
    grown = again.growth
    middle = (np.abs(PLAN.target.station[:, None] - 11.7) < 0.15) & (np.abs(PLAN.target.along - 13.0) < 0.35)
    assert grown[middle].mean() == pytest.approx(0.05, abs=0.008)
    far = (np.abs(PLAN.target.station[:, None] - 11.7) > 0.7) & np.ones(grown.shape, dtype=bool)
    assert grown[far].max() < 0.005


def test_nothing_thin_is_said_and_nothing_planned() -> None:
    after = find_after(
        scan_of(SURFACE, PLAN.target, PLAN.target.offset - PLAN.target.wanted), SURFACE, PLAN.target
    )
    with pytest.raises(InputError, match="nothing left to spray"):
        make(after=after)


def test_nonsense_is_refused() -> None:
    for name, value in (("stand_off_m", 0.0), ("floor_clearance_m", float("nan"))):
        with pytest.raises(ConfigError, match=name):
            plan_spray(SURFACE, change(PARAMETERS.path, **{name: value}), PROCESS)
    with pytest.raises(ConfigError, match="pump_m3_h"):
        plan_spray(SURFACE, PARAMETERS.path, change(PROCESS, spray=change(PROCESS.spray, pump_m3_h=-1.0)))
    with pytest.raises(ConfigError, match=r"gap_m 0\.2 must exceed point_spacing_m 0\.2"):
        check_parameters(change(PARAMETERS, timing=change(PARAMETERS.timing, gap_m=0.2)))
    with pytest.raises(NothingToSprayError, match=r"stand_off_m 3 and rebound best_m 1 80 % rebound"):
        plan_spray(SURFACE, change(PARAMETERS.path, stand_off_m=3.0), PROCESS)
    with pytest.raises(InputError, match="no bay"):
        make(dataclasses.replace(SURFACE, bays=()))
    with pytest.raises(InputError, match="nothing was seen"):
        make(dataclasses.replace(SURFACE, offset=np.full_like(SURFACE.offset, np.nan)))


def test_same_surface_same_plan() -> None:
    again = make()
    assert again.path.position.tobytes() == PLAN.path.position.tobytes()
    assert again.path.flow.tobytes() == PLAN.path.flow.tobytes()


def test_flanks_are_held_back_and_arches_are_not_flanks() -> None:
    held, steep = held_back(PLAN.target, PROCESS, again=False), steepness(PLAN.target)
    assert (steep[PLAN.target.arch] == 0.0).all() and (steep < 1.0).all() and steep.max() > 0.2
    np.testing.assert_allclose(held[PLAN.target.arch], PROCESS.dose.hold_back)
    order = np.argsort(steep.ravel())
    assert (np.diff(held.ravel()[order]) >= 0.0).all()
    assert held.max() <= PROCESS.dose.hold_back + PROCESS.dose.hold_back_slope


def test_where_no_scan_saw_the_wall_a_first_spraying_lays_less_and_a_second_does_not() -> None:
    filled = np.zeros(SURFACE.offset.shape, dtype=bool)
    here = (SURFACE.station > 10.4) & (SURFACE.station < 11.0)
    filled[np.ix_(here, (SURFACE.along > 5.0) & (SURFACE.along < 6.0))] = True
    guessed = dataclasses.replace(SURFACE, filled=filled)
    first = make(guessed)
    place = first.target.guessed > 0.99
    assert place.sum() > 50 and (first.target.guessed[PLAN.target.arch] == 0.0).all()
    more, less = (held_back(plan.target, PROCESS, again=False) for plan in (first, PLAN))
    np.testing.assert_allclose(more - less, PROCESS.dose.hold_back_guess * first.target.guessed, atol=1e-12)
    assert first.growth[place].sum() < 0.92 * PLAN.growth[place].sum()
    after = np.where(place, PLAN.target.wanted + 0.06, PLAN.target.wanted)
    with_guess, without = make(guessed, after=after), make(after=after)
    np.testing.assert_array_equal(with_guess.growth, without.growth)


def test_jets_point_down_above_the_floor_and_leave_nothing_but_its_lap() -> None:
    stiff = plan_spray(SURFACE, change(PARAMETERS.path, floor_tilt_deg=0.0), PROCESS)
    low = find_floor(SURFACE) + PARAMETERS.path.floor_clearance_m
    for plan in (stiff, PLAN):
        assert plan.lines.nozzle[:, 2].min() >= low - 1e-9
        assert plan.lines.wall[:, 2].min() >= find_floor(SURFACE)
    ours, theirs = (predict(plan, PROCESS).left.get(Left.FLOOR.code, 0.0) for plan in (PLAN, stiff))
    assert ours < 0.7 * theirs


def test_a_place_narrower_than_the_passes_gets_one() -> None:
    middle = PLAN.target.station[np.argmin(np.abs(PLAN.target.station - 11.81))]
    thin = (PLAN.target.station[:, None] == middle) & (np.abs(PLAN.target.along - 13.0) < 0.5)
    after = np.where(thin, PLAN.target.wanted + 0.12, PLAN.target.wanted)
    assert make(after=after).growth[thin].mean() > 0.01


def test_a_heap_before_the_wall_does_not_turn_the_jets_above_it() -> None:
    angle = np.degrees(SURFACE.profile.angle(SURFACE.along))
    flat = dataclasses.replace(SURFACE, offset=np.zeros_like(SURFACE.offset))
    heap = dataclasses.replace(flat, offset=np.where(angle < 10.0, -0.5, flat.offset).astype(np.float32))
    a, b = fit_wall(flat, PARAMETERS.path), fit_wall(heap, PARAMETERS.path)
    station, along = np.full(20, 11.8), np.linspace(SURFACE.along[angle > 12.0][0], 6.0, 20)
    limit = np.radians(PARAMETERS.path.normal_limit_deg)
    np.testing.assert_allclose(a.normal(station, along, limit), b.normal(station, along, limit), atol=1e-6)
    assert b.offset.min() < -0.45


def test_the_face_in_the_last_rows_is_no_wall() -> None:
    offset = SURFACE.offset.copy()
    offset[SURFACE.station > SURFACE.unsprayed[1] - 0.08] = -0.3
    wall = fit_wall(dataclasses.replace(SURFACE, offset=offset), PARAMETERS.path)
    assert wall.raw[wall.station > SURFACE.unsprayed[1] - 0.08].min() > -0.11


def test_what_no_jet_exposes_is_told_apart() -> None:
    nothing = np.zeros(PLAN.target.offset.shape, dtype=bool)
    fresh = dataclasses.replace(PLAN.target, left=np.zeros_like(PLAN.target.left))
    left = explain(fresh, nothing, nothing, nothing)
    assert set(np.unique(left)) == {Left.SHADOW, Left.STEEP, Left.EDGE}
    middle = np.argmin(np.abs(fresh.station - fresh.arches[0].station.mean()))
    assert (left[middle] == Left.SHADOW).all()
    assert {reason.code for reason in Left} - {"not", "outside"} == set(LEFT_TEXT)


def sprayed(rebound: dict[str, float]) -> tuple[JointSequence, np.ndarray]:
    """The plan's rows, and the wall they leave where the rebound is another than it believed."""
    sequence = fill_flow(rows(PLAN), PLAN.path, PROCESS.spray)
    process = change(PROCESS, rebound=change(PROCESS.rebound, **rebound))
    everywhere = np.ones(len(PLAN.path), dtype=bool)
    walls = walls_before(PLAN.lines, PLAN.target, PLAN.layout.layers)
    made = find_stretches(PLAN.lines, PLAN.lines.jet, everywhere, PLAN.target, walls, process)
    amount = laid_amount(sequence, made.first, made.length, len(PLAN.path), PROCESS.spray)
    made = renew_stretches(made, amount, PLAN.lines, PLAN.lines.jet, PLAN.target, walls, process)
    return sequence, PLAN.target.offset - (made.growth @ amount).reshape(PLAN.target.offset.shape)


@pytest.mark.parametrize(
    "rebound", [{"wall": 0.23}, {"crown": 0.28}, {"angle": 0.8}, {"wall": 0.17, "crown": 0.38, "angle": 0.3}]
)
def test_a_scan_of_the_sprayed_wall_teaches_the_rebound(rebound: dict[str, float]) -> None:
    sequence, after = sprayed(rebound)
    after += np.random.default_rng(3).normal(0.0, 0.005, after.shape)
    after[40:50, 100:140] = np.nan
    found = learn_rebound(PLAN.layout, SURFACE, sequence, after, PROCESS)
    for name, slack in (("wall", 0.01), ("crown", 0.015), ("angle", 0.15)):
        true = rebound.get(name, getattr(PROCESS.rebound, name))
        assert getattr(found, name) == pytest.approx(true, abs=slack), name
    assert found.distance == PROCESS.rebound.distance


def test_a_rebound_believed_near_its_bound_is_learned_from_below() -> None:
    believed = change(PROCESS.rebound, angle=0.9)
    layout = dataclasses.replace(PLAN.layout, rebound=believed)
    sequence, after = sprayed({})
    found = learn_rebound(layout, SURFACE, sequence, after, PROCESS)
    assert np.isfinite([found.wall, found.crown, found.angle]).all()
    assert found.angle < believed.angle, "the wall shows less"


def test_what_was_hardly_sprayed_teaches_nothing() -> None:
    sequence, after = sprayed({"wall": 0.23})
    half = PLAN.target.along > PLAN.target.profile.length / 2.0
    stopped = np.where(half, PLAN.target.offset, after)
    whole, part = (learn_rebound(PLAN.layout, SURFACE, sequence, a, PROCESS) for a in (after, stopped))
    assert part.wall == pytest.approx(whole.wall, abs=0.01)
    unseen = np.full_like(after, np.nan)
    assert learn_rebound(PLAN.layout, SURFACE, sequence, unseen, PROCESS) == PROCESS.rebound


def test_a_pass_is_reckoned_on_the_wall_that_those_before_it_built() -> None:
    """The last pass over a pocket against its footprints on that wall, half of its own layer laid."""
    lines, target, amount = PLAN.lines, PLAN.target, 1.6 * PLAN.dose.amount
    walls = walls_before(lines, target, PLAN.layout.layers)
    everywhere = np.ones(len(lines.along), dtype=bool)
    taken = find_stretches(lines, lines.jet, everywhere, target, walls, PROCESS)
    renewed = renew_stretches(taken, amount, lines, lines.jet, target, walls, PROCESS)
    number = lines.pass_index[taken.first]
    deep = lines.overbreak[taken.first] & (np.abs(lines.wall[taken.first, 0] - 10.7) < 0.4)
    mine = np.flatnonzero(number == number[np.flatnonzero(deep)[-1]])
    before = np.where(number < number[mine[0]], amount, 0.0)
    half = np.where(number == number[mine[0]], amount / 2.0, 0.0)
    layer = (renewed.growth @ before + taken.growth @ half).reshape(target.offset.shape)
    assert layer.max() > 0.15, "enough has been laid by then to tell the walls apart"
    wall = np.where(target.arch, target.offset, target.offset - layer)
    ends = [lines.jet.pick(taken.first[mine] + k) for k in (0, 1)]
    total = np.zeros(target.offset.size)
    for share in SAMPLES:
        between = (1.0 - share) * ends[0].direction + share * ends[1].direction
        between /= np.linalg.norm(between, axis=1, keepdims=True)
        place = (1.0 - share) * ends[0].position + share * ends[1].position
        total += deposit(Jet(place, between), target, wall, PROCESS) @ taken.length[mine] / len(SAMPLES)
    ours, theirs = (np.asarray(s.growth[:, mine].sum(axis=1)).ravel() for s in (renewed, taken))
    ours, theirs = (np.abs(found - total).max() for found in (ours, theirs))
    assert ours < 0.08 * total.max() and theirs > 3.0 * ours


def test_layers_of_a_deep_place_are_aimed_at_its_flanks_in_turn() -> None:
    lines, p = PLAN.lines, PARAMETERS.path
    tilt = np.degrees(lines.theta2)
    assert ((tilt >= p.tilt_outer_deg - 1e-9) & (tilt <= p.tilt_inner_deg + 1e-9)).all()
    turned = ~np.isin(np.round(tilt, 6), (75.0, 78.0, 90.0, 105.0))
    assert turned.any() and (lines.layer[turned] % 2 == 0).all()


def test_a_second_plan_drives_no_stroke_that_lays_nothing() -> None:
    thin = (np.abs(PLAN.target.station[:, None] - 11.7) < 0.3) & (np.abs(PLAN.target.along - 13.0) < 0.5)
    again = make(after=np.where(thin, PLAN.target.wanted + 0.06, PLAN.target.wanted))
    volume = again.dose.amount * again.dose.stretches.length
    laid = np.bincount(again.lines.pass_index[again.dose.stretches.first], volume)
    assert (laid > 0.0).all() and (np.diff(again.lines.pass_index) >= 0).all()


def test_a_near_nozzle_stands_back_where_it_would_be_too_low() -> None:
    low = PLAN.target.profile.point(PLAN.target.along)[:, 1] < find_floor(SURFACE) + 0.5
    feet = low & (PLAN.target.along < 5.0) & np.ones((len(PLAN.target.station), 1), dtype=bool)
    feet &= (np.abs(PLAN.target.station - 11.7) < 0.3)[:, None] & PLAN.exposed
    again = make(after=np.where(feet, PLAN.target.wanted + 0.06, PLAN.target.wanted))
    assert again.lines.nozzle[:, 2].min() >= find_floor(SURFACE) + PARAMETERS.path.floor_clearance_m - 1e-9
    assert again.growth[feet].mean() > 0.03


def test_a_spraying_none_of_whose_strokes_would_lay_enough_is_not_planned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    thin = (np.abs(PLAN.target.station[:, None] - 11.7) < 0.2) & (np.abs(PLAN.target.along - 13.0) < 0.2)
    after = np.where(thin, PLAN.target.wanted + 0.04, PLAN.target.wanted)
    assert len(make(after=after).path)
    monkeypatch.setattr(prune, "LEAST_M3", 0.05)
    with pytest.raises(NothingToSprayError, match="no stroke would lay 1 l"):
        make(after=after)


def test_a_plan_of_which_no_point_is_reached_lays_nothing() -> None:
    found = replan(PLAN.layout, SURFACE, PLAN.path, np.zeros(len(PLAN.path), dtype=bool), PROCESS)
    assert found.dose.volume == 0.0 and not found.exposed.any()


def test_layers_of_a_deep_place_lie_midway_between_each_others_lines_in_turn() -> None:
    """From the near stand-off one layer's passes leave ridges; laid on each other they would add up."""
    lines = PLAN.lines
    deep = (np.abs(lines.wall[:, 0] - 10.7) < 0.5) & (np.abs(lines.along - lines.along.mean()) < 3.0)

    arches = [np.interp(lines.along, PLAN.target.along, lid.station) for lid in PLAN.target.arches]
    beside = np.min([np.abs(lines.wall[:, 0] - arch) for arch in arches], axis=0) < 0.21  # they lie closer

    def stations(layer: int) -> np.ndarray:
        return np.unique(np.round(lines.wall[deep & ~beside & (lines.layer == layer), 0], 2))

    even, odd = stations(2), stations(3)
    assert len(even) and len(odd)
    apart = np.abs(even[:, None] - odd[None, :]).min(axis=1)
    assert (apart > 0.3 * PROCESS.dose.pass_spacing_m).all()


def test_cells_that_reach_beneath_a_flange_are_not_judged() -> None:
    target = PLAN.target
    beneath = target.beneath
    assert beneath.any() and not (beneath & target.arch).any()
    rows = np.abs(target.station[:, None] - np.stack([lid.station for lid in target.arches])[:, None, :])
    edge = np.abs(rows - target.arches[0].half).min(axis=0)
    assert (edge[beneath] < target.cell[0] / 2.0).all(), "half a cell beside the flange at most"
    assert beneath.sum() < 0.08 * target.inside.sum()
    finish = judge_finish(target.offset, target, target.inside, PROCESS.target)
    assert np.isnan(finish.value[beneath]).all() and np.isfinite(finish.value[target.arch]).any()


def test_a_second_spraying_leaves_a_little_and_no_more() -> None:
    target = PLAN.target
    lack = np.where(target.inside & (np.abs(target.along - 13.0) < 2.0), 0.03, 0.0)
    again = make(after=target.wanted + lack)
    left = (lack - again.growth)[(lack > 0.0) & again.exposed]
    assert 0.0 < left.mean() < 0.3 * PROCESS.target.tolerance_m


def test_what_no_pass_can_fill_is_not_made_up_for_beside_it() -> None:
    target = PLAN.target
    strip = np.abs(target.along - 13.0) < 1.0
    hidden = strip & (np.abs(target.station[:, None] - 11.7) < 0.07) & ~target.arch
    deep = dataclasses.replace(target, offset=target.wanted + np.where(hidden, 0.4, 0.03))
    around = strip & (np.abs(target.station[:, None] - 11.7) < 0.25) & ~hidden & ~target.arch

    def excess(exposed: np.ndarray) -> float:
        dose = solve_dose(
            PLAN.dose.stretches,
            PLAN.lines,
            deep,
            PROCESS,
            target.inside,
            exposed,
            np.zeros(deep.offset.shape),
        )
        return float((dose.layer(deep) - 0.03)[around & target.inside].mean())

    assert excess(target.inside & ~hidden) < 0.01
    assert excess(target.inside) > 0.03, "counted as a lack it is"


def test_a_lack_that_no_jet_fills_pulls_no_harder_than_one_that_can_be_filled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A groove a cell wide, far deeper than its surroundings are thin."""
    row = int(np.argmin(np.abs(PLAN.target.station - 11.8)))
    column = int(np.argmin(np.abs(PLAN.target.along - 13.0)))
    after = np.where(PLAN.exposed, PLAN.target.wanted + 0.01, PLAN.target.wanted)
    after[row, column - 10 : column + 11] += 0.30

    def thickest() -> float:
        again = make(after=after)
        finish = judge_finish(after - again.growth, again.target, PLAN.exposed, PROCESS.target).value
        return -float(np.nanmin(finish[row - 6 : row + 7, column - 10 : column + 11]))

    bounded = thickest()
    monkeypatch.setattr(misfit, "HOPELESS_SHARE", 1e9)
    assert bounded < 0.033 < thickest() - 0.003


def test_even_layers_reach_the_foot_of_a_pocket_beside_an_arch_past_its_flange() -> None:
    plan = make(heading(pockets=((11.35, 63.0, 0.45, 0.4),), floor_z=-1.9))
    lines, lid = plan.lines, plan.target.arches[0]
    apart = np.abs(lines.wall[:, 0] - np.interp(lines.along, plan.target.along, lid.station)) - lid.half
    deep = lines.layer > 1
    nearest = [apart[lines.layer == layer].min() for layer in np.unique(lines.layer[deep])]
    by_turn = [nearest[turn::2] for turn in (0, 1)]  # layer 2 is the first of them
    assert by_turn[0][0] == pytest.approx(0.06, abs=0.02) and min(by_turn[1]) > 0.10


def test_two_passes_that_lay_the_same_do_not_share_a_litre_so_that_neither_is_driven() -> None:
    thin = (np.abs(PLAN.target.station[:, None] - 11.7) < 0.15) & (np.abs(PLAN.target.along - 13.0) < 0.15)
    again = make(after=np.where(thin, PLAN.target.wanted + 0.035, PLAN.target.wanted))
    assert again.growth[thin].mean() > 0.008


@pytest.mark.parametrize("counts", [(3,), (1, 4), (10, 3, 3), ()])
def test_layers_of_deep_parts_take_turns_evenly(counts: tuple[int, ...]) -> None:
    turns = take_turns([[(part, i) for i in range(count)] for part, count in enumerate(counts)])
    assert len(turns) == sum(counts)
    for part, count in enumerate(counts):
        at = [k for k, (mine, _) in enumerate(turns) if mine == part]
        assert [turns[k][1] for k in at] == list(range(count)), "deepest first"
        gaps = np.diff([-1, *at, len(turns)])
        assert gaps.min(initial=len(turns)) >= len(turns) // (2 * count + 1), "none twice in a row needlessly"
