"""doctor: what this computer has and what is missing, one line each."""

import ctypes.util
import os
import platform
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

from ascrcp.cli.output import FAILED, OK, Output
from ascrcp.cli.parser import Options
from ascrcp.core.paths import CONFIG, RESOURCES

LIBRARIES = {  # library -> (Debian package, what it is for)
    "EGL": ("libegl1", "the screen"),
    "GL": ("libgl1", "the 3-D view"),
    "xkbcommon": ("libxkbcommon0", "the screen"),
    "dbus-1": ("libdbus-1-3", "the screen"),
    "fontconfig": ("libfontconfig1", "text"),
    "glib-2.0": ("libglib2.0-0", "the screen"),
    "usb-1.0": ("libusb-1.0-0", "Open3D"),
}
PACKAGES = ("PySide6_Essentials", "numpy", "scipy", "python-can", "cantools", "mcap", "ruckig")
LEAST_FREE = 1_000_000_000  # fault F38: warn below 1 GB


def doctor(options: Options, output: Output) -> int:
    """Check the computer; exit 1 if something the job needs is missing."""
    checks = [*_system(), *_packages(), *_libraries(), *_extras()]
    ok = all(good for _, good, needed, _ in checks if needed)
    tree = [
        {"what": what, "ok": good, "needed": needed, "detail": text} for what, good, needed, text in checks
    ]
    lines = [
        f"{'ok  ' if good else ('MISSING' if needed else 'without')}  {what}: {text}"
        for what, good, needed, text in checks
    ]
    output.result({"ok": ok, "checks": tree}, "\n".join(lines))
    return OK if ok else FAILED


Check = tuple[str, bool, bool, str]
"""What, whether it is there, whether the job needs it, detail."""


def _system() -> list[Check]:
    free = shutil.disk_usage(Path.cwd()).free
    return [
        ("Python", (3, 11) <= sys.version_info[:2] < (3, 13), True, platform.python_version()),
        ("configuration", CONFIG.is_dir() and RESOURCES.is_dir(), True, str(CONFIG)),
        ("disk", free > LEAST_FREE, True, f"{free / 1e9:.1f} GB free here"),
        ("processors", (os.cpu_count() or 1) >= 2, False, str(os.cpu_count())),
    ]


def _packages() -> list[Check]:
    found: list[Check] = []
    for name in PACKAGES:
        try:
            found.append((name, True, True, metadata.version(name)))
        except metadata.PackageNotFoundError:
            found.append((name, False, True, "run `make setup`"))
    return found


def _libraries() -> list[Check]:
    found: list[Check] = []
    for library, (package, purpose) in LIBRARIES.items():
        name = ctypes.util.find_library(library)
        found.append((f"lib{library}", name is not None, True, name or f"install {package} for {purpose}"))
    return found


def _extras() -> list[Check]:
    can = [place.name for place in Path("/sys/class/net").glob("*can*")]
    display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return [
        ("display", bool(display), False, display or "none: ascrcp runs --offscreen"),
        ("Xvfb", shutil.which("Xvfb") is not None, False, shutil.which("Xvfb") or "not installed (xvfb)"),
        ("CAN interface", bool(can), False, ", ".join(can) or "none: only the simulated rig can run"),
        ("Chinese font", *_chinese_font()),
        ("real-time priority", *_realtime()),
    ]


def _chinese_font() -> tuple[bool, bool, str]:
    tool = shutil.which("fc-list")
    if tool is None:
        return False, False, "unknown (fc-list is not installed)"
    command = [tool, ":lang=zh", "family"]
    fonts = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - fixed words
    first = fonts.stdout.strip().splitlines()
    return bool(first), False, first[0] if first else "none: install fonts-wqy-microhei"


def _realtime() -> tuple[bool, bool, str]:
    try:
        old = os.sched_getscheduler(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, old, os.sched_param(0))
    except (PermissionError, AttributeError):
        return False, False, "not permitted: the control cycle runs with ordinary priority"
    return True, False, "permitted"
