"""Call machine code: rows of joints -> results, the modules loaded when they are first needed."""

import ctypes
import gc
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.geometry import Array

MANY = 1024
"""Rows from which on two threads pay: starting one takes 0.1 ms, a posture 2 us."""

KERNELS = ("nearest", "field", "clearance", "task", "smooth", "route")
"""Modules of machine code."""


@cache
def kernel(name: str) -> ModuleType:
    """Return a module of machine code by name: it is loaded when it is first used, in a third of a second.

    Loaded beside the control thread it must not hold Python's lock: nor may what was loaded be searched for
    garbage after a control cycle.
    """
    if "llvmlite" not in sys.modules:
        _open_compiler()
    module = import_module(f"ascrcp.kinematics.kernel_{name}")
    gc.freeze()
    return module


def _open_compiler() -> None:
    """Open the compiler's library, 170 MB, with the lock free; its own loader holds it for 7 ms meanwhile."""
    found = find_spec("llvmlite")
    if sys.platform == "linux" and found is not None:
        for place in found.submodule_search_locations or ():
            library = ctypes.CDLL(None).dlopen
            library.argtypes, library.restype = (ctypes.c_char_p, ctypes.c_int), ctypes.c_void_p
            library(os.fsencode(os.path.join(place, "binding", "libllvmlite.so")), os.RTLD_NOW)


def load_kernels() -> None:
    """Load all machine code ahead of its first use; compiles what is not kept yet, in some 20 s."""
    for name in KERNELS:
        kernel(name)


def as_rows(values: ArrayLike) -> Array:
    """Return vectors (..., k) as the machine code takes them: C-ordered doubles, shape (n, k)."""
    values = np.ascontiguousarray(values, dtype=float)
    return values.reshape(-1, values.shape[-1])


def by_halves(call: Callable[..., Any], *rows: NDArray[Any], many: int = MANY) -> Any:
    """Call machine code with rows; many of them in two halves, side by side on two cores.

    The code frees Python's lock, and every row is computed by itself: the bits are the same.

    Args:
        call: Takes the rows and returns an array, or a tuple of them, with as many.
        rows: Arrays of the same length.
        many: Rows from which on that pays.
    """
    half = len(rows[0]) // 2
    if 2 * half < many:
        return call(*rows)
    with ThreadPoolExecutor(1) as beside:
        later = beside.submit(call, *(each[half:] for each in rows))
        first = call(*(each[:half] for each in rows))
        second = later.result()
    if isinstance(first, tuple):
        return tuple(np.concatenate(pair) for pair in zip(first, second, strict=True))
    return np.concatenate([first, second])
