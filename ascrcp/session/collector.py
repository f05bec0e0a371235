"""Collect garbage when it keeps nobody waiting: right after a control cycle, never in the middle of one.

The interpreter collects whenever enough objects have been made, in whichever thread that happens, and
holds its lock meanwhile: 14 to 21 ms over the heap of the screen. Here the control thread collects
itself, with most of a period left until its next deadline.
"""

import gc
import time

YOUNG_CYCLES = 10
OLDER_CYCLES = 100
FULL_CYCLES = 500
"""Cycles between collections of the three generations (placeholders: 0.2, 2 and 10 s)."""

FREEZE_NS = 4_000_000
"""A full collection that took longer takes what survived it out of all later ones (placeholder)."""


class Collector:
    """Takes collecting over from the interpreter, and gives it back."""

    def __init__(self) -> None:
        self._cycles = 0
        self._was_enabled = False

    def start(self) -> None:
        """Collect once over everything, take it out of later collections, and switch the automatic off."""
        self._was_enabled = gc.isenabled()
        gc.disable()
        gc.collect()
        gc.freeze()

    def turn(self) -> None:
        """Collect what is due after one more control cycle."""
        self._cycles += 1
        if self._cycles == FULL_CYCLES:  # the screen has been built by now; walking over it takes 10 to 28 ms
            gc.freeze()
        elif self._cycles % FULL_CYCLES == 0:
            began = time.monotonic_ns()
            gc.collect()
            if time.monotonic_ns() - began > FREEZE_NS:
                gc.freeze()
        elif self._cycles % OLDER_CYCLES == 0:
            gc.collect(1)
        elif self._cycles % YOUNG_CYCLES == 0:
            gc.collect(0)

    def stop(self) -> None:
        """Give collecting back to the interpreter."""
        gc.unfreeze()
        if self._was_enabled:
            gc.enable()
