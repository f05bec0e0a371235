"""Run on a display: one scene by both cloud painters, frame times, and the whole window, as pictures.

python gl_pictures.py FOLDER writes gl_VIEW.png, drawn_VIEW.png and FOLDER/zh, FOLDER/en, and prints
the window's painter and the longest and middle time of a turning frame with half a million points.
"""

import json
import statistics
import sys
import time
from pathlib import Path

import msgspec
from PySide6.QtWidgets import QApplication
from rehearsal import SCAN_POSE, Rehearsal, make_scene

from ascrcp.hmi.application import make_application, run
from ascrcp.hmi.camera import Camera, named_cameras
from ascrcp.hmi.cloud import CloudPainter, SplatCloud
from ascrcp.hmi.cloud_gl import GlCloud
from ascrcp.hmi.preparation import prepare
from ascrcp.hmi.scene_canvas import SceneCanvas, make_painter
from ascrcp.hmi.scene_part import arm_line
from ascrcp.hmi.theme import Screen, load_screen

SIZE = (480, 360)
DONE = 200
"""Planned points marked as done."""
TURNS = 60
MANY = 500_000


def open_canvas(painter: CloudPainter, screen: Screen, camera: Camera, points: int) -> SceneCanvas:
    canvas = SceneCanvas(screen, camera, painter)
    canvas.resize(*SIZE)
    canvas.show()
    session = Rehearsal()
    canvas.draw_scene(prepare(make_scene(points=points), points))
    canvas.draw_progress(DONE)
    canvas.draw_arm(arm_line(session.arm.frames(SCAN_POSE), spraying=True))
    return canvas


def draw_view(painter: CloudPainter, screen: Screen, camera: Camera, place: Path) -> None:
    canvas = open_canvas(painter, screen, camera, 40_000)
    canvas.complete()
    assert canvas.grab().save(str(place))
    canvas.close()
    canvas.deleteLater()


def time_turning(painter: CloudPainter, screen: Screen) -> list[float]:
    """Seconds of each frame while the view turns, from the turn to the painted widget."""
    canvas = open_canvas(painter, screen, next(iter(named_cameras(screen.view).values())), MANY)
    times = []
    for _ in range(TURNS):
        began = time.perf_counter()
        canvas.look(canvas.camera.turn(2.7))
        canvas.advance()
        canvas.repaint()
        times.append(time.perf_counter() - began)
    canvas.close()
    canvas.deleteLater()
    return times


def main(folder: Path) -> None:
    make_application()
    screen = load_screen()
    for name, camera in named_cameras(screen.view).items():
        draw_view(GlCloud(screen.view.chunk_gl), screen, camera, folder / f"gl_{name}.png")
        draw_view(SplatCloud(screen.view.chunk_drawn), screen, camera, folder / f"drawn_{name}.png")
    painter = make_painter(screen)
    told: dict[str, object] = {"painter": type(painter).__name__}
    for key, one in (("gl", painter), ("drawn", SplatCloud(screen.view.chunk_drawn))):
        times = time_turning(one, screen)
        told[f"{key}_frame_ms"] = [1e3 * statistics.median(times), 1e3 * max(times)]
    sys.stdout.write(json.dumps(told) + "\n")
    QApplication.processEvents()
    for language in ("zh", "en"):
        shown = msgspec.structs.replace(screen, language=language)
        code = run(Rehearsal(), offscreen=False, pictures=folder / language, auto=True, screen=shown)
        assert code == 0, language


if __name__ == "__main__":
    main(Path(sys.argv[1]))
