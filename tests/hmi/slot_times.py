"""How long each slot and each painting in Python keeps the Qt thread busy: processor time, so that a busy
computer does not count. Run it alone for the table: python slot_times.py
"""

import gc
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

from pyqtgraph import GraphicsView
from PySide6.QtWidgets import QApplication
from rehearsal import Rehearsal, make_scene

from ascrcp.hmi.application import make_application
from ascrcp.hmi.bus_part import BusPart
from ascrcp.hmi.chore import Chores
from ascrcp.hmi.playback import PlaybackBar
from ascrcp.hmi.scene_canvas import SceneCanvas
from ascrcp.hmi.section_view import SectionView
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import Screen, apply_theme, load_screen
from ascrcp.hmi.trend import TrendView, load_plot
from ascrcp.hmi.wall_map import WallMap
from ascrcp.hmi.wall_page import WallPage
from ascrcp.hmi.window import Window
from ascrcp.session.state import STEPS, JobState, Step

MANY = 500_000
ROUNDS = 60
PASSES = 34
"""Of 60 points: as many as a round has."""
SLOTS: tuple[tuple[type, str], ...] = (
    (Window, "refresh"), (Window, "show_page"), (Window, "set_language"), (Chores, "work"),
    (Window, "set_theme"),
    (SceneCanvas, "paintEvent"), (SceneCanvas, "advance"), (WallMap, "paintEvent"),
    (SectionView, "paintEvent"), (TrendView, "draw"), (GraphicsView, "paintEvent"), (WallPage, "_move"),
    (PlaybackBar, "_slide"), (BusPart, "show_snapshot"),
)  # fmt: skip

Times = dict[str, list[float]]


@contextmanager
def timed() -> Iterator[Times]:
    """Note the processor time [ms] of every call of the slots."""
    times: Times = defaultdict(list)
    kept = [(owner, name, getattr(owner, name)) for owner, name in SLOTS]

    def wrap(key: str, call: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(call)
        def measured(*args: Any, **kwargs: Any) -> Any:
            began = time.thread_time()
            try:
                return call(*args, **kwargs)
            finally:
                times[key].append(1e3 * (time.thread_time() - began))

        return measured

    for owner, name, call in kept:
        setattr(owner, name, wrap(f"{owner.__name__}.{name}", call))
    try:
        yield times
    finally:
        for owner, name, call in kept:
            setattr(owner, name, call)


def use_everything(window: Window, session: Rehearsal) -> None:
    """Let every page draw while the arm moves, then switch and choose."""
    session.start(Step.RUN)
    for page in window.pages:
        window.show_page(page.key)
        for _ in range(ROUNDS):
            window.refresh()
            QApplication.processEvents()
        if page.key == "automatic":
            for _ in range(5):
                window.automatic.scene._turn(10.0)
                for _ in range(8):
                    window.refresh()
                    QApplication.processEvents()
    session.job = JobState(stopped=False, done=frozenset(STEPS[:4]))
    window.setup.open()
    for key in window.setup.parts:
        window.setup.choose(key)
        for _ in range(8):
            window.refresh()
            QApplication.processEvents()
    window.show_page("wall")
    for _ in range(10):
        window.wall.on.click()
        QApplication.processEvents()
    window.show_page("automatic")
    window.refresh()
    for value in range(0, 1000, 50):
        window.automatic.playback.slider.setValue(value)
        QApplication.processEvents()
    for language in (*Language, *Language):
        window.set_language(language)
        for _ in range(8):
            window.refresh()
            QApplication.processEvents()
    window._switch_theme()
    QApplication.processEvents()


def measure(screen: Screen, points: int = MANY) -> Times:
    """Return the times [ms] of every slot with a cloud of so many points."""
    session = Rehearsal(ticks=10**9)
    session.reset()
    session.job = JobState(stopped=False, done=frozenset(STEPS[:4]))
    load_plot()
    gc.collect()
    gc.freeze()  # as the session does: a collection over all modules is 40 ms
    with timed() as times:
        window = Window(session, screen, Language.ZH)
        window._timer.stop()
        window.joints_page.trend._make()
        window.show()
        window.refresh()
        session.drawn = make_scene(points=points, passes=PASSES)
        while window.automatic.scene._scene.version == 0:
            window.refresh()
            QApplication.processEvents()
        use_everything(window, session)
        window.close()
        window.deleteLater()
    gc.unfreeze()
    return times


def main() -> None:
    application = make_application()
    screen = load_screen()
    apply_theme(application, screen)
    for name, values in sorted(measure(screen).items(), key=lambda row: -max(row[1])):
        middle = sorted(values)[len(values) // 2]
        sys.stdout.write(
            f"{name:32s} {len(values):5d} x  middle {middle:6.2f} ms  longest {max(values):6.2f} ms\n"
        )


if __name__ == "__main__":
    main()
