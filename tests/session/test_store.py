"""Round files: what is written comes back the same; what is cut or flipped is refused in one line."""

import errno
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest

from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.core.flow import Arch, Axis, Bay, Overbreak, Scan, Surface
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.session.store import read_json, read_scan, read_surface, write_scan, write_surface


def make_surface() -> Surface:
    rng = np.random.default_rng(3)
    offset = rng.normal(size=(6, 8)).astype(np.float32)
    offset[2, 3] = np.nan
    return Surface(
        axis=Axis(np.array([0.1, 0.2, -1.8]), np.array([1.0, 0.0, 0.0]), 0.02, 0.003, ("arches", "profile")),
        profile=load_profile(CONFIG / "profiles" / "circle-5.9.yaml"),
        unsprayed=(10.0, 13.0),
        arches=(Arch(11.2, 0.2, 1.5, (-20.0, 200.0)),),
        overbreak=(Overbreak((10.5, 11.0), (40.0, 60.0), 0.8, 0.2, 0.4, 0.9),),
        bays=(Bay((10.0, 11.1), None, 0), Bay((11.3, 13.0), 0, None)),
        station=np.linspace(10, 13, 6),
        along=np.linspace(0, 20, 8),
        offset=offset,
        filled=rng.random((6, 8)) > 0.5,
        points=rng.normal(size=(50, 3)).astype(np.float32),
        labels=rng.integers(0, 6, 50).astype(np.uint8),
    )


def make_scan() -> Scan:
    ranges = np.full((5, 7), 6.0, np.float32)
    ranges[1, 2] = np.nan
    return Scan(ranges, np.linspace(-0.7, 3.9, 7), np.linspace(-1, 1, 5), np.zeros(8))


def test_surface_comes_back_the_same(tmp_path: Path) -> None:
    surface = make_surface()
    write_surface(tmp_path / "s.npz", surface)
    back = read_surface(tmp_path / "s.npz")
    assert (back.unsprayed, back.arches, back.overbreak, back.bays) == (
        surface.unsprayed,
        surface.arches,
        surface.overbreak,
        surface.bays,
    )
    assert back.profile == surface.profile and back.axis.evidence == surface.axis.evidence
    assert np.array_equal(back.axis.point, surface.axis.point)
    for name in ("station", "along", "offset", "filled", "points", "labels"):
        assert np.array_equal(getattr(back, name), getattr(surface, name), equal_nan=name == "offset")


def test_scan_comes_back_the_same(tmp_path: Path) -> None:
    write_scan(tmp_path / "s.npz", make_scan())
    back = read_scan(tmp_path / "s.npz")
    assert np.array_equal(back.ranges, make_scan().ranges, equal_nan=True) and back.complete


def test_damage_is_refused_in_one_line_or_changes_nothing(tmp_path: Path) -> None:
    """G11 in small: every cut, and flips all over the file."""
    place = tmp_path / "s.npz"
    write_scan(place, make_scan())
    good = place.read_bytes()
    rng = np.random.default_rng(1)
    damaged = [good[:n] for n in range(0, len(good), 61)]
    for at in rng.integers(0, len(good), 300):
        damaged.append(good[:at] + bytes([good[at] ^ (1 << rng.integers(8))]) + good[at + 1 :])
    refused = 0
    for data in damaged:
        place.write_bytes(data)
        try:
            back = read_scan(place)
        except InputError as error:
            assert "\n" not in str(error) and str(place) in str(error)
            refused += 1
            continue
        assert np.array_equal(back.ranges, make_scan().ranges, equal_nan=True), "never silently different"
    assert refused > 200


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    place = tmp_path / "x.bin"
    write_atomic(place, lambda file: file.write(b"old"))

    def full(file: BinaryIO) -> None:
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(InputError, match="No space left"):
        write_atomic(place, full)
    assert place.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [place]


def test_json_errors_name_the_file(tmp_path: Path) -> None:
    place = tmp_path / "x.json"
    with pytest.raises(InputError, match=r"x\.json"):
        read_json(place)
    place.write_text("{oops")
    with pytest.raises(InputError, match="not JSON"):
        read_json(place)
