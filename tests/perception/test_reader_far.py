"""Clouds in surveyors' coordinates: millimetres kept with a shift, refused in one line without."""

from pathlib import Path

import laspy
import numpy as np
import pytest

from ascrcp.core.errors import InputError
from ascrcp.perception.reader import read_cloud

ORIGIN = (512_340.0, 3_374_560.0, 118.0)
NEAR = np.random.default_rng(3).uniform(-12, 12, (400, 3))
FAR = NEAR + ORIGIN


def _ply(path: Path) -> None:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(FAR)}\n"
    header += "".join(f"property double {c}\n" for c in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + FAR.astype("<f8").tobytes())


def _pcd(path: Path, data: str) -> None:
    header = "FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\n"
    header += f"WIDTH {len(FAR)}\nHEIGHT 1\nPOINTS {len(FAR)}\nDATA {data}\n"
    body = (
        FAR.tobytes()
        if data == "binary"
        else "\n".join(" ".join(map(repr, p)) for p in FAR.tolist()).encode()
    )
    path.write_bytes(header.encode() + body + b"\n")


def _las(path: Path) -> None:
    las = laspy.create(point_format=3, file_version="1.2")
    las.header.scales, las.header.offsets = [1e-4] * 3, list(ORIGIN)
    las.x, las.y, las.z = FAR.T
    las.write(path)


@pytest.fixture(params=["a.ply", "a.pcd", "b.pcd", "a.las", "a.laz", "a.xyz", "a.csv"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / request.param
    if path.suffix == ".ply":
        _ply(path)
    elif path.suffix == ".pcd":
        _pcd(path, "binary" if path.stem == "a" else "ascii")
    elif path.suffix in (".las", ".laz"):
        _las(path)
    else:
        np.savetxt(path, FAR, fmt="%.5f", delimiter="," if path.suffix == ".csv" else " ")
    return path


def test_millimetres_survive_the_shift(file: Path) -> None:
    cloud = read_cloud(file, shift=ORIGIN)
    assert cloud.points.dtype == np.float32
    assert np.abs(cloud.points - NEAR).max() < 1e-4


def test_without_a_shift_a_far_cloud_is_refused_with_the_shift_to_use(file: Path) -> None:
    with pytest.raises(InputError, match="512340,3374560,120") as error:
        read_cloud(file)
    assert "\n" not in str(error.value)


def test_a_bad_shift_is_refused(file: Path) -> None:
    with pytest.raises(InputError, match="shift"):
        read_cloud(file, shift=(float("nan"), 0.0, 0.0))
