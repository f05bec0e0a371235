"""bench: figures with aims, the paper's rule it compares with, and `machines --urdf`."""

import json
from pathlib import Path

import numpy as np
import pytest

from ascrcp.__main__ import main
from ascrcp.cli import bench_headings, bench_inverse, bench_proof
from ascrcp.cli.bench import Figure, time_per_item
from ascrcp.cli.bench_headings import find_gaps, measure_headings
from ascrcp.cli.bench_inverse import measure_inverse
from ascrcp.cli.bench_path import make_path
from ascrcp.cli.point_rule import follow_point_by_point, peak_acceleration
from ascrcp.kinematics import load_arm, spray_pose
from ascrcp.kinematics.task import compute_error


def test_a_figure_is_held_to_its_aim_and_nothing_else_is():
    assert Figure("a", 1.0, "s", 2.0).is_met and not Figure("a", 3.0, "s", 2.0).is_met
    assert Figure("a", 3.0, "x", 2.0, more_is_better=True).is_met
    assert Figure("a", None, "s", 2.0).is_met is None and Figure("a", 1.0, "s").is_met is None
    assert Figure("a", float("nan"), "s", 2.0).is_met is False


def test_time_per_item_is_that_of_this_process():
    assert 0.0 <= time_per_item(lambda: None, 1000, 3) < 1.0


def test_the_built_in_path_runs_to_and_fro_without_a_jump():
    path = make_path(300, 2)
    assert len(path) == 2 * len(make_path(300)) and abs(len(make_path(300)) - 300) < 11
    step = np.linalg.norm(np.diff(path.position, axis=0), axis=1)
    assert step.max() < 0.75
    T = spray_pose(path)
    axis = np.stack([path.station, np.zeros(len(path)), np.full(len(path), -1.85)], axis=-1)
    outward = path.position - axis
    np.testing.assert_allclose(
        T[:, :3, 0], outward / np.linalg.norm(outward, axis=1, keepdims=True), atol=1e-12
    )


def test_the_papers_rule_reaches_its_points_within_limits():
    arm = load_arm("kc")
    path = make_path(110)
    T = spray_pose(path)
    q = follow_point_by_point(arm, T, arm.zero_pose)
    solved = np.isfinite(q[:, 0])
    assert solved.mean() > 0.9
    assert arm.within_limits(q[solved]).all()
    assert compute_error(arm, T[solved], q[solved]).size.max() < 1e-9


def test_peak_acceleration_of_a_parabola_is_its_own():
    arm = load_arm("kc")
    t = np.cumsum(np.random.default_rng(0).uniform(0.1, 0.3, 30))
    q = 0.5 * arm.max_acceleration * t[:, None] ** 2
    gap = np.diff(t, prepend=t[0])
    gap[0] = np.inf
    np.testing.assert_allclose(peak_acceleration(arm, q, gap), 1.0, rtol=1e-9)
    q[15:] += 10.0  # a break in the course is none of its business
    gap[15] = np.inf
    np.testing.assert_allclose(peak_acceleration(arm, q, gap), 1.0, rtol=1e-9)
    q[3] = np.nan
    np.testing.assert_allclose(peak_acceleration(arm, q, gap), 1.0, rtol=1e-9)


def test_gaps_are_the_time_of_the_way_and_endless_where_the_arm_stops():
    arm, path, speed = load_arm("kc"), make_path(300), 0.2
    q = np.tile(arm.zero_pose, (len(path), 1))
    gap = find_gaps(arm, path, q, speed)
    new_pass = np.concatenate([[True], np.diff(path.pass_index) != 0])
    assert (np.isinf(gap) == new_pass).all()
    wall = path.position + path.direction
    way = [np.linalg.norm(np.diff(p, axis=0), axis=1) for p in (path.position, wall)]
    np.testing.assert_allclose(gap[~new_pass], (np.maximum(*way) / speed)[~new_pass[1:]])
    q[5:, 6] += 2 * np.pi  # rolls round
    q[8] = np.nan
    stopped = np.flatnonzero(np.isinf(find_gaps(arm, path, q, speed)) & ~new_pass)
    assert stopped.tolist() == [5, 8, 9]


def test_a_random_heading_is_judged(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bench_headings, "HEADINGS", 1)
    monkeypatch.setattr(bench_headings, "PAN_STEP_DEG", 1.0)
    figures = {figure.what: figure for figure in measure_headings("kc", 3, lambda _: None)}
    assert figures["reachable points missed"].is_met
    assert figures["joint speed, share of its limit"].is_met
    assert figures["clearance while spraying"].is_met
    assert figures["points tilted"].is_met is None
    assert measure_headings("muck", 3, lambda _: None)[0].value is None


def test_speed_is_measured_and_a_missing_peer_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bench_inverse, "POSES", 500)
    monkeypatch.setattr(bench_inverse, "NUMERIC_POSES", 3)
    figures = {figure.what: figure for figure in measure_inverse("kc", 1, lambda _: None)}
    assert figures["inverse, all solutions"].value > 0.0
    for peer in ("inverse of a 6R arm, EAIK", "numeric inverse, pinocchio"):
        assert (figures[peer].value is None) == ("not installed" in figures[peer].note)


def test_the_proof_is_printed_as_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    for name, size in (("POSES", 500), ("SINGULAR_DRAWS", 200), ("SEARCHED", 10), ("STARTS", 60)):
        monkeypatch.setattr(bench_proof, name, size)
    assert main(["bench", "proof", "--machine", "muck", "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert tree["ok"] and all(figure["is_met"] for figure in tree["figures"])


def test_machines_are_exported_where_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["machines", "--urdf", str(tmp_path / "new" / "robots"), "--json"]) == 0
    listed = {m["name"]: m for m in json.loads(capsys.readouterr().out)["machines"]}
    for name in ("kc", "muck", "duct"):
        assert Path(listed[name]["urdf"]).is_file() and Path(listed[name]["srdf"]).is_file()
    (tmp_path / "file").write_text("")
    assert main(["machines", "--urdf", str(tmp_path / "file")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
