"""The screen, the job and the compute process in real time for minutes: how late is the control loop?

    python -m ascrcp.hmi.realtime --round DIR [--minutes 10] [--seed N] [--planner thesis]

What `ascrcp bench realtime` runs, as a process of its own. In the first half of the time the heading is
scanned, recognised, planned and solved again and again; in the second the arm sprays while the compute
process recognises, plans and solves on. The pages are looked through all the while. Prints one JSON object.
"""

import argparse
import json
import shutil
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QEventLoop, QObject, QTimer, Signal

from ascrcp.app import Options, open_session
from ascrcp.core.errors import AscrcpError, CancelledError
from ascrcp.core.geometry import Array
from ascrcp.hmi.application import make_application
from ascrcp.hmi.text import Language
from ascrcp.hmi.theme import apply_theme, load_screen
from ascrcp.hmi.window import Window
from ascrcp.session.probe import BurdenMeter, CollectorProbe, SleepProbe, TwinProbe
from ascrcp.session.remote import Remote
from ascrcp.session.session import Session
from ascrcp.session.state import Step

PRESS_MS = 200
PAGE_MS = 1500
"""How long each page is looked at (placeholder)."""
WARM_MS = 3000
"""Between the window's first picture and the first figure: the start is told apart (placeholder)."""
AGAIN_FOR_LANGUAGE = 20
"""Pages after which the language is changed."""


class Operator(QObject):
    """Presses through the job for so long, looks through the pages, keeps the compute process busy.

    Signals:
        over: The time is over, or the job failed.
    """

    over = Signal()

    def __init__(self, window: Window, session: Session, minutes: float) -> None:
        super().__init__(window)
        self._window, self._session = window, session
        self._looked = 0
        self._half = self._is_over = False
        self._next = Step.ZERO
        self._crunch: threading.Thread | None = None
        self.failure = ""
        self.done: list[str] = []
        self.rounds = 0
        self._timers = [self._every(PRESS_MS, self.press), self._every(PAGE_MS, self.look)]
        for share, action in ((0.5, self._spray), (1.0, self._end)):
            QTimer.singleShot(round(60e3 * minutes * share), window, action)

    def _every(self, ms: int, action: Any) -> QTimer:
        timer = QTimer(self._window)
        timer.timeout.connect(action)
        timer.start(ms)
        return timer

    def press(self) -> None:
        """Press what the job waits for."""
        snapshot = self._session.snapshot()
        if self._is_over:
            return
        if snapshot.job.stopped:
            if self.done:
                self._fail(self._session.failure or ", ".join(snapshot.causes))
            self._window.rail.reset_button.click()
            return
        if snapshot.job.active is not None or self._session.refusal(self._next) is not None:
            if snapshot.job.active is None and self._session.failure:
                self._fail(self._session.failure)
            return
        step, self._next = self._next, self._after(self._next)
        self.done.append(step.value)
        self._window.steps.buttons[step].click()

    def _after(self, step: Step) -> Step:
        if step is Step.ZERO:
            return Step.RECOGNISE
        if step is Step.RECOGNISE:
            return Step.LOAD if self._half else Step.RECOGNISE
        return Step.RUN if step is Step.GO_TO_START else Step.GO_TO_START

    def look(self) -> None:
        """Look at the next page; turn the view and change the language now and then."""
        self._looked += 1
        pages = self._window.pages
        self._window.show_page(pages[self._looked % len(pages)].key)
        self._window.automatic.scene.buttons["turn_right"].click()
        if self._looked % AGAIN_FOR_LANGUAGE == 0:
            self._window.rail.language_button.click()

    def _spray(self) -> None:
        """Half of the time is over: spray, and compute beside it."""
        self._half = True
        if self._next is Step.RECOGNISE:
            self._next = Step.LOAD
        self._crunch = threading.Thread(target=self._compute, name="ascrcp-bench-compute", daemon=True)
        self._crunch.start()

    def _compute(self) -> None:
        """Recognise, plan and solve the scan in another folder, again and again."""
        session, setup = self._session, self._session.setup
        folder = session.round.folder / "again"
        folder.mkdir(exist_ok=True)
        while not self._is_over and Step.RECOGNISE not in session.snapshot().job.done:
            time.sleep(0.1)
        if self._is_over:
            return
        shutil.copy(session.round.scan, folder)
        known = (setup.machine, setup.profile, setup.perception, setup.payload_kg)
        solve = (folder, setup.machine, setup.planning, setup.payload_kg)
        try:
            while not self._is_over:
                for stage, args in (
                    (Remote.RECOGNISE, (folder, None, *known)),
                    (Remote.PLAN, (folder, setup.planning)),
                    (Remote.SOLVE, solve),
                ):
                    session.compute.run(stage, *args, is_cancelled=lambda: self._is_over)
                self.rounds += 1
        except CancelledError:
            return
        except AscrcpError as error:
            self.failure = self.failure or str(error)

    def _fail(self, reason: str) -> None:
        self.failure = self.failure or reason or "the job stopped"
        self._end()

    def _end(self) -> None:
        if self._is_over:
            return
        self._is_over = True
        for timer in self._timers:
            timer.stop()
        if self._crunch is not None:
            self._crunch.join()
        self.over.emit()


