"""Who goes first on the processor: the control thread, then the application, then all it computes with.

Python's lock knows no priorities: while another program has put off the thread that holds it, the
control thread waits with it. So in real time every thread of the application ranks above other programs;
a niceness alone does not do it where the kernel groups programs by session (autogroup). What computes
in a process of its own needs none of this and gives it back.
"""

import contextlib
import os
import threading

CONTROL = 50  # SCHED_FIFO, above ordinary work and below the kernel's interrupt threads (placeholder)
APPLICATION = 1  # SCHED_RR, the least that outranks ordinary programs


def favour_control() -> bool:
    """Give this thread the control loop's priority; False where it may not have it."""
    return _set(0, "SCHED_FIFO", CONTROL)


def favour_application() -> None:
    """Put all threads there are, and those they start from now on, before other programs where permitted."""
    for number in _threads():
        _set(number, "SCHED_RR", APPLICATION)


def release_application() -> None:
    """Make every thread of the application one of many again."""
    for number in _threads():
        _set(number, "SCHED_OTHER", 0)


def be_ordinary(niceness: int = 0) -> None:
    """Make a process that was started by a favoured thread one of many again.

    Args:
        niceness: Greater than 0 gives way to others.
    """
    _set(0, "SCHED_OTHER", 0)
    with contextlib.suppress(PermissionError, AttributeError):  # not every system has it
        os.setpriority(os.PRIO_PROCESS, 0, niceness)


def _threads() -> list[int]:
    return [thread.native_id for thread in threading.enumerate() if thread.native_id is not None]


def _set(number: int, policy: str, priority: int) -> bool:
    try:
        os.sched_setscheduler(number, getattr(os, policy), os.sched_param(priority))
    except (
        PermissionError,
        ProcessLookupError,
        AttributeError,
    ):  # no right to it, just ended, no such system
        return False
    return True
