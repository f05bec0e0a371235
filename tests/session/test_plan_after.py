"""`plan --after`, and the check before motion, on a small heading that was scanned, and scanned again."""

import errno
from pathlib import Path

import numpy as np
import pytest
from scanned_site import CONFIGURED, OVERLAY, Site, build_site

from ascrcp.core.errors import InputError, RefusedError
from ascrcp.core.geometry import apply_transform
from ascrcp.planning.layer import limit_layer
from ascrcp.planning.parameter import change
from ascrcp.planning.spray_plan import plan_spray
from ascrcp.planning.table import read_joints, read_path
from ascrcp.planning.target import mean_patch
from ascrcp.session import stages
from ascrcp.session.achieved import find_grid
from ascrcp.session.round import Round
from ascrcp.session.store import read_json, read_surface, write_json, write_surface

POST = (0.9, 2.2)  # metres into the part to spray, and left of the axis


@pytest.fixture(scope="module")
def site() -> Site:
    return build_site()


@pytest.fixture
def folder(site: Site, tmp_path: Path) -> Path:
    """A round that is recognised and planned."""
    place = tmp_path / "round"
    place.mkdir()
    write_surface(Round(place).surface, site.surface)
    stages.plan(place, CONFIGURED)
    return place


def save(place: Path, points: np.ndarray) -> Path:
    np.savetxt(place, points, fmt="%.4f")
    return place


def sprayed(site: Site, lack: np.ndarray | float) -> np.ndarray:
    """A scan of the heading sprayed to the design line but for a lack [m]."""
    rock = np.maximum(np.maximum(site.bare.rock, 0.03) - lack, 0.0)
    return site.scan(rock, np.full(rock.shape, 0.02), 5)


def post(site: Site) -> np.ndarray:
    """Echoes of a post of 0.4 m from the floor to the crown before the wall, base frame."""
    axis, first = site.surface.axis, site.surface.unsprayed[0]
    height, turn = (x.ravel() for x in np.meshgrid(np.arange(-2.0, 5.0, 0.04), np.arange(0.0, 6.28, 0.2)))
    local = np.column_stack([first + POST[0] + 0.2 * np.cos(turn), POST[1] + 0.2 * np.sin(turn), height])
    return apply_transform(axis.T_base_tunnel, local).astype(np.float32)


def far_from_post(site: Site, folder: Path) -> float:
    """How near the nozzle comes to the post's axis [m]."""
    sequence = read_joints(Round(folder).joints)
    T = np.linalg.inv(site.surface.axis.T_base_tunnel)
    tip = apply_transform(T, sequence.position[sequence.spraying])
    return float(np.hypot(tip[:, 0] - site.surface.unsprayed[0] - POST[0], tip[:, 1] - POST[1]).min())


def test_what_a_further_scan_shows_too_thin_is_planned(site: Site, folder: Path, tmp_path: Path) -> None:
    first = len(read_path(Round(folder).path))
    band = (np.abs(site.bare.along - 12.0) < 0.6)[None, :] * 0.06
    again = stages.plan(folder, CONFIGURED, save(tmp_path / "after.xyz", sprayed(site, band)))
    assert 0 < len(again) < 0.6 * first
    told = read_json(Round(folder).prediction)
    assert told["again"] and "driven" not in told
    assert told["rebound"]["wall"] == CONFIGURED.process.rebound.wall, "nothing is known to have been sprayed"
    now = read_surface(Round(folder).now)
    assert np.nanmean(site.surface.offset - now.offset) > 0.02, "the wall has come nearer"
    stages.plan(folder, CONFIGURED)
    assert not Round(folder).now.exists()


