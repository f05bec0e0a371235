import numpy as np
import pytest
from planning_heading import heading, scan_of

from ascrcp.core.geometry import apply_transform, inverse_transform
from ascrcp.perception.raster import unroll
from ascrcp.planning.parameter import load_parameters
from ascrcp.planning.rescan import find_after
from ascrcp.planning.target import find_target
from ascrcp.planning.wall import fit_wall

PARAMETERS = load_parameters()
SURFACE = heading(pockets=((10.7, 63.0, 0.4, 0.35), (12.8, 120.0, 0.35, 0.3)), floor_z=-1.9)
TARGET = find_target(
    SURFACE, fit_wall(SURFACE, PARAMETERS.path), PARAMETERS.process, PARAMETERS.path.bridge_m
)
NOTHING = np.zeros(TARGET.offset.shape)


def hole_in(cloud: np.ndarray) -> tuple[int, np.ndarray]:
    """A row of cells in the middle of a bay, and the points in it and its two neighbours."""
    row = int(np.argmin(np.abs(TARGET.station - 11.8)))
    T = inverse_transform(SURFACE.axis.T_base_tunnel)
    station = apply_transform(T, cloud.astype(float))[:, 0]
    return row, np.abs(station - TARGET.station[row]) < 1.5 * TARGET.cell[0]


def test_a_hole_behind_a_rim_is_read_by_the_line_of_sight() -> None:
    cloud = scan_of(SURFACE, TARGET, np.full(TARGET.offset.shape, 0.02))
    row, hidden = hole_in(cloud)
    found = find_after(cloud[~hidden], SURFACE, TARGET)
    clear = (np.abs(TARGET.along - 13.0) < 2.0) & ~TARGET.arch[row - 2 : row + 3].any(axis=0)
    chord = (found[row - 2] + found[row + 2]) / 2.0
    np.testing.assert_allclose(found[row, clear], chord[clear], atol=1e-6)


@pytest.mark.parametrize(("sprayed_m", "believed_m"), [(0.30, 0.175), (0.0, 0.025)])
def test_what_no_scan_sees_lies_midway_between_its_surroundings_and_what_was_sprayed(
    sprayed_m: float, believed_m: float
) -> None:
    """A wall with 50 mm on it; behind an arch, in a hole of the scan, the plan laid more, or nothing."""
    cloud = scan_of(SURFACE, TARGET, np.full(TARGET.offset.shape, 0.05))
    row, hidden = hole_in(cloud)
    laid = np.full(TARGET.offset.shape, 0.05)
    laid[row - 1 : row + 2] = sprayed_m
    found = find_after(cloud[~hidden], SURFACE, TARGET, TARGET.offset - laid)
    clear = (np.abs(TARGET.along - 13.0) < 2.0) & ~TARGET.arch[row - 2 : row + 3].any(axis=0)
    layer = (TARGET.offset - found)[row, clear]
    assert layer.mean() == pytest.approx(believed_m, abs=0.01)
    assert layer.min() > believed_m - 0.04, "the rock itself is rough"


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_flank_of_which_only_one_side_of_each_cell_is_seen_is_read_at_the_middles(side: float) -> None:
    """From one end of the heading the lidar sees the rim's side of the cells of a flank turned from it."""
    flank = 0.02 + 2.0 * np.clip(TARGET.station - 11.5, 0.0, 0.4)[:, None] + NOTHING
    places = ((side * 0.45, -0.2), (side * 0.3, 0.0), (side * 0.15, 0.2))
    found = find_after(scan_of(SURFACE, TARGET, TARGET.offset - flank, places), SURFACE, TARGET)
    rows = (TARGET.station > 11.6) & (TARGET.station < 11.8)
    clear = np.abs(TARGET.along - 13.0) < 2.0
    assert rows.sum() >= 3
    np.testing.assert_allclose(found[np.ix_(rows, clear)], flank[np.ix_(rows, clear)], atol=1e-3)


def test_the_web_and_the_outer_flange_of_an_arch_are_not_the_rock_beside_it() -> None:
    lid = TARGET.arches[0]
    T = SURFACE.axis.T_base_tunnel
    along = np.linspace(8.0, 16.0, 400)
    rock = scan_of(SURFACE, TARGET, NOTHING)
    clean = find_after(rock, SURFACE, TARGET)
    steel = []
    for side in (-1.0, 1.0):
        station = np.interp(along, TARGET.along, lid.station) + side * (lid.half + 0.02)
        yz = TARGET.profile.point(along, np.full(along.shape, lid.outer))
        steel.append(np.column_stack([station, yz]) @ T[:3, :3].T + T[:3, 3])
    points = np.concatenate([rock, *steel]).astype(np.float32)
    flat = unroll(points[-len(along) :], SURFACE.axis, SURFACE.profile)
    row = np.rint((flat.station - TARGET.station[0]) / TARGET.cell[0]).astype(int)
    assert not TARGET.arch[row, np.rint((flat.along - TARGET.along[0]) / TARGET.cell[1]).astype(int)].all()
    np.testing.assert_array_equal(find_after(points, SURFACE, TARGET), clean)
