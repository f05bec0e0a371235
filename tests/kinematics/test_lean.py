"""Leans: candidates within limits, the rolls worth trying, closer looks, tilts kept to the letter."""

import numpy as np
import pytest
from test_clearance import smooth_heading
from test_feedback import rings

from ascrcp.kinematics import load_arm
from ascrcp.kinematics.aim import SOFTENED, Aim, blend_pinned
from ascrcp.kinematics.barrier import make_barrier
from ascrcp.kinematics.candidate import Grid, make_grid, solve_grid, solve_inside, spread_rolls
from ascrcp.kinematics.feedback import tilt_path
from ascrcp.kinematics.lean import LeanSearch, lean_cone, repeat_points
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.sag import compensate
from ascrcp.kinematics.smooth import make_cost
from ascrcp.kinematics.solver import PathSolver
from ascrcp.kinematics.spacing import STAND_OFF, sum_stretches
from ascrcp.kinematics.task import compute_error, spray_pose

ARM = load_arm("kc")
MODEL, ROOM = ARM.description.path, ARM.description.clearance
assert MODEL is not None and ROOM is not None
LIMIT, STEP = np.radians(ROOM.tilt_limit_deg), np.radians(ROOM.tilt_step_deg)
GRID = make_grid(ARM, MODEL)
PATH = rings([11.0, 12.0])


def search() -> LeanSearch:
    barrier = make_barrier(ARM, Obstacles.from_surface(smooth_heading(), ARM))
    return LeanSearch(ARM, MODEL, make_cost(ARM, MODEL), GRID, barrier, ROOM.wanted, LIMIT, STAND_OFF, 0.0)


def test_candidates_within_limits_are_those_of_the_whole_grid_in_its_order():
    T = spray_pose(PATH)[::15]
    whole = solve_grid(ARM, T, GRID)
    inside = ARM.within_limits(whole)
    pose, row, q = solve_inside(ARM, T, GRID)
    np.testing.assert_array_equal(np.argwhere(inside)[:, :2], np.column_stack([pose, row]))
    np.testing.assert_array_equal(whole[inside], q)
    only = np.zeros((len(T), len(GRID.rows)), dtype=bool)
    only[3, ::2] = True
    some = solve_inside(ARM, T, GRID, only)
    kept = (pose == 3) & (row % 2 == 0)
    np.testing.assert_array_equal(some[2], q[kept])
    assert not len(solve_inside(ARM, T, GRID, np.zeros_like(only))[2])


def test_rolls_beside_those_of_use_hold_the_candidates_of_the_leans():
    rows = np.arange(0, len(PATH), 12)
    leans = np.concatenate([lean_cone(PATH.direction[i], [LIMIT], 8) for i in rows])
    ways = len(leans) // len(rows)
    T = compensate(ARM, spray_pose(tilt_path(repeat_points(PATH, rows, ways), leans, STAND_OFF)))
    pose, row, _ = solve_inside(ARM, T[::ways], GRID)
    tried = np.repeat(spread_rolls(GRID, pose, row, len(rows)), ways, axis=0)
    assert tried.mean() < 0.5, "else nothing is saved"
    found, whole = (len(solve_inside(ARM, T, GRID, mask)[2]) for mask in (tried, None))
    assert 0.995 * whole < found <= whole


def test_without_any_candidate_every_roll_is_tried():
    none = np.zeros(0, dtype=np.int64)
    assert spread_rolls(GRID, none, none, 2).all()
    assert spread_rolls(Grid(GRID.rows[:35]), none, none, 1).shape == (1, 35)


def test_a_closer_look_finds_postures_on_the_target_that_keep_more():
    looking = search()
    i = 10
    view = looking._look(PATH, np.array([i]), lean_cone(PATH.direction[i], [LIMIT], 8)[None], None)[0]
    q, lean, free = looking._polish(PATH, i, view)
    assert free.max() >= view[2].max() and len(free) > len(view[2])
    assert ARM.within_limits(q).all() and (np.linalg.norm(lean, axis=1) <= LIMIT + 1e-9).all()
    leaned = tilt_path(repeat_points(PATH, np.array([i]), len(q)), lean, STAND_OFF)
    assert compute_error(ARM, compensate(ARM, spray_pose(leaned)), q).size.max() < 1e-9


