from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from planning_heading import heading

from ascrcp.core.errors import InputError
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.planning.parameter import load_parameters
from ascrcp.planning.path import plan
from ascrcp.planning.table import VERSION, read_joints, read_path, write_joints, write_path

PRISMATIC = np.array([False, False, True, False, False, True, False, False])


@pytest.fixture(scope="module")
def path() -> SprayPath:
    return plan(heading(pockets=((10.6, 63.0, 0.4, 0.4),)), load_parameters().path)


@pytest.fixture(scope="module")
def joints() -> JointSequence:
    rng = np.random.default_rng(1)
    m = 60
    direction = rng.normal(size=(m, 3))
    spraying = rng.random(m) < 0.5
    return JointSequence(
        t=np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.1, m - 1))]),
        q=rng.normal(size=(m, 8)),
        position=rng.normal(size=(m, 3)) * 10,
        direction=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        point=rng.integers(-1, 50, m),
        spraying=spraying,
        flow=np.where(spraying, rng.random(m), 0.0),
    )


def test_path_survives_the_file(path: SprayPath, tmp_path: Path) -> None:
    write_path(tmp_path / "path.csv", path)
    back = read_path(tmp_path / "path.csv")
    for name in SprayPath.SHAPES:
        np.testing.assert_allclose(getattr(back, name), getattr(path, name), rtol=0, atol=1e-12)
    write_path(tmp_path / "again.csv", back)
    np.testing.assert_allclose(read_path(tmp_path / "again.csv").position, back.position, atol=1e-12)


def test_path_file_is_the_table_of_the_thesis(path: SprayPath, tmp_path: Path) -> None:
    write_path(tmp_path / "path.csv", path)
    header, _, names, first, *_ = (tmp_path / "path.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith(f"# ascrcp spray path version=2 rows={len(path)} crc32=")
    assert names.startswith("序号,X/mm,Y/mm,Z/mm,theta3/deg,theta2/deg,")
    number, x, _, _, _, theta2 = first.split(",")[:6]
    assert number == "1" and float(x) == pytest.approx(path.position[0, 0] * 1e3)
    assert min(abs(float(theta2) - tilt) for tilt in (75, 90, 105)) < 1e-9


def test_joints_survive_the_file(joints: JointSequence, tmp_path: Path) -> None:
    write_joints(tmp_path / "joints.csv", joints, PRISMATIC)
    back = read_joints(tmp_path / "joints.csv")
    for name in JointSequence.SHAPES:
        np.testing.assert_allclose(getattr(back, name), getattr(joints, name), rtol=0, atol=1e-12)
    assert back.t.tobytes() == joints.t.tobytes()
    names = (tmp_path / "joints.csv").read_text(encoding="utf-8").splitlines()[2]
    assert names.startswith("t_s,q1_deg,q2_deg,q3_mm,q4_deg,q5_deg,q6_mm,q7_deg,q8_deg,point,spraying,flow,")


@pytest.mark.parametrize("kind", ["path", "joints"])
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_f40_any_flipped_bit_is_refused_by_line(
    kind: str, data: st.DataObject, path: SprayPath, joints: JointSequence, tmp_path: Path
) -> None:
    file = tmp_path / "table.csv"
    if not file.exists():
        if kind == "path":
            write_path(file, path)
        else:
            write_joints(file, joints, PRISMATIC)
    whole = file.read_bytes()
    place = data.draw(st.integers(0, len(whole) * 8 - 1))
    broken = bytearray(whole)
    broken[place // 8] ^= 1 << (place % 8)
    damaged = tmp_path / "damaged.csv"
    damaged.write_bytes(broken)
    with pytest.raises(InputError, match=r"line \d+") as caught:
        (read_path if kind == "path" else read_joints)(damaged)
    line = whole[: place // 8].count(b"\n") + 1
    if line > 1:
        assert f"line {line}:" in str(caught.value)


def test_f40_any_cut_is_refused(joints: JointSequence, tmp_path: Path) -> None:
    file = tmp_path / "joints.csv"
    write_joints(file, joints, PRISMATIC)
    whole = file.read_bytes()
    for end in range(0, len(whole), 97):
        file.write_bytes(whole[:end])
        with pytest.raises(InputError, match=r"line \d+"):
            read_joints(file)
    lines = whole.splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:20] + lines[21:]))
    with pytest.raises(InputError, match="line 21:"):
        read_joints(file)
    file.write_bytes(b"".join(lines[:-5]))
    with pytest.raises(InputError, match="60 rows expected, 55 whole"):
        read_joints(file)


def test_f40_other_files_are_refused(path: SprayPath, tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    with pytest.raises(InputError, match="cannot be read"):
        read_path(file)
    for content in (b"", b"hello\n", b"\xff\xfe\x00", b"\x00" * 1000):
        file.write_bytes(content)
        with pytest.raises(InputError, match=r"line 1"):
            read_path(file)
    write_path(file, path)
    with pytest.raises(InputError, match="not a file of this kind"):
        read_joints(file)
    file.write_text(file.read_text().replace(f"version={VERSION}", f"version={VERSION - 1}", 1))
    with pytest.raises(InputError, match="of another version: make it again"):
        read_path(file)


def test_a_failed_write_leaves_the_old_file(path: SprayPath, tmp_path: Path) -> None:
    folder = tmp_path / "table.csv"
    folder.mkdir()
    (folder / "keep").write_text("x")
    with pytest.raises(InputError, match="cannot be written"):
        write_path(folder, path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["table.csv"]
