"""The automatic job without a hand on the screen: presses the same buttons, in the same order.

After the run it scans the wall once more, to tell what was laid; if it may spray again, it goes on as long as
the scan leads to another plan.
"""

import math
from collections.abc import Callable
from enum import Enum

from PySide6.QtCore import QObject, Signal

from ascrcp.core.errors import DeviceError
from ascrcp.core.event import EVENTS
from ascrcp.hmi.gallery import Gallery
from ascrcp.hmi.text import STEP_NAME, Language
from ascrcp.hmi.theme import Screen
from ascrcp.hmi.window import Window
from ascrcp.session.snapshot import Snapshot
from ascrcp.session.state import STEPS, Step

SCAN_AGAIN = (Step.ZERO, Step.RESCAN)
AGAIN = (Step.LOAD, Step.GO_TO_START, Step.RUN, *SCAN_AGAIN)
"""What follows a run, and what follows a scan that has led to another plan."""

MIDDLE = 0.5
"""Progress of the run at which a picture is taken."""


class Wait(Enum):
    """What the autopilot waits for."""

    RESET = "reset"
    START = "start"
    STEP = "step"
    OVER = "over"


class Autopilot(QObject):
    """Follows the window's snapshots and presses its buttons; ends with `finished(ok)`.

    Time is counted in refreshes of the window, so that it needs no clock.
    """

    finished = Signal(bool)

    def __init__(
        self,
        window: Window,
        screen: Screen,
        tell: Callable[[str], None],
        gallery: Gallery | None,
        resprays: int | None = None,
    ) -> None:
        """Prepare to press.

        Args:
            window: The screen.
            screen: Patience.
            tell: Takes one line of progress.
            gallery: Takes pictures, None for none.
            resprays: So many further sprayings are asked for; None: not even the scan that measures.
        """
        super().__init__(window)
        self._window, self._tell, self._gallery = window, tell, gallery
        self._patience = math.ceil(1000 * screen.autopilot.patience_s / screen.refresh_ms)
        self._reset_every = math.ceil(1000 * screen.autopilot.reset_every_s / screen.refresh_ms)
        self._wait = Wait.RESET
        self._resprays = resprays
        self._route = [*STEPS]
        self._index = 0
        self._idle = 0
        self._seen: tuple[object, ...] = ()
        self._announced = 0
        self._last_failure = ""
        self._was_active = False
        self._has_middle = False
        window.refused.connect(lambda reason: self._end(False, reason))
        window.refreshed.connect(self._follow)

    @property
    def step(self) -> Step:
        """The step being worked on."""
        return self._route[self._index]

    def _follow(self, snapshot: Snapshot) -> None:
        if self._wait is Wait.OVER:
            return
        self._keep_failure(snapshot)
        if self._is_stuck(snapshot):
            self._give_up(f"nothing changed for so long in {self._wait.value} of {self.step.value}")
        elif self._wait is Wait.RESET:
            self._press_reset(snapshot)
        elif self._wait is Wait.START:
            self._press_step(snapshot)
        else:
            self._watch_step(snapshot)

    def _keep_failure(self, snapshot: Snapshot) -> None:
        for message in snapshot.announcements:
            if message.number > self._announced:
                self._announced = message.number
                if message.failure:
                    self._last_failure = message.text[Language.EN]

    def _is_stuck(self, snapshot: Snapshot) -> bool:
        seen = (snapshot.job, snapshot.stage, snapshot.progress, snapshot.point, self._announced)
        self._idle = 0 if seen != self._seen else self._idle + 1
        self._seen = seen
        return self._idle > self._patience

    def _press_reset(self, snapshot: Snapshot) -> None:
        if not snapshot.job.stopped:
            self._take_picture("00_ready")
            self._wait = Wait.START
        elif self._idle % self._reset_every == 0 and self._window.rail.reset_button.isEnabled():
            self._window.rail.reset_button.click()

    def _press_step(self, snapshot: Snapshot) -> None:
        if snapshot.job.stopped:
            self._give_up(self._explain(snapshot))
            return
        button = self._window.steps.buttons[self.step]
        if not button.isEnabled():
            return
        self._tell(f"{self._index + 1}/{len(self._route)} {STEP_NAME[self.step][Language.EN]}")
        self._wait, self._was_active, self._last_failure = Wait.STEP, False, ""
        button.click()

    def _watch_step(self, snapshot: Snapshot) -> None:
        job = snapshot.job
        if job.active is self.step:
            self._was_active = True
            self._photograph_middle(snapshot)
            return
        if self.step in job.done:
            if self._index < len(STEPS) or self.step is Step.RESCAN:
                self._take_picture(f"{self._index + 1:02d}_{self.step.value}")
            self._go_on(snapshot)
            if self._index + 1 == len(self._route):
                self._finish()
            else:
                self._index += 1
                self._wait = Wait.START
        elif self._was_active or job.stopped or self._last_failure:
            self._give_up(self._explain(snapshot))

    def _go_on(self, snapshot: Snapshot) -> None:
        """Lengthen the route at its end, if there is anything more to do."""
        job = snapshot.job
        if self._resprays is None or not job.has_lidar or self._index + 1 < len(self._route):
            return
        if self.step is Step.RUN:
            self._route += SCAN_AGAIN
        elif not (job.sprayed or job.covered):  # the scan has led to a plan
            self._route += AGAIN

    def _finish(self) -> None:
        self._wait = Wait.OVER
        try:
            if self._gallery is not None:
                self._gallery.photograph_extra()
        except DeviceError as error:
            self._wait = Wait.STEP
            self._end(False, str(error))
            return
        self._tell("job finished")
        self.finished.emit(True)

    def _photograph_middle(self, snapshot: Snapshot) -> None:
        if self.step is Step.RUN and snapshot.progress >= MIDDLE and not self._has_middle:
            self._has_middle = True
            if snapshot.lockstep:  # a picture keeps the interpreter for longer than a cycle
                self._take_picture("05_run_middle")

    def _explain(self, snapshot: Snapshot) -> str:
        if self._last_failure:
            return self._last_failure
        code = next(iter(snapshot.causes), "")
        return (
            EVENTS[code].cause[Language.EN] if code in EVENTS else code or "the step ended without its result"
        )

    def _take_picture(self, name: str) -> None:
        if self._gallery is None:
            return
        try:
            self._gallery.photograph(name)
        except DeviceError as error:
            self._gallery = None
            self._end(False, str(error))

    def _give_up(self, reason: str) -> None:
        """End at a step that failed; what was asked for is sprayed when only its measure is missing."""
        if self._resprays == 0 and self._index >= len(STEPS):
            self._tell(f"{STEP_NAME[self.step][Language.EN]} failed: {reason}; the layer is not measured")
            self._finish()
        else:
            self._end(False, reason)

    def _end(self, is_ok: bool, reason: str) -> None:
        if self._wait is Wait.OVER:
            return
        if not is_ok:
            reason = f"{STEP_NAME[self.step][Language.EN]} failed: {reason}"
        self._wait = Wait.OVER
        self._tell(reason)
        if not is_ok:
            self._take_picture("failed")
        self.finished.emit(is_ok)
