"""What keeps the control thread waiting: probes of the interpreter's lock, the collector and the processor.

For the bench of real time only; nothing of it runs in a job. A probe thread with the control thread's
priority sleeps short times: what it is late beyond a twin in a process of its own, in which nobody
holds the lock, is the lock's doing.
"""

import faulthandler
import gc
import multiprocessing as mp
import os
import resource
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

import numpy as np

from ascrcp.core.clock import NS
from ascrcp.core.geometry import Array
from ascrcp.core.priority import be_ordinary, favour_control

PERIOD_NS = 5_000_000
"""Of the probes: four looks in each control cycle (placeholder)."""

MOST = 1 << 18
"""Samples a probe keeps: 22 minutes."""


HOLD_S = 0.003
"""A probe so late has its program's threads written down: one of them holds the lock."""


class SleepProbe:
    """Sleeps to absolute instants and notes how late it wakes."""

    def __init__(self, trace: IO[str] | None = None) -> None:
        """Args: trace: file that takes the stacks of all threads whenever it is late, None for none."""
        self._trace = trace
        self._late = np.zeros(MOST)
        self._count = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.turn, name="ascrcp-probe", daemon=True)

    def start(self) -> None:
        """Start in a thread of its own."""
        self._thread.start()

    def turn(self) -> None:
        """Sleep and note until told to stop."""
        favour_control()
        due = time.monotonic_ns() + PERIOD_NS
        while not self._stop.is_set() and self._count < MOST:
            left = due - time.monotonic_ns()
            if self._trace is not None:  # a thread of C writes it, the lock held or not
                faulthandler.dump_traceback_later(max(0, left) / NS + HOLD_S, file=self._trace)
            if left > 0:
                time.sleep(left / NS)
            now = time.monotonic_ns()
            self._late[self._count] = max(0, now - due) * 1e-6
            if self._trace is not None and now - due > HOLD_S * NS:
                self._trace.write(f"so late: {(now - due) * 1e-6:.1f} ms\n")
            self._count += 1
            due = max(due + PERIOD_NS, now)
        faulthandler.cancel_dump_traceback_later()

    def stop(self) -> Array:
        """Stop; return how late it woke each time [ms], shape (k,)."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        return self._late[: self._count]


class TwinProbe:
    """The same sleeps in a process of its own: what the computer alone does to a thread."""

    def __init__(self) -> None:
        context = mp.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process: Any = context.Process(target=_twin, args=(theirs,), name="ascrcp-twin", daemon=True)

    def start(self) -> None:
        """Start the process; return once it sleeps."""
        self._process.start()
        self._pipe.recv()

    def stop(self) -> Array:
        """Stop; return how late it woke each time [ms], shape (k,)."""
        self._pipe.send(None)
        late: Array = self._pipe.recv()
        self._process.join()
        return late


def _twin(pipe: Connection) -> None:
    be_ordinary()
    gc.disable()
    probe = SleepProbe()
    probe.start()
    pipe.send(None)
    pipe.recv()
    pipe.send(probe.stop())


class CollectorProbe:
    """Notes every pause of the garbage collector.

    Attributes:
        pauses_ms: Length of each pause [ms], by generation.
    """

    def __init__(self) -> None:
        self.pauses_ms: tuple[list[float], list[float], list[float]] = ([], [], [])
        self._began = 0

    def start(self) -> None:
        """Begin to listen."""
        gc.callbacks.append(self._note)

    def stop(self) -> None:
        """Listen no more."""
        gc.callbacks.remove(self._note)

    def _note(self, phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            self._began = time.monotonic_ns()
        else:
            self.pauses_ms[info["generation"]].append((time.monotonic_ns() - self._began) * 1e-6)


@dataclass(frozen=True)
class Burden:
    """How busy the computer was meanwhile.

    Attributes:
        load: Mean number of runnable tasks over the last minute, as the kernel tells it.
        own: Processors this program and its children kept busy.
        others: Processors all other programs kept busy.
        faults: Page faults of this process that had to wait for the disk.
    """

    load: float
    own: float
    others: float
    faults: int


class BurdenMeter:
    """Tells this program's share of the processors from everybody else's (Linux; zeros elsewhere)."""

    def __init__(self) -> None:
        self._began = (time.monotonic(), _busy_s(), _own_s())
        self._faults = resource.getrusage(resource.RUSAGE_SELF).ru_majflt

    def stop(self) -> Burden:
        """Return what was used since it was made; children count once they have ended or told."""
        now = (time.monotonic(), _busy_s(), _own_s())
        wall, busy, own = (b - a for a, b in zip(self._began, now, strict=True))
        faults = resource.getrusage(resource.RUSAGE_SELF).ru_majflt - self._faults
        return Burden(os.getloadavg()[0], own / wall, max(0.0, busy - own) / wall, faults)


def _busy_s() -> float:
    """Processor time all programs have used since the computer started [s]."""
    try:
        words = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:]
    except OSError:
        return 0.0
    ticks = [int(word) for word in words]
    return float(sum(ticks[:3]) + sum(ticks[5:7])) / os.sysconf("SC_CLK_TCK")


def _own_s() -> float:
    """Processor time of this process and every process below it [s]."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    used: dict[int, float] = {}
    below: dict[int, list[int]] = {}
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = place.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended: its time stands with the ended children
        pid = int(place.parent.name)
        below.setdefault(int(fields[1]), []).append(pid)
        used[pid] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    found = list(below.get(os.getpid(), []))
    for pid in found:
        found += below.get(pid, [])
    return time.process_time() + ended.ru_utime + ended.ru_stime + sum(used[pid] for pid in found)