def test_the_rebound_is_learned_from_what_was_run_alone(site: Site, folder: Path, tmp_path: Path) -> None:
    stages.solve(folder, "kc", CONFIGURED, 0.0)
    round_, cloud = Round(folder), save(tmp_path / "after.xyz", sprayed(site, 0.03))
    kept = {file: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    planned = len(read_path(round_.path))

    def learned(reached: int | None) -> bool:
        for file, data in kept.items():
            file.write_bytes(data)
        if reached is not None:
            points = {"planned": planned, "reached": reached, "skipped": 0, "left_out": 0}
            write_json(round_.result, {"points": points})
        stages.plan(folder, CONFIGURED, cloud)
        return bool(read_json(round_.prediction)["rebound"]["wall"] != CONFIGURED.process.rebound.wall)

    assert learned(planned)
    assert not learned(planned // 2), "stopped half way"
    round_.result.unlink()
    assert not learned(None), "solved, not run"
    write_json(round_.result, {"points": 3})
    round_.joints.write_bytes(kept[round_.joints])
    with pytest.raises(InputError, match=r"result\.json: no result of a run"):
        stages.plan(folder, CONFIGURED, cloud)


def test_a_new_solution_forgets_the_run_of_the_old_one(folder: Path) -> None:
    write_json(Round(folder).result, {})
    stages.solve(folder, "kc", CONFIGURED, 0.0)
    assert Round(folder).joints.exists() and not Round(folder).result.exists()


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ("deeper", "deeper than before"),
        ("arches", "of the arches of the first one"),
        ("elsewhere", "registration"),
        ("few", "registration: too few points"),
    ],
)
def test_a_scan_of_another_wall_is_refused(
    site: Site, folder: Path, tmp_path: Path, other: str, why: str
) -> None:
    none = np.zeros(site.bare.rock.shape)
    if other == "deeper":
        points = site.scan(none - 0.2, none, 6)
    elif other == "arches":
        points = build_site(12, OVERLAY | {"arches": {"count": 0}}).surface.points
    else:
        points = site.surface.points[:: 400 if other == "few" else 1] * (1.0, 0.7, 0.7)
    before = {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    with pytest.raises(InputError, match=rf"{why}.*is it of this heading"):
        stages.plan(folder, CONFIGURED, save(tmp_path / "after.xyz", points))
    assert {f.name: f.read_bytes() for f in folder.iterdir() if f.is_file()} == before


def test_the_arm_keeps_clear_of_what_a_further_scan_shows(site: Site, folder: Path, tmp_path: Path) -> None:
    cloud = np.concatenate([sprayed(site, 0.05), post(site)])
    stages.plan(folder, CONFIGURED, save(tmp_path / "after.xyz", cloud))
    stages.solve(folder, "kc", CONFIGURED, 0.0)
    assert far_from_post(site, folder) > 0.3
    stages.load(folder, "kc", CONFIGURED)
    now = Round(folder).now.read_bytes()
    Round(folder).now.unlink()
    stages.solve(folder, "kc", CONFIGURED, 0.0)
    assert far_from_post(site, folder) < 0.3, "it is in the way"
    Round(folder).now.write_bytes(now)
    with pytest.raises(RefusedError, match="body"):
        stages.load(folder, "kc", CONFIGURED)


def test_a_sequence_of_another_path_is_refused(folder: Path) -> None:
    stages.solve(folder, "kc", CONFIGURED, 0.0)
    assert stages.load(folder, "kc", CONFIGURED).planned == len(read_path(Round(folder).path))
    kept = Round(folder).joints.read_bytes()
    wide = change(CONFIGURED.process, dose=change(CONFIGURED.process.dose, point_spacing_m=0.4))
    stages.plan(folder, change(CONFIGURED, process=wide))
    Round(folder).joints.write_bytes(kept)
    with pytest.raises(InputError, match=r"joints\.csv: names point \d+, the path has \d+"):
        stages.load(folder, "kc", CONFIGURED)


def test_a_full_disk_leaves_the_plan_as_it_was(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {file.name: file.read_bytes() for file in folder.iterdir()}

    def full(*args: object, **arrays: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(InputError, match="No space left"):
        stages.plan(folder, CONFIGURED)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


def test_a_further_spraying_lays_no_thicker_layer_than_stays_up(site: Site) -> None:
    """Nothing was laid by the first: all is to be laid by strokes that lie twice as densely."""
    path, process = CONFIGURED.path, CONFIGURED.process
    target = find_grid(site.surface, CONFIGURED)
    plan = plan_spray(site.surface, path, process, target.offset)
    first, layer = plan.dose.stretches.first, plan.lines.layer
    limit = limit_layer(target, process.layer)
    for number in np.unique(layer):
        grown = plan.grown(np.where(layer[first] == number, plan.dose.amount, 0.0))
        mean = mean_patch(grown, ~target.arch, target.cell, process.target.patch_m)
        assert np.nanmax(mean / limit) < 1.12