def _turn(until: Callable[[Callable[[], None]], object]) -> None:
    """Let Qt work until what was connected is called; leaving the application would close the window."""
    loop = QEventLoop()
    until(loop.quit)
    loop.exec()


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Open session and window, let the operator work, return what the probes saw."""
    screen = load_screen()
    apply_theme(make_application(), screen)
    job = Options(rig=options.rig, seed=options.seed, planner=options.planner, lockstep=False)
    session = open_session(job, options.round, options.round.parent)
    window = Window(session, screen, Language.ZH)
    window.show()
    _turn(lambda end: QTimer.singleShot(WARM_MS, end))
    meter = session.cycle.meter
    first, missed = meter.count, meter.missed
    lock, twin, collector, burden = SleepProbe(options.trace), TwinProbe(), CollectorProbe(), BurdenMeter()
    twin.start()
    lock.start()
    collector.start()
    operator = Operator(window, session, options.minutes)
    _turn(operator.over.connect)
    late, body = meter.since(first)
    missed = meter.missed - missed
    busy = burden.stop()
    collector.stop()
    found = {
        "ok": not operator.failure,
        "failure": operator.failure,
        "cycles": len(late),
        "start_ms": _percentiles(meter.since(0)[0][:first]),
        "late_ms": _percentiles(late),
        "missed": missed,
        "body_ms": _percentiles(body),
        "lock_ms": _percentiles(lock.stop()),
        "twin_ms": _percentiles(twin.stop()),
        "collector_ms": [
            {"count": len(pauses), "max": max(pauses, default=0.0)} for pauses in collector.pauses_ms
        ],
        "burden": asdict(busy),
        "steps": operator.done,
        "computed": operator.rounds,
        "priority": meter.has_priority,
    }
    window.close()
    return found


def _percentiles(values: Array) -> dict[str, float]:
    if not len(values):
        return {}
    p = np.percentile(values, [50.0, 99.0, 99.9])
    return {"p50": float(p[0]), "p99": float(p[1]), "p99_9": float(p[2]), "max": float(values.max())}


def main() -> int:
    """Run it; return the exit code."""
    parser = argparse.ArgumentParser(description="The control loop's lateness with everything else at work.")
    parser.add_argument("--round", type=Path, required=True, help="an empty folder")
    parser.add_argument("--minutes", type=float, default=10.0, help="real time (10)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--planner", choices=("coverage", "thesis"), default=None)
    parser.add_argument("--rig", type=Path, default=None, help="overlay of the rig's parameters")
    parser.add_argument(
        "--trace", type=argparse.FileType("w"), default=None, help="whose stack held the interpreter's lock"
    )
    options = parser.parse_args()
    found = measure(options)
    sys.stdout.write(json.dumps(found) + "\n")
    return 0 if found["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
