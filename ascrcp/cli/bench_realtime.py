"""bench realtime: how late the control loop is with the screen, a scan, recognition and solving at work.

The program that is measured runs as a process of its own, as on the machine; this one only waits.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ascrcp.cli.bench import Figure, Say
from ascrcp.core.errors import DeviceError

LATE_MS = {True: 2.0, False: 5.0}
"""Asked of 99.9 % of the cycles, with real-time priority and without."""

MOST_MS = 10.0
BODY_MS = 1.0


def measure_realtime(
    minutes: float, seed: int, rig: Path | None, planner: str | None, say: Say
) -> list[Figure]:
    """Run screen and job in real time for so long and tell how late the cycles began.

    Args:
        minutes: Real time.
        seed: Of the rig and its heading.
        rig: Overlay of the rig's parameters, None for none.
        planner: Planner in place of the configured one.
        say: Told what goes on.

    Raises:
        DeviceError: The program that is measured failed before it could tell anything.
    """
    say(f"{minutes:g} min in real time: half scanning and solving again and again, half spraying")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "ascrcp.hmi.realtime", "--round", str(Path(folder) / "round")]
        command += ["--minutes", str(minutes), "--seed", str(seed)]
        command += ["--rig", str(rig)] if rig is not None else []
        command += ["--planner", planner] if planner is not None else []
        environment = {"QT_QPA_PLATFORM": "offscreen", **os.environ}
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=False)  # noqa: S603
    try:
        found = json.loads(done.stdout)
    except json.JSONDecodeError:
        raise DeviceError(f"the program that is measured ended with {done.returncode}") from None
    return tell_realtime(found)


def tell_realtime(found: dict[str, Any]) -> list[Figure]:
    """Set what was measured beside what is asked."""
    late, lock, twin = found["late_ms"], found["lock_ms"], found["twin_ms"]
    first = "with" if found["priority"] else "without"
    busy = found["burden"]
    how = f"{found['cycles']} cycles, {first} real-time priority; steps: {_count(found['steps'])}; "
    how += f"computed beside the run: {found['computed']} x recognise, plan, solve"
    load = f"load {busy['load']:.1f}; other programs kept {busy['others']:.2f} processors busy"
    pauses = sum(row["count"] for row in found["collector_ms"])
    longest = max(row["max"] for row in found["collector_ms"])
    return [
        Figure("job done as asked", float(found["ok"]), "", 1.0, True, found["failure"] or how),
        Figure("lateness, median", late["p50"], "ms", note=load),
        Figure("lateness, 99 %", late["p99"], "ms"),
        Figure("lateness, 99.9 %", late["p99_9"], "ms", LATE_MS[found["priority"]]),
        Figure("lateness, largest", late["max"], "ms", MOST_MS),
        Figure("cycles missed", float(found["missed"]), "", 0.0),
        Figure(
            "loop body, median", found["body_ms"]["p50"], "ms", note="wall time: waits for the lock count"
        ),
        Figure("loop body, 99 %", found["body_ms"]["p99"], "ms", BODY_MS),
        Figure("loop body, largest", found["body_ms"]["max"], "ms"),
        Figure("interpreter's lock, 99.9 %", lock["p99_9"], "ms", note="a probe thread of the same priority"),
        Figure("interpreter's lock, longest", lock["max"], "ms"),
        Figure(
            "same probe in an idle process, 99.9 %", twin["p99_9"], "ms", note="what the computer alone does"
        ),
        Figure("same probe in an idle process, longest", twin["max"], "ms"),
        Figure(
            "garbage collector, longest pause", longest, "ms", note=f"{pauses} pauses, after the cycle's end"
        ),
        Figure(
            "own processors busy", busy["own"], "", note=f"{busy['faults']} page faults waited for the disk"
        ),
    ]


def _count(steps: list[str]) -> str:
    return ", ".join(f"{steps.count(step)} x {step}" for step in dict.fromkeys(steps))
