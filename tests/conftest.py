"""What every test shares: no display, calm numerics, repeatable properties, no thread left behind."""

import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

# Before Qt and numpy are imported; whoever sets them outside (QT_QPA_PLATFORM=xcb) keeps his choice.
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "2")  # the smallest machine this must run on has two cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more threads add in another order: other last digits

import pytest
from hypothesis import settings

settings.register_profile("ci", deadline=None, derandomize=True)
settings.register_profile("search", deadline=None, max_examples=2000)  # new examples on every run
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

pytest_plugins = ["pytester"]

ROOT = Path(__file__).resolve().parent.parent
GRACE_S = 2.0  # what a thread that was told to stop may take on a busy machine


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder with the held-out headings that lie beside the checkout; the test is skipped without it."""
    path = ROOT.parent / "shared" / "data"
    if not path.is_dir():
        pytest.skip("no ../shared/data beside this checkout")
    return path


@pytest.fixture(autouse=True)
def nothing_left_running() -> Iterator[None]:
    """Fail the test that leaves a thread or a child process behind.

    Fixtures of a wider scope start before this one, so what they run is theirs to end. Threads
    that a library made in C++ show up as dummies and are not counted.
    """
    threads, children = set(threading.enumerate()), set(multiprocessing.active_children())
    yield
    deadline = time.monotonic() + GRACE_S
    left = []
    for thread in set(threading.enumerate()) - threads:
        if isinstance(thread, threading._DummyThread):
            continue
        thread.join(max(0.0, deadline - time.monotonic()))
        if thread.is_alive():
            left.append(f"thread {thread.name}")
    for child in set(multiprocessing.active_children()) - children:
        child.join(max(0.0, deadline - time.monotonic()))
        if child.is_alive():
            left.append(f"process {child.name} ({child.pid})")
    if left:
        pytest.fail("still running after the test: " + ", ".join(sorted(left)), pytrace=False)
