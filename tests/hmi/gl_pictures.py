"""Run on a display: both 3-D views of one scene, and the whole window in both languages, as pictures.

python gl_pictures.py FOLDER writes gl_VIEW.png and drawn_VIEW.png, the window's below zh and en, and
prints the class of the window's view.
"""

import sys
from pathlib import Path

import msgspec
from PySide6.QtWidgets import QApplication
from rehearsal import SCAN_POSE, Rehearsal, make_scene

from ascrcp.hmi import window as window_module
from ascrcp.hmi.application import make_application, run
from ascrcp.hmi.camera import Camera, named_cameras
from ascrcp.hmi.drawn_view import DrawnView
from ascrcp.hmi.gl_view import GlView
from ascrcp.hmi.scene_part import arm_line
from ascrcp.hmi.theme import Screen, load_screen

SIZE = (480, 360)
DONE = 200
"""Planned points marked as done."""


def draw_view(kind: type[GlView] | type[DrawnView], screen: Screen, camera: Camera, place: Path) -> None:
    view = kind(screen.scene_colours, screen.colours.void, camera)
    view.resize(*SIZE)
    view.show()
    QApplication.processEvents()
    session = Rehearsal()
    view.draw_scene(make_scene())
    view.draw_progress(DONE)
    view.draw_arm(arm_line(session.arm.frames(SCAN_POSE), spraying=True))
    QApplication.processEvents()
    assert view.grab().save(str(place))
    view.close()
    view.deleteLater()


def main(folder: Path) -> None:
    make_application()
    screen = load_screen()
    for name, camera in named_cameras(screen.view).items():
        draw_view(GlView, screen, camera, folder / f"gl_{name}.png")
        draw_view(DrawnView, screen, camera, folder / f"drawn_{name}.png")
    make_view = window_module.SceneView

    class Told(make_view):  # type: ignore[misc, valid-type]
        """Say which view the window took."""

        def __init__(self, screen: Screen, arm: object) -> None:
            super().__init__(screen, arm)
            sys.stdout.write(type(self.widget).__name__ + "\n")

    window_module.SceneView = Told  # type: ignore[misc]
    for language in ("zh", "en"):
        shown = msgspec.structs.replace(screen, language=language)
        code = run(Rehearsal(), offscreen=False, pictures=folder / language, auto=True, screen=shown)
        assert code == 0, language


if __name__ == "__main__":
    main(Path(sys.argv[1]))