def test_cones_are_looked_at_once_and_leans_found_keep_more():
    looking, rows = search(), np.arange(4, 9)
    near = np.tile(ARM.zero_pose, (len(rows), 1))
    gaps, own = np.full(len(rows), 0.2), np.zeros(len(rows), dtype=bool)
    first = looking.find(PATH, rows, gaps, near, own, np.zeros((len(rows), 3)))
    assert sorted(looking.seen) == rows.tolist()
    kept = {i: view[0] for i, view in looking.seen.items()}
    again = looking.find(PATH, rows, gaps, near, own, np.zeros((len(rows), 3)))
    assert all(looking.seen[i][0] is q for i, q in kept.items())
    np.testing.assert_array_equal(first.q, again.q)
    assert (first.best > ROOM.least).all() and np.isfinite(first.q).all()


@pytest.mark.parametrize("seed", range(5))
def test_pinned_tilts_are_kept_to_the_letter_and_the_others_go_over_into_them(seed: int):
    rng = np.random.default_rng(seed)
    soft, wanted = rng.normal(0.0, 0.1, (2, 40, 3))
    stretch = np.repeat([0, 1], 20)
    pinned = rng.random(40) < 0.1
    blended = blend_pinned(soft, wanted, pinned, stretch)
    np.testing.assert_allclose(blended[pinned], wanted[pinned], atol=1e-15)
    rows = np.arange(40)
    away = np.abs(rows[:, None] - rows[pinned]) + 99 * (stretch[:, None] != stretch[pinned])
    far = away.min(axis=1, initial=99) > SOFTENED
    np.testing.assert_array_equal(blended[far], soft[far])


def test_leans_are_taken_back_where_they_are_not_wanted():
    aim = Aim(ARM, PATH, 0.0, MODEL.far)
    rows = np.array([5, 6, 60])
    lean = 0.5 * LIMIT * np.cross(PATH.direction[rows], [1.0, 0.0, 0.0])
    old = aim.wish
    aim.pin(rows, lean, ROOM)
    np.testing.assert_allclose(aim.tilt[rows], lean, atol=1e-15)
    wall = [p.position[rows] + STAND_OFF * p.direction[rows] for p in (aim.path, PATH)]
    np.testing.assert_allclose(wall[0], wall[1], atol=1e-9)
    first = np.arange(len(PATH)) < 30
    aim.put_back(first, old)
    assert not aim.tilt[first].any() and aim.tilt[60].any() and not aim.wish.pinned[5]


@pytest.mark.parametrize("seed", range(3))
def test_a_stretch_is_marked_or_not_throughout_and_ends_with_its_stroke(seed: int):
    rng = np.random.default_rng(seed)
    marked, value = rng.random(30) < 0.5, rng.normal(size=30)
    gaps = np.where(rng.random(30) < 0.2, np.inf, 0.2)
    total = sum_stretches(marked, value, gaps)
    ends = [i for i in range(30) if np.isinf(gaps[i]) or (i > 0 and marked[i] != marked[i - 1])]
    for part in np.split(np.arange(30), ends):
        np.testing.assert_allclose(total[part], value[part].sum(), atol=1e-12)


def test_no_lean_leaves_a_point_short_that_kept_enough():
    solver = PathSolver(ARM, MODEL, PATH, 0.0, ARM.zero_pose, Obstacles.from_surface(smooth_heading(), ARM))
    q, _ = solver.solve(lambda _: None)
    assert not solver._fallen(q, q).any()
    lost = q.copy()
    lost[::7] = np.nan
    kept = solver._free(q) >= ROOM.wanted
    np.testing.assert_array_equal(solver._fallen(q, lost)[kept], np.isnan(lost[kept, 0]))
    for step in (solver.lean, solver._turn_back):
        assert not solver._fallen(q, step(q, lambda _: None)).any()
