"""Ducts: clearance against exact geometry, contour files, the spheres round the arm."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ascrcp.core.errors import InputError
from ascrcp.kinematics import load_arm
from ascrcp.kinematics.duct import Duct
from ascrcp.kinematics.duct_bend import Bend, make_bend
from ascrcp.kinematics.duct_body import SphereBody
from ascrcp.kinematics.duct_file import encode_duct, read_duct
from ascrcp.kinematics.ring_parameter import load_ring_parameters

POINTS = 72


def make_pipe(radius: float = 0.5, contours: int = 9, points: int = POINTS) -> np.ndarray:
    angle = 2 * np.pi * np.arange(points) / points
    circle = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(points)])
    return circle[None] + np.linspace(0.0, 2.0, contours)[:, None, None] * np.array([0.0, 0.0, 1.0])


def turned(points: np.ndarray, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    R *= np.linalg.det(R)
    shift = rng.uniform(-2, 2, 3)
    return points @ R.T + shift, R, shift


def test_clearance_of_a_straight_pipe_is_known_anywhere_and_any_way_up():
    rng = np.random.default_rng(1)
    contour, R, shift = turned(make_pipe())
    pipe = Duct.from_contours("pipe", contour)
    rho, angle = rng.uniform(0.0, 0.9, 400), rng.uniform(0, 2 * np.pi, 400)
    p = np.column_stack([rho * np.cos(angle), rho * np.sin(angle), rng.uniform(0.01, 1.99, 400)])
    radius = rng.uniform(0.0, 0.2, 400)
    gap = pipe.measure(p @ R.T + shift, radius)
    sagitta = 0.5 * (1 - np.cos(np.pi / POINTS))
    assert np.abs(gap.clearance - (0.5 - rho - radius)).max() <= 1.01 * sagitta
    assert (gap.clearance[rho > 0.5] < 0.0).all()
    away = rho > 0.05
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(400)]) @ R.T
    assert ((gap.inward * -outward).sum(axis=1)[away] > np.cos(np.pi / POINTS) - 1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(gap.escape, axis=1), rho, atol=1e-9)


def test_clearance_grows_along_the_inward_direction():
    duct = make_bend("bend", load_ring_parameters().bend)
    rng = np.random.default_rng(2)
    _, centre, _ = duct.section(2.0)
    p = centre + rng.uniform(-0.25, 0.25, (200, 3))
    step = 1e-5
    here = duct.measure(p, np.zeros(200))
    there = duct.measure(p + step * here.inward, np.zeros(200))
    gain = (there.clearance - here.clearance) / step
    assert np.median(gain) == pytest.approx(1.0, abs=0.05)
    assert (gain > 0.5).mean() > 0.97  # beside the medial line the nearest edge changes


def test_the_local_plane_is_millimetres_from_the_true_distance_in_a_bend():
    """Errata 3.2: the paper's projection onto xoy is off by up to 89 mm here."""
    bend = load_ring_parameters().bend
    duct = make_bend("bend", bend)
    fine = Bend(
        width=bend.width, height=bend.height, aside=bend.aside, bend=bend.bend, span=bend.span,
        contours=600, points=720,
    )  # fmt: skip
    wall = cKDTree(make_bend("fine", fine).contour.reshape(-1, 3))
    rng = np.random.default_rng(3)
    t = rng.uniform(0.6, 3.4, 500)
    centre = np.array([duct.section(s)[1] for s in t])
    p = centre + rng.uniform(-0.45, 0.45, (500, 3)) * [1.0, 0.8, 0.0]
    measured = duct.measure(p, np.zeros(500)).clearance
    p, measured = p[measured > 0.0], measured[measured > 0.0]
    true = wall.query(p)[0]
    near = true < 0.15
    assert near.sum() > 50
    assert np.abs(measured - true)[near].max() < 0.003
    assert (measured - true)[near].max() < 0.001  # and hardly on the wrong side


def test_spheres_before_the_mouth_are_free_and_at_its_rim_are_not():
    pipe = Duct.from_contours("pipe", make_pipe())
    p = np.array([[0.9, 0.0, -0.2], [0.9, 0.0, -0.05], [0.3, 0.0, 5.0]])
    clearance = pipe.measure(p, np.full(3, 0.1)).clearance
    assert clearance[0] == np.inf
    assert clearance[1] < 0.0
    assert clearance[2] == pytest.approx(0.1, abs=2e-3)  # beyond the last contour it goes on


