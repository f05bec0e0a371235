"""align, thickness and section on round folders: one JSON object, or one line of refusal."""

import json
from pathlib import Path

import numpy as np
import pytest

from ascrcp.__main__ import main
from ascrcp.core.flow import Axis, Bay, Label, Scan, Surface
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import load_profile
from ascrcp.session.round import Round
from ascrcp.session.store import write_scan, write_surface

LAYER = 0.08


def surface(layer: float, seed: int) -> Surface:
    """A wavy tube with a face, sprayed up to 10 m, as two scans of it would be recognised."""
    profile = load_profile(CONFIG / "profiles" / "circle-5.9.yaml")
    rng = np.random.default_rng(seed)
    s, a = rng.uniform(8.0, 13.0, 150_000), rng.uniform(0.0, profile.length, 150_000)
    wall = np.where(s < 10.0, -0.22, 0.05) + 0.04 * np.sin(2.1 * s) * np.cos(1.3 * a)
    wall = wall - np.where(s > 10.0, layer, 0.0) + rng.normal(0.0, 0.004, len(s))
    tube = np.column_stack([s, profile.point(a, wall)])
    y, z = rng.uniform(-4.0, 4.0, (2, 30_000))
    face = np.column_stack([13.0 + 0.1 * np.sin(y) * np.cos(1.5 * z), y, z])
    columns = int(np.ceil(profile.length / 0.05))
    station = 8.0 + 0.05 * (np.arange(100) + 0.5)
    grid = np.where(station < 10.0, -0.22, 0.05 - layer)[:, None] * np.ones(columns)
    return Surface(
        axis=Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])),
        profile=profile,
        unsprayed=(10.0, 13.0),
        arches=(),
        overbreak=(),
        bays=(Bay((10.0, 13.0), None, None),),
        station=station,
        along=profile.length / columns * (np.arange(columns) + 0.5),
        offset=grid.astype(np.float32),
        filled=np.zeros(grid.shape, dtype=bool),
        points=np.concatenate([tube, face]).astype(np.float32),
        labels=np.concatenate(
            [np.where(s < 10.0, Label.SPRAYED, Label.BAY), np.full(len(face), Label.FACE)]
        ).astype(np.uint8),
    )


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict]:
    code = main([str(word) for word in words] + ["--json"])
    return code, json.loads(capsys.readouterr().out)


def test_thickness_and_section_of_two_rounds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, layer, seed in (("one", 0.0, 1), ("two", LAYER, 2)):
        (tmp_path / name).mkdir()
        write_surface(Round(tmp_path / name).surface, surface(layer, seed))
    out = tmp_path / "layer"
    code, tree = call(
        capsys, "thickness", "--round", tmp_path / "one", "--after", tmp_path / "two", "--out", out
    )
    assert code == 0 and tree["ok"]
    assert tree["mean_m"] == pytest.approx(LAYER, abs=0.003) and abs(tree["bias_m"]) < 0.003
    assert np.nanmax(np.abs(np.array(tree["mean_per_m2_m"], dtype=float) - LAYER)) < 0.005
    assert (out / "thickness.npz").is_file() and (out / "thickness.json").is_file()
    code, tree = call(capsys, "section", "--round", tmp_path / "one", "--station", 12.0)
    assert code == 0 and tree["area_beyond_m2"] == pytest.approx(24.3 * 0.05, rel=0.02)
    code, tree = call(capsys, "section", "--round", tmp_path / "one", "--station", 40.0)
    assert code == 2 and "station 40" in tree["error"]


def test_align_needs_a_scan_with_a_lance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, tree = call(capsys, "align", "--round", tmp_path)
    assert code == 2 and "run `ascrcp scan`" in tree["error"]
    empty = np.full((10, 20), 5.0, dtype=np.float32)
    write_scan(Round(tmp_path).scan, Scan(empty, np.linspace(0, 1, 20), np.linspace(0, 1, 10), np.zeros(8)))
    code, tree = call(capsys, "align", "--round", tmp_path)
    assert code == 2 and "does not see its lance" in tree["error"]
