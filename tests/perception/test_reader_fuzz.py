"""Corrupted clouds and profiles: flips, cuts and lying counts give a clean error or points, soon and small.

A few hundred files here; the full proof: ASCRCP_FUZZ_FILES=2000 pytest --log-cli-level=INFO THIS_FILE.
"""

import logging
import os
import re
import resource
import time
from pathlib import Path

import laspy
import numpy as np
import open3d as o3d
import pytest

from ascrcp.core.errors import InputError
from ascrcp.core.profile import load_profile
from ascrcp.perception.reader import read_cloud

FILES = int(os.environ.get("ASCRCP_FUZZ_FILES", "240"))
POINTS = np.random.default_rng(0).uniform(-10, 10, (3000, 3)).astype(np.float32)
NAMES = ("a.ply", "b.ply", "a.pcd", "b.pcd", "c.pcd", "a.las", "a.laz", "a.xyz", "a.csv", "p.txt")
LIMIT_S = 1.0
LIMIT_MB = 100.0


def _good(folder: Path) -> None:
    header = "ply\nformat {} 1.0\nelement vertex 3000\nproperty float x\nproperty float y\nproperty float z\n"
    text = "\n".join(" ".join(f"{v:.4f}" for v in p) for p in POINTS).encode()
    (folder / "a.ply").write_bytes(
        (header + "end_header\n").format("binary_little_endian").encode() + POINTS.tobytes()
    )
    (folder / "b.ply").write_bytes((header + "end_header\n").format("ascii").encode() + text)
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(POINTS))
    o3d.t.io.write_point_cloud(str(folder / "a.pcd"), cloud)
    o3d.t.io.write_point_cloud(str(folder / "b.pcd"), cloud, write_ascii=True)
    o3d.t.io.write_point_cloud(str(folder / "c.pcd"), cloud, compressed=True)
    las = laspy.create(point_format=3, file_version="1.2")
    las.header.scales = [1e-4] * 3
    las.x, las.y, las.z = POINTS.T.astype(float)
    las.write(folder / "a.las")
    las.write(folder / "a.laz")
    (folder / "a.xyz").write_bytes(text)
    (folder / "a.csv").write_bytes(b"x,y,z\n" + text.replace(b" ", b","))
    a = np.radians(np.linspace(-28, 208, 400))
    np.savetxt(folder / "p.txt", np.column_stack([5.9 * np.cos(a), 5.9 * np.sin(a)]), fmt="%.4f")


def _spoil(data: bytes, rng: np.random.Generator) -> bytes:
    how = rng.integers(5)
    if how == 0:  # cut
        return data[: rng.integers(len(data))]
    out = bytearray(data)
    if how == 1:  # flips anywhere
        for at in rng.integers(len(out), size=rng.integers(1, 40)):
            out[at] ^= 1 << rng.integers(8)
    elif how == 2:  # flips in the header
        for at in rng.integers(min(400, len(out)), size=rng.integers(1, 8)):
            out[at] ^= 1 << rng.integers(8)
    elif how == 3:  # lying counts: numbers in a text header, or 32-bit words of a binary one
        lie = str(rng.choice([0, 1, 2999, 3001, 10**6, 10**9, 2**32 - 1, 2**63])).encode()
        head = re.sub(rb"\b3000\b", lie, bytes(out[:600]))
        if head == out[:600]:
            at = int(rng.integers(0, max(1, min(240, len(out) - 4))))
            head = bytes(out[:at]) + rng.bytes(4) + bytes(out[at + 4 : 600])
        return head + bytes(out[600:])
    else:  # a block of something else
        at, size = rng.integers(len(out)), rng.integers(1, 3000)
        out[at : at + size] = rng.bytes(size)
    return bytes(out)


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.timeout(900)
def test_corrupted_files_give_a_clean_error_soon_and_memory_stays_flat(tmp_path: Path) -> None:
    _good(tmp_path)
    good = {name: (tmp_path / name).read_bytes() for name in NAMES}
    for name in NAMES:
        load_profile(tmp_path / name) if name == "p.txt" else read_cloud(tmp_path / name)
    before, slowest, refused = _peak_mb(), (0.0, 0.0, ""), 0
    for number in range(FILES):
        rng = np.random.default_rng([17, number])
        name = NAMES[number % len(NAMES)]
        file = tmp_path / f"bad-{name}"
        file.write_bytes(_spoil(good[name], rng))
        wall, busy = time.perf_counter(), time.process_time()
        try:
            if name == "p.txt":
                load_profile(file)
            else:
                assert np.isfinite(read_cloud(file).points).all()
        except InputError as error:
            refused += 1
            assert "\n" not in str(error) and str(file) in str(error), str(error)
        took = (time.process_time() - busy, time.perf_counter() - wall, f"{name} {number}")
        slowest = max(slowest, took)
    logging.getLogger(__name__).info(
        "%d of %d refused, slowest %.2f s (%s), peak memory %+.0f MB",
        *(refused, FILES, slowest[0], slowest[2], _peak_mb() - before),
    )
    assert slowest[0] < LIMIT_S, slowest
    assert _peak_mb() - before < LIMIT_MB
    assert refused > FILES / 4
