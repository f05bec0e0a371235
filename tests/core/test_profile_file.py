"""Profiles from YAML, drawings and points: the shape comes back, nonsense is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ascrcp.core.errors import ConfigError
from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Arc, Profile, load_profile

NAMED = sorted((CONFIG / "profiles").glob("*.yaml"))


def _write(path: Path, points: np.ndarray, scale: float = 1.0) -> Path:
    """Points (y left, z up) as a drawing has them: x to the right."""
    np.savetxt(path, points * [-scale, scale], fmt="%.5f")
    return path


def _walk(profile: Profile, count: int = 500) -> np.ndarray:
    return profile.point(np.linspace(0.0, profile.length, count))


def _same(found: Profile, wanted: Profile, within: float) -> None:
    along = np.linspace(0.3, wanted.length - 0.3, 300)
    at, offset = found.locate(wanted.point(along))
    assert np.abs(offset).max() < within
    assert (np.diff(at) > 0).all()


@pytest.mark.parametrize("file", NAMED, ids=lambda p: p.stem)
def test_every_shipped_profile_comes_back_from_its_points(file: Path, tmp_path: Path) -> None:
    wanted = load_profile(file)
    found = load_profile(_write(tmp_path / "line.txt", _walk(wanted)))
    _same(found, wanted, 0.004)
    assert len(found.arcs) <= 3 * len(wanted.arcs) + 2


@given(st.integers(0, 2**32 - 1), st.booleans(), st.floats(-30, 30), st.floats(-30, 30))
@settings(max_examples=12)
def test_order_direction_and_place_of_the_points_do_not_matter(
    tmp_path_factory: pytest.TempPathFactory, seed: int, shuffled: bool, dy: float, dz: float
) -> None:
    rng = np.random.default_rng(seed)
    wanted = load_profile(CONFIG / "profiles" / "three-centre.yaml")
    points = _walk(wanted, 700)[:: rng.choice([-1, 1])]
    if shuffled:
        points = rng.permutation(points)
    file = _write(tmp_path_factory.mktemp("p") / "line.csv", points + np.array([dy, dz]))
    found = load_profile(file)
    shape = _walk(found) - _walk(found).mean(axis=0)
    back = _walk(wanted) - _walk(wanted).mean(axis=0)
    assert np.abs(shape - back).max() < 0.06
    assert found.length == pytest.approx(wanted.length, abs=0.1)


def test_straight_walls_and_corners_are_kept(tmp_path: Path) -> None:
    a = np.linspace(0.0, np.pi, 60)
    horseshoe = np.concatenate(
        [[[-4.0, -3.0]], np.column_stack([-4.0 * np.cos(a), 4.0 * np.sin(a)]), [[4.0, -3.0]]]
    )
    found = load_profile(_write(tmp_path / "horseshoe.txt", horseshoe))
    assert np.abs(found.locate(horseshoe)[1]).max() < 0.004
    box = np.array([[-4.0, -3.0], [-4.0, 3.0], [4.0, 3.0], [4.0, -3.0]])
    found = load_profile(_write(tmp_path / "box.txt", box))
    assert np.abs(found.locate(np.array([[-4.0, 1.0], [0.5, 3.0], [4.0, -1.0]]))[1]).max() < 0.004


def test_points_in_yaml_with_origin_and_offsets(tmp_path: Path) -> None:
    wanted = load_profile(CONFIG / "profiles" / "circle-5.9.yaml")
    _write(tmp_path / "line.txt", _walk(wanted) + np.array([-12.0, 4.0]), scale=1000.0)
    file = tmp_path / "p.yaml"
    file.write_text("name: survey\npoints_file: line.txt\nunit: mm\norigin: [12000, 4000]\narch_line: -0.3\n")
    found = load_profile(file)
    _same(found, wanted, 0.004)
    assert (found.name, found.arch_line, found.overbreak_line) == ("survey", -0.3, 0.15)


def test_a_real_design_curve(shared_data: Path) -> None:
    """Closed, unordered, 15 mm pixels, comments in a legacy encoding, an origin of its own."""
    found = load_profile(shared_data / "design_first_lining.txt")
    assert 24.0 < found.length < 30.0 and 3 <= len(found.arcs) <= 9
    crown = _walk(found)[:, 1].max()
    assert 6.5 < crown < 7.0  # 10.74 m less the height of the widest chord
    rows = [r.split() for r in (shared_data / "design_first_lining.txt").read_bytes().splitlines()]
    points = np.array([[-float(r[0]), float(r[1])] for r in rows if len(r) == 2 and r[0] != b"#"])
    points -= [(points[:, 0].min() + points[:, 0].max()) / 2, points[:, 1].max() - crown]
    along, offset = found.locate(points)
    mine = (along > 0.0) & (along < found.length) & (points[:, 1] > -1.2)
    assert np.abs(offset[mine]).max() < 0.03 and np.sqrt(np.mean(offset[mine] ** 2)) < 0.012


CIRCLE = np.array([[-5.9 * np.cos(a), 5.9 * np.sin(a)] for a in np.radians(np.linspace(-28, 208, 300))])


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (CIRCLE * 1000, "millimetres"),
        (np.concatenate([CIRCLE[:100], CIRCLE[140:]]), "gap"),
        (np.random.default_rng(1).permutation(np.concatenate([CIRCLE[:100], CIRCLE[140:]])), "gap"),
        (np.random.default_rng(1).uniform(-5, 5, (400, 2)), "line|points"),
        (CIRCLE * [1.0, 0.05], "high"),
        (CIRCLE[:2], "points"),
        (CIRCLE * [1.0, -1.0], "upside down"),
        (np.array([[-4.0, -3.0], [4.0, 3.0], [-4.0, 3.0], [4.0, -3.0]]), "crosses"),
    ],
    ids=["millimetres", "gap", "gap-unordered", "scatter", "flat", "two", "upside-down", "crossing"],
)
def test_nonsense_is_refused_in_one_line(tmp_path: Path, points: np.ndarray, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as error:
        load_profile(_write(tmp_path / "bad.txt", points))
    assert "\n" not in str(error.value) and "bad.txt" in str(error.value)


def test_bad_files_are_refused_in_one_line(tmp_path: Path) -> None:
    for name, text, words in [
        ("a.txt", "1 2\n3 x\n", "line 2"),
        ("b.txt", "# nothing\n", "no points"),
        ("c.yaml", "name: c\narcs: []\npoints: []\n", "exactly one"),
        ("d.yaml", "name: d\npoints_file: missing.txt\n", "missing.txt"),
        ("e.obj", "v 1 2 3\n", "unknown profile format"),
        ("f.yaml", "name: f\npoints_file: line.obj\n", "allowed"),
        ("g.txt", "nan nan\n" * 9, "line|no points"),
    ]:
        (tmp_path / name).write_text(text)
        with pytest.raises(ConfigError, match=words) as error:
            load_profile(tmp_path / name)
        assert "\n" not in str(error.value) and name in str(error.value)
    with pytest.raises(ConfigError, match="No such file"):
        load_profile(tmp_path / "none.txt")


def test_arcs_that_cross_each_other_are_refused() -> None:
    loop = [
        Arc(centre=(0, 0), radius=5.0, start_deg=0, end_deg=180),
        Arc(centre=(2.0, 0), radius=3.0, start_deg=180, end_deg=360),
        Arc(centre=(4.0, 0), radius=5.0, start_deg=0, end_deg=90),
    ]
    with pytest.raises(ConfigError, match="crosses itself"):
        Profile(name="loop", arcs=loop)
    with pytest.raises(ConfigError, match="millimetres"):
        Profile(name="mm", arcs=[Arc(centre=(0, 0), radius=5900.0, start_deg=0, end_deg=180)])


def test_a_drawing(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    wanted = load_profile(CONFIG / "profiles" / "three-centre.yaml")
    document = ezdxf.new(units=4)  # millimetres
    space = document.modelspace()
    for arc in wanted.arcs[::-1]:  # drawn as arcs in any order; x runs to the right, y = -x
        space.add_arc(
            center=(-1000 * arc.centre[0], 1000 * arc.centre[1]),
            radius=1000 * arc.radius,
            start_angle=arc.start_deg,
            end_angle=arc.end_deg,
        )
    document.saveas(tmp_path / "drawing.dxf")
    _same(load_profile(tmp_path / "drawing.dxf"), wanted, 0.004)
    space.delete_entity(space[1])
    document.saveas(tmp_path / "gap.dxf")
    with pytest.raises(ConfigError, match="gap"):
        load_profile(tmp_path / "gap.dxf")
    raw = (tmp_path / "drawing.dxf").read_bytes()
    for text in (raw[: len(raw) // 3], b"nonsense", raw.replace(b"ARC", b"TEXT")):
        (tmp_path / "bad.dxf").write_bytes(text)
        with pytest.raises(ConfigError) as error:
            load_profile(tmp_path / "bad.dxf")
        assert "\n" not in str(error.value)
