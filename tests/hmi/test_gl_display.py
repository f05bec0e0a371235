"""The window on a display with OpenGL (a virtual one where there is no other): what is really drawn."""

import json
import os
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from gl_pictures import SIZE
from numpy.typing import NDArray
from PIL import Image
from rehearsal import SCAN_POSE

from ascrcp.hmi.camera import named_cameras
from ascrcp.hmi.scene_part import arm_line
from ascrcp.hmi.theme import load_screen, rgb
from ascrcp.kinematics import load_arm

pytestmark = pytest.mark.display

SCREEN = load_screen()
CAMERAS = named_cameras(SCREEN.view)
BLOCK = 12
"""Side of the squares [px] over which both views are averaged: they round points to pixels differently."""

SCRIPT = Path(__file__).with_name("gl_pictures.py")


def display_command() -> list[str]:
    """Words before a command that give it a display; skips where there is none to have."""
    if os.environ.get("DISPLAY"):
        return []
    if not (shutil.which("xvfb-run") and shutil.which("Xvfb") and shutil.which("xauth")):
        pytest.skip("neither a display nor Xvfb")
    return ["xvfb-run", "--auto-servernum", "--server-args", "-screen 0 1280x800x24"]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of pictures, and what their program said."""
    folder = tmp_path_factory.mktemp("gl")
    environment = {**os.environ, "QT_QPA_PLATFORM": "xcb"}
    done = subprocess.run(
        [*display_command(), sys.executable, str(SCRIPT), str(folder)],
        capture_output=True, text=True, check=False, timeout=200, env=environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Error" not in done.stderr, done.stderr[-2000:]
    return folder, done.stdout


def read(place: Path) -> NDArray[np.int64]:
    with Image.open(place) as image:
        return np.asarray(image.convert("RGB"), dtype=np.int64)


def blocks(picture: NDArray) -> NDArray:
    height, width = (n // BLOCK for n in picture.shape[:2])
    return picture[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK, 3).mean((1, 3))


@pytest.mark.parametrize("name", CAMERAS)
def test_both_views_look_the_same(drawn: tuple[Path, str], name: str) -> None:
    ours, peer = (read(drawn[0] / f"{kind}_{name}.png") for kind in ("gl", "drawn"))
    assert ours.shape == peer.shape == (SIZE[1], SIZE[0], 3)
    assert len(np.unique(ours.reshape(-1, 3), axis=0)) > 50
    off = np.abs(blocks(ours) - blocks(peer)).max(axis=2)
    assert off.mean() < 2.5 and np.percentile(off, 99) < 20.0


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("kind", ["gl", "drawn"])
def test_the_arm_is_where_it_is_and_before_everything(drawn: tuple[Path, str], kind: str, name: str) -> None:
    picture = read(drawn[0] / f"{kind}_{name}.png")
    chain = arm_line(load_arm("kc").frames(SCAN_POSE), spraying=True).chain
    along = np.vstack([np.linspace(a, b, 9)[1:-1] for a, b in pairwise(chain)])
    pixels, _ = CAMERAS[name].project(along, *SIZE)
    inside = ((pixels > 2) & (pixels < np.array(SIZE) - 3)).all(axis=1)
    seen = picture[tuple(np.rint(pixels[inside]).astype(int).T[::-1])]
    colours = np.array([rgb(SCREEN.look.scene.arm), rgb(SCREEN.look.scene.joint)])
    off = np.abs(seen[:, None] - colours).max(axis=2).min(axis=1)
    assert inside.sum() > 20
    assert (off < 40).mean() > 0.85  # the rest lies under the spray's line


def test_the_window_takes_opengl_and_shows_the_job_in_both_languages(drawn: tuple[Path, str]) -> None:
    folder, said = drawn
    told = json.loads(said)
    assert told["painter"] == "GlCloud"
    assert told["gl_frame_ms"][0] < 50.0 and told["drawn_frame_ms"][0] < 50.0  # 20 frames a second
    pictures = {language: read(folder / language / "05_run.png") for language in ("zh", "en")}
    assert (pictures["zh"] != pictures["en"]).any()
    for language, picture in pictures.items():
        for name in ("arm", "path_done", "joint"):
            colour = np.array(rgb(getattr(SCREEN.look.scene, name)))
            near = (np.abs(picture - colour).max(axis=2) <= 2).sum()
            assert near > 20, (language, name)
