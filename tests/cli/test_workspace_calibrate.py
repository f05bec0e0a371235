"""workspace and calibrate on the command line: files, JSON, refusals."""

import csv
import hashlib
import json
from pathlib import Path

import pytest

from ascrcp.__main__ import main
from ascrcp.core.paths import CONFIG

PROFILE = CONFIG / "profiles" / "circle-5.9.yaml"


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict, str]:
    code = main([*map(str, arguments), "--json"])
    said = capsys.readouterr()
    return code, json.loads(said.out), said.err


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("calibrate")
    data, out = folder / "survey.csv", folder / "kc-1.yaml"
    rig = folder / "rig.yaml"  # a machine that bends twice as much as its file says
    rig.write_text("arm: {flexure: {sag_mm: 150.0}}\n")
    arguments = ["calibrate", "--simulate", "40", "--fit", "sag", "--data", str(data), "--out", str(out)]
    assert main([*arguments, "--rig", str(rig)]) == 0
    return folder


def test_calibrate_writes_a_machine_that_works(calibrated: Path, capsys):
    before = hashlib.sha256((CONFIG / "machines" / "kc.yaml").read_bytes()).hexdigest()
    code, said, _ = run(
        capsys,
        *("calibrate", "--data", calibrated / "survey.csv", "--out", calibrated / "again.yaml"),
        *("--fit", "sag"),
    )
    assert code == 0 and said["rows"] == 40
    miss = {stage: said["miss_mm"][stage]["z"]["mean"] for stage in ("before", "after", "held_out")}
    assert miss["after"] <= miss["held_out"] < 0.5 * miss["before"]
    assert {c["name"] for c in said["changes"]} == {"sag: own_mm", "sag: load_mm_per_kg", "sag: exponent"}
    assert (calibrated / "again.yaml").read_bytes() == (calibrated / "kc-1.yaml").read_bytes()
    code, pose, _ = run(capsys, "fk", "--machine", calibrated / "kc-1.yaml", '{"q": [0,0,0,0,0,0,0,0]}')
    assert code == 0 and pose["machine"] == "kc"
    assert hashlib.sha256((CONFIG / "machines" / "kc.yaml").read_bytes()).hexdigest() == before


@pytest.mark.parametrize(
    ("out", "more", "message"),
    [
        ("kc.yml.bak", [], "ends in .yaml"),
        ("absent/kc.yaml", [], "no such folder"),
        ("new.yaml", ["--simulate", "5"], "exists already"),
        ("new.yaml", ["--hold", "elbow"], "no parameter 'elbow'"),
        (str(CONFIG / "machines" / "kc.yaml"), [], "calibrated from"),
        ("new.yaml", ["--machine", "duct"], "column q1_mm is missing"),
    ],
)
def test_calibrate_refuses(calibrated: Path, capsys, out: str, more: list[str], message: str):
    there = set(calibrated.iterdir())
    arguments = ["calibrate", "--data", calibrated / "survey.csv", "--out", calibrated / out, *more]
    code, said, err = run(capsys, *arguments)
    assert code == 2 and not said["ok"] and message in said["error"] and "Traceback" not in err
    assert set(calibrated.iterdir()) == there


def test_workspace_of_a_profile(tmp_path: Path, capsys):
    out = tmp_path / "map"
    code, said, _ = run(capsys, "workspace", "--profile", PROFILE, "--out", out)
    assert code == 0
    assert said["extremes_m"]["radius_max"] == pytest.approx(15.016, abs=1e-3)
    assert 0.9 < said["reach"]["covered"] <= 1.0
    parking = said["parking"]
    assert parking["best_covered"] == max(parking["covered"]) >= said["reach"]["covered"] - 0.05
    assert parking["covered"][0] < 0.5, "far behind, most is out of reach"
    with (out / "reach.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= said["reach"]["cells"]
    asked = [row for row in rows if row["asked"] == "1"]
    assert sum(row["reachable"] == "1" for row in asked) == said["reach"]["reachable"]
    assert all((row["reason"] == "") == (row["reachable"] == "1") for row in rows)
    for name in ("workspace.png", "reach.png", "parking.png"):
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert json.loads((out / "workspace.json").read_text())["reach"] == said["reach"]


def test_workspace_of_an_arm_alone(tmp_path: Path, capsys):
    code, said, _ = run(capsys, "workspace", "--machine", "muck", "--out", tmp_path / "muck")
    assert code == 0 and said["extremes_m"]["z_max"] == 3.8505
    assert sorted(p.name for p in (tmp_path / "muck").iterdir()) == [
        "cloud.csv",
        "workspace.json",
        "workspace.png",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--machine", "muck", "--profile", PROFILE], "sprays no tunnel wall"),
        (["--round", "absent"], "not there"),
        (["--round", "absent", "--profile", PROFILE], "not both"),
        (["--profile", "absent.yaml"], "absent.yaml"),
        (["--machine", "crane"], "no machine named"),
    ],
)
def test_workspace_refuses(tmp_path: Path, capsys, arguments: list[object], message: str):
    code, said, err = run(capsys, "workspace", *arguments, "--out", tmp_path / "out")
    assert code == 2 and message in said["error"] and "Traceback" not in err
    assert not (tmp_path / "out").exists()
