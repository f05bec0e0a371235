"""Bad input on the command line: exit 2, one line, no traceback, nothing written."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ascrcp.__main__ import main
from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder
from ascrcp.core.flow import JointSequence
from ascrcp.planning.table import write_joints
from ascrcp.session.round import Round


def write_ply(path: Path, points: np.ndarray, cut: float = 1.0, promised: int | None = None) -> Path:
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(points) if promised is None else promised}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    ).encode()
    data = head + points.astype("<f4").tobytes()
    path.write_bytes(data[: int(len(data) * cut)])
    return path


def bad_clouds(folder: Path) -> dict[str, Path]:
    rng = np.random.default_rng(0)
    cube = rng.uniform(-5, 5, (200_000, 3))
    text = folder / "text.ply"
    text.write_text("dear sir or madam\n" * 100)
    notes = folder / "notes.txt"
    notes.write_text("dear sir or madam\n" * 100)
    empty = folder / "empty.ply"
    empty.write_bytes(b"")
    return {
        "text": text,
        "text_as_points": notes,
        "empty": empty,
        "cut": write_ply(folder / "cut.ply", cube, cut=0.5),
        "lying": write_ply(folder / "lying.ply", cube[:10], promised=2_000_000_000),
        "nan": write_ply(folder / "nan.ply", np.full((1000, 3), np.nan)),
        "no_tunnel": write_ply(folder / "cube.ply", cube),
        "flat": write_ply(folder / "flat.ply", cube * [1, 1, 0.001]),
        "absent": folder / "absent.ply",
        "folder": folder,
    }


@pytest.mark.parametrize(
    "kind",
    ["text", "text_as_points", "empty", "cut", "lying", "nan", "no_tunnel", "flat", "absent", "folder"],
)
def test_recognise_refuses_bad_clouds(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "in").mkdir()
    cloud, out = bad_clouds(tmp_path / "in")[kind], tmp_path / "out"
    assert main(["recognise", str(cloud), "--out", str(out)]) == 2
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if line.startswith("ascrcp: ")]
    assert len(lines) == 1 and "Traceback" not in said.err
    assert said.out == ""
    assert not out.exists(), "nothing written"


def test_refusal_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recognise", str(tmp_path / "no.ply"), "--out", str(tmp_path / "out"), "--json"]) == 2
    tree = json.loads(capsys.readouterr().out)
    assert tree["ok"] is False and "no.ply" in tree["error"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["plan", "--round", "{tmp}"], "recognise"),
        (["solve", "--round", "{tmp}"], "plan"),
        (["run", "--round", "{tmp}"], "solve"),
        (["replay", "--round", "{tmp}"], "run"),
        (["report", "--round", "{tmp}/none"], "no such round folder"),
        (["recognise"], "--out DIR"),
        (["recognise", "--out", "{tmp}/out"], "CLOUD"),
        (["--offscreen", "--cloud", "{tmp}/none.ply", "--round", "{tmp}/new"], "none.ply"),
        (["--offscreen", "--rig", "{tmp}/rig.yaml", "--round", "{tmp}/new"], "tunel"),
        (["--offscreen", "--profile", "{tmp}/none.yaml", "--round", "{tmp}/new"], "none.yaml"),
        (["--offscreen", "--machine", "none", "--round", "{tmp}/new"], "none"),
        (["fk", "{oops"], "not JSON"),
        (["fk", '{"q": [1, 2]}'], "8"),
        (["fk", '{"q": [1, 2, 3, 4, 5, 6, 7, "x"]}'], "numbers"),
        (["ik", '{"T": [[1, 0], [0, 1]]}'], "4"),
        (["ik", '{"T": [[2,0,0,1],[0,1,0,1],[0,0,1,1],[0,0,0,1]]}'], "rotation"),
        (["fk", '{"pose": 1}'], "allowed keys"),
        (["fk", '{"q": [true, 0, 0, 0, 0, 0, 0, 0]}'], "numbers"),
        (["fk", '{"q": [1e300, 0, 0, 0, 0, 0, 0, 0]}'], "between"),
        (["ik", '{"T": [[1,0,0,8],[0,1,0,0],[0,0,-1,0],[0,0,0,1]], "held": {"5": 0, "6": 1}}'], "mirrors"),
        (["ik", '{"T": [[1,0,0,8],[0,1,0,0],[0,0,1,0],[0,0,0,1]], "held": {"5": true, "6": 1}}'], "joint 5"),
    ],
)
def test_one_line_says_what_is_allowed(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.yaml").write_text("tunel: {}\n")
    assert main([a.replace("{tmp}", str(tmp_path)) if "{tmp}" in a else a for a in arguments]) == 2
    error = capsys.readouterr().err
    assert says in error and "Traceback" not in error
    assert len([line for line in error.splitlines() if line.startswith("ascrcp: ")]) == 1
    assert not (tmp_path / "new").exists(), "no folder for a job that may not begin"


def test_unknown_options_end_with_two() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ascrcp", "machines", "--sed", "4"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "--sed" in done.stderr


@pytest.mark.parametrize("value", ["-1", "x", "4294967296"])
def test_seed_is_checked(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--seed", value, "machines"])
    assert end.value.code == 2
    assert "--seed" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "nan,0,0", "1e9,0,0"])
def test_shift_is_checked(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["recognise", "x.ply", "--out", "y", "--shift", text])
    assert end.value.code == 2 and "--shift" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["recognise", "plan", "solve", "report", "run"])
def test_f43_no_stage_touches_a_round_that_another_works_on(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sequence = JointSequence(
        t=np.zeros(1),
        q=np.zeros((1, 8)),
        position=np.zeros((1, 3)),
        direction=np.array([[1.0, 0.0, 0.0]]),
        point=np.zeros(1, np.int64),
        spraying=np.zeros(1, bool),
        flow=np.zeros(1),
    )
    write_joints(tmp_path / "joints.csv", sequence, np.zeros(8, bool))
    before = sorted(tmp_path.iterdir())
    with Round(tmp_path).lock():
        assert main([command, "--round", str(tmp_path)]) == 2
    assert "another ascrcp works on this round" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == [tmp_path / ".lock", *before]


def test_a_place_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot make the folder"):
        make_folder(tmp_path / "file" / "out")


def test_f40_run_refuses_a_damaged_sequence_before_it_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "joints.csv").write_text("# ascrcp joint sequence version=2 rows=1 crc32=00000000\n")
    assert main(["run", "--round", str(tmp_path)]) == 2
    assert "joints.csv" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["joints.csv"]