def test_contours_counted_the_other_way_round_are_the_same_duct():
    contour = make_pipe()
    one, other = Duct.from_contours("a", contour), Duct.from_contours("b", contour[:, ::-1])
    np.testing.assert_allclose(one.normal, other.normal, atol=1e-12)
    p = np.array([[0.1, 0.2, 0.7], [0.6, 0.0, 1.0]])
    np.testing.assert_allclose(
        one.measure(p, np.zeros(2)).clearance, other.measure(p, np.zeros(2)).clearance, atol=1e-12
    )


@pytest.mark.parametrize("suffix", ["csv", "yaml"])
def test_files_are_read_back(tmp_path: Path, suffix: str):
    duct = make_bend("bend", load_ring_parameters().bend)
    path = tmp_path / f"duct.{suffix}"
    if suffix == "csv":
        path.write_bytes(encode_duct(duct))
    else:
        rows = [[[round(x, 6) for x in p] for p in points] for points in duct.contour.tolist()]
        path.write_text(f"name: bend\ncontours: {rows}\n")
    np.testing.assert_allclose(read_duct(path).contour, duct.contour, atol=1e-6)


def spoil(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        lines = ["contour,x,y,z"]
        for number, points in enumerate(change(make_pipe())):
            lines += [f"{number},{x},{y},{z}" for x, y, z in points]
        path = folder / "duct.csv"
        path.write_text("\n".join(lines))
        return path

    return write


def raw(text: str, name: str = "duct.csv") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(text)
        return folder / name

    return write


def bumpy(c: np.ndarray) -> np.ndarray:
    c[4, 7, 2] += 0.5
    return c


def twisted(c: np.ndarray) -> np.ndarray:
    c[4:] = np.roll(c[4:], 20, axis=1)
    return c


def doubled(c: np.ndarray) -> np.ndarray:
    c[2, 5] = c[2, 4]
    return c


BAD: dict[str, tuple[Callable[[Path], Path], str]] = {
    "one contour": (spoil(lambda c: c[:1]), "at least 2 contours"),
    "few points": (spoil(lambda c: c[:, :5]), "at least 8 points"),
    "millimetres": (spoil(lambda c: 1000 * c), "in metres"),
    "not finite": (spoil(lambda c: np.where(np.arange(9)[:, None, None] == 3, np.nan, c)), "finite"),
    "not flat": (spoil(bumpy), "contour 5 is not flat"),
    "out of order": (spoil(lambda c: c[[0, 2, 1, 3]]), "not in order"),
    "opposite": (spoil(lambda c: np.stack([c[0], c[1][::-1]])), "opposite"),
    "twisted": (spoil(twisted), "not in line"),
    "twice": (spoil(doubled), "twice in a row"),
    "a line": (spoil(lambda c: c * [1, 0, 1]), "no area"),
    "words": (raw("contour,x,y,z\n1,here,0,0\n"), "line 2"),
    "short row": (raw("contour,x,y,z\n1,0,0\n"), "line 2"),
    "heading": (raw("x,y,z\n0,0,0\n"), "line 1"),
    "empty": (raw(""), "line 1"),
    "no rows": (raw("contour,x,y,z\n"), "same number"),
    "uneven": (raw("contour,x,y,z\n1,0,0,0\n2,0,0,1\n2,1,0,1\n"), "same number"),
    "other kind": (raw("x", "duct.step"), ".csv or .yaml"),
    "yaml key": (raw("name: a\ncontour: []\n", "duct.yaml"), "contour"),
    "absent": (lambda folder: folder / "none.csv", "No such file"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_contours_are_refused_in_one_line(tmp_path: Path, kind: str):
    write, says = BAD[kind]
    with pytest.raises(InputError, match=says) as caught:
        read_duct(write(tmp_path))
    assert "\n" not in str(caught.value)


def test_spheres_stand_on_the_links_and_their_jacobian_is_the_slope():
    arm, parameters = load_arm("duct"), load_ring_parameters()
    body = SphereBody.of(arm, parameters.body)
    assert set(body.names) == {"J2", "J3", "J4", "J5", "J6", "J7", "L2", "L3", "L4", "L5", "lance", "gun"}
    rng = np.random.default_rng(4)
    q = rng.uniform(arm.lower, arm.upper, (20, arm.n))
    np.testing.assert_allclose(body.place(arm, q)[:, -1], arm.forward(q)[:, :3, 3], atol=1e-12)
    J, h = body.jacobian(arm, q), 1e-6
    for i in range(arm.n):
        step = np.eye(arm.n)[i] * h
        slope = (body.place(arm, q + step) - body.place(arm, q - step)) / (2 * h)
        np.testing.assert_allclose(J[..., i], slope, atol=1e-8)
    np.testing.assert_allclose(J[:, -1], arm.jacobian(q)[:, :3], atol=1e-12)
