"""ascrcp duct and ascrcp muck: files in, files out, refusals; bench sister beside the papers."""

import csv
import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from ascrcp.__main__ import main
from ascrcp.cli import bench_sister, duct
from ascrcp.cli.bench import Figure
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.duct_bend import Bend, make_bend
from ascrcp.kinematics.duct_file import encode_duct
from ascrcp.kinematics.ring_parameter import load_ring_parameters
from ascrcp.planning.muck import MuckParameters, load_muck_parameters

WIDE = Bend(width=1.6, height=1.6, aside=(0.4, 0.1), bend=(3.5, 6.5), span=(3.3, 7.1), contours=21, points=36)


@pytest.fixture(scope="module")
def contours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("duct") / "wide.csv"
    path.write_bytes(encode_duct(make_bend("wide", WIDE)))
    return path


@pytest.fixture(autouse=True)
def fewer_rounds(monkeypatch: pytest.MonkeyPatch):
    """What the rounds are for is shown with the ring itself; here a few do."""
    full = load_ring_parameters()
    program = msgspec.structs.replace(full.program, rounds=8)
    quick = msgspec.structs.replace(full, starts=3, program=program)
    for module in (duct, bench_sister):
        monkeypatch.setattr(module, "load_ring_parameters", lambda: quick)


def test_duct_plans_rings_from_contours(contours: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "out"
    code = main(["duct", str(contours), "--at", "3.2", "--at", "3.3", "--out", str(out), "--json"])
    tree = json.loads(capsys.readouterr().out)
    assert code == 0 and tree["ok"] and len(tree["rings"]) == 2
    for ring in tree["rings"]:
        assert ring["closed"]["colliding"] == 0 and ring["closed"]["clearance_min_m"] >= 0.005
    with (out / "joints.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 37
    arm = load_arm("duct")
    units = [1.0 if joint.prismatic else np.pi / 180 for joint in arm.joints]
    names = [name for name in rows[0] if name.startswith("q")]
    q = np.array([[float(row[name]) for name in names] for row in rows]) * units
    place = np.array([[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in rows])
    np.testing.assert_allclose(arm.forward(q)[:, :3, 3], place, atol=1e-5)
    assert json.loads((out / "duct.json").read_text()) == tree
    assert (out / "ring-2.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "contours.csv").read_bytes() == contours.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["duct", "{tmp}/none.csv", "--at", "1", "--out", "{tmp}/out"], 2, "none.csv"),
        (["duct", "{contours}", "--out", "{tmp}/out"], 2, "--at M is needed"),
        (["duct", "{contours}", "--at", "30", "--out", "{tmp}/out"], 2, "station 30 m"),
        (["duct", "{contours}", "--at", "3", "--stand-off", "0.9", "--out", "{tmp}/out"], 2, "stand-off"),
        (["duct", "{contours}", "--at", "0.2", "--out", "{tmp}/out"], 1, "ring at 0.2 m"),
        (["duct", "{contours}", "--at", "3", "--out", "{contours}"], 2, "not a folder"),
        (["muck", "--depth", "5", "--out", "{tmp}/out"], 2, "muck_depth_m"),
        (["muck", "--length", "0", "--out", "{tmp}/out"], 2, "muck_length_m"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    arguments: list[str],
    code: int,
    says: str,
    contours: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    assert main([part.format(tmp=tmp_path, contours=contours) for part in arguments]) == code
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("ascrcp: ")]
    assert len(lines) == 1 and says in lines[0]
    assert not (tmp_path / "out").exists(), "nothing written"


def test_muck_plans_the_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["muck", "--length", "0.07", "--out", str(tmp_path / "out"), "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert tree["scoops"] == 3 == len(tree["cycles"])
    assert tree["volume_m3"] == pytest.approx(0.5821 * 0.07 / 0.5, abs=1e-4)
    assert tree["depth_max_m"] == pytest.approx(3.8505, abs=1e-6)
    with (tmp_path / "out" / "joints.csv").open() as file:
        rows = list(csv.DictReader(file))
    t = np.array([float(row["t_s"]) for row in rows])
    assert (np.diff(t) >= 0.0).all()
    assert t[-1] == pytest.approx(60 * tree["total_min"], abs=0.01)
    assert {row["leg"] for row in rows} == {"scoop", "carry", "return"}
    assert (tmp_path / "out" / "muck.png").read_bytes().startswith(b"\x89PNG")


def test_bench_holds_its_proofs(monkeypatch: pytest.MonkeyPatch):
    def short(**changes: float) -> MuckParameters:
        return load_muck_parameters(**{"muck_length_m": 0.07, **changes})

    monkeypatch.setattr(bench_sister, "DUCTS", 0)
    monkeypatch.setattr(bench_sister, "_times", lambda *_: [])
    monkeypatch.setattr(bench_sister, "load_muck_parameters", short)
    monkeypatch.setattr(bench_sister, "limit_acceleration", lambda scene, plan: plan)  # its own test has it
    figures, proofs = bench_sister.measure_sister(1, lambda _: None)
    assert all(figure.is_met for figure in proofs), [figure.what for figure in proofs if not figure.is_met]
    by_name: dict[str, Figure] = {figure.what: figure for figure in figures + proofs}
    assert by_name["duct: poses touching, gradient projection"].value == 28
