"""Cloud files: every format read back, and every damaged one refused in one line (fault F40)."""

import struct
from pathlib import Path

import laspy
import numpy as np
import open3d as o3d
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ascrcp.core.errors import InputError
from ascrcp.perception.reader import read_cloud

POINTS = np.random.default_rng(0).uniform(-10, 10, (500, 3)).astype(np.float32)


def _ply(path: Path, encoding: str = "binary_little_endian", extra: bool = True) -> Path:
    kinds = [("x", "f4"), ("y", "f4"), ("z", "f4")] + ([("red", "u1")] if extra else [])
    names = {"f4": "float", "u1": "uchar"}
    header = f"ply\nformat {encoding} 1.0\ncomment made for a test\nelement vertex {len(POINTS)}\n"
    header += "".join(f"property {names[k]} {n}\n" for n, k in kinds) + "end_header\n"
    if encoding == "ascii":
        body = (
            "\n".join(" ".join(f"{v:.6f}" for v in p) + (" 7" if extra else "") for p in POINTS).encode()
            + b"\n"
        )
    else:
        rows = np.zeros(len(POINTS), [(n, (">" if "big" in encoding else "<") + k) for n, k in kinds])
        rows["x"], rows["y"], rows["z"] = POINTS.T
        body = rows.tobytes()
    path.write_bytes(header.encode() + body)
    return path


def _las(path: Path) -> Path:
    las = laspy.create(point_format=3, file_version="1.2")
    las.header.scales = [1e-4] * 3
    las.x, las.y, las.z = POINTS.T.astype(float)
    las.write(path)
    return path


def _pcd(path: Path, **how: bool) -> Path:
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(POINTS))
    o3d.t.io.write_point_cloud(str(path), cloud, **how)
    return path


def _files(folder: Path) -> list[Path]:
    np.savetxt(folder / "a.xyz", POINTS, fmt="%.6f")
    np.savetxt(folder / "a.csv", POINTS, fmt="%.6f", delimiter=",", header="X,Y,Z", comments="")
    np.savetxt(folder / "b.csv", np.c_[np.arange(len(POINTS)), POINTS], fmt="%.6f", delimiter=";",
               header="id;x;y;z", comments="")  # fmt: skip
    np.savetxt(folder / "a.txt", POINTS, fmt="%.6f", header="station survey")
    return [
        folder / "a.xyz", folder / "a.csv", folder / "b.csv", folder / "a.txt",
        _ply(folder / "a.ply"), _ply(folder / "b.ply", "binary_big_endian"), _ply(folder / "c.ply", "ascii"),
        _ply(folder / "d.ply", extra=False), _las(folder / "a.las"), _las(folder / "a.laz"),
        _pcd(folder / "a.pcd", write_ascii=True), _pcd(folder / "b.pcd", write_ascii=False),
        _pcd(folder / "c.pcd", write_ascii=False, compressed=True),
    ]  # fmt: skip


def test_reads_back_every_format(tmp_path: Path) -> None:
    for path in _files(tmp_path):
        cloud = read_cloud(path)
        assert cloud.points.dtype == np.float32 and cloud.source == str(path)
        np.testing.assert_allclose(cloud.points, POINTS, atol=1e-4, err_msg=path.name)


def test_f40_every_format_cut_anywhere_is_refused(tmp_path: Path) -> None:
    for path in _files(tmp_path):
        whole = path.read_bytes()
        cut = tmp_path / f"cut{path.suffix}"
        for share in (0.05, 0.5, 0.9):
            cut.write_bytes(whole[: int(share * len(whole))])
            if path.suffix in (".xyz", ".csv", ".txt"):
                continue  # a table promises no number of rows
            with pytest.raises(InputError) as caught:
                read_cloud(cut)
            assert "\n" not in str(caught.value) and str(cut) in str(caught.value)


@settings(max_examples=150, deadline=1000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_f40_flipped_bytes_give_points_or_one_clear_line(tmp_path: Path, data: st.DataObject) -> None:
    files = sorted(p for p in tmp_path.iterdir() if not p.name.startswith("flip")) or _files(tmp_path)
    path = data.draw(st.sampled_from(files))
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, min(len(raw), 600) - 1))] = data.draw(st.integers(0, 255))
    bad = tmp_path / f"flip{path.suffix}"
    bad.write_bytes(raw)
    try:
        cloud = read_cloud(bad)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(cloud.points).all()


def test_las_header_that_lies_about_its_count(tmp_path: Path) -> None:
    for name in ("a.las", "a.laz"):
        path = _las(tmp_path / name)
        raw = bytearray(path.read_bytes())
        struct.pack_into("<I", raw, 107, 2_000_000_000)
        path.write_bytes(raw)
        with pytest.raises(InputError, match="promises 2000000000 points"):
            read_cloud(path)


def test_ply_header_that_lies_about_its_count(tmp_path: Path) -> None:
    path = _ply(tmp_path / "a.ply")
    path.write_bytes(path.read_bytes().replace(b"vertex 500", b"vertex 500000000000"))
    with pytest.raises(InputError, match="promises"):
        read_cloud(path)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("empty.ply", b"", "empty"),
        ("text.ply", b"Dear operator,\nplease scan the heading.\n", "does not begin with 'ply'"),
        ("text.xyz", b"Dear operator,\nplease scan the heading.\n", "line 1"),
        ("text.las", b"Dear operator,\nplease scan the heading.\n", "LASF"),
        ("text.pcd", b"Dear operator,\nplease scan the heading.\n", "PCD"),
        ("nan.xyz", b"nan nan nan\n" * 50, "no finite point"),
        ("two.xyz", b"1 2\n3 4\n", "three numbers"),
        ("torn.xyz", b"1 2 3\n4 five 6\n", "torn.xyz"),
        ("none.csv", b"x,y,z\n", "no points"),
        ("cloud.step", b"1 2 3\n", "unknown cloud format"),
        ("cloud", b"1 2 3\n", "unknown cloud format"),
        ("a.e57", b"ASTM-E57", "e57"),
    ],
)
def test_says_in_one_line_what_is_wrong(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=says) as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "nothing.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputError, match="not a file"):
        read_cloud(tmp_path / "folder.ply")


def test_points_that_are_not_finite_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "some.xyz"
    path.write_text("1 2 3\nnan 2 3\n4 5 inf\n7 8 9\n")
    assert read_cloud(path).points.tolist() == [[1, 2, 3], [7, 8, 9]]
