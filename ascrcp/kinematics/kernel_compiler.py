"""Compile functions to machine code (numba): what the kernels' decorators and argument types are.

Compiling takes some seconds and is done once, at set-up or by the compute process; the code is kept.
"""

from collections.abc import Callable
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba import types

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Callable[..., Any] = partial(numba.njit, nogil=True, error_model="numpy")
"""Python's lock is free meanwhile. No fast mathematics: the same input gives the same bits."""


def array_of(kind: Any, axes: int, is_written: bool = False) -> Any:
    """Type of a C-ordered array; read-only, which takes writeable ones too, if it is not written to."""
    return types.Array(kind, axes, "C", readonly=not is_written)


def table_of(kind: type, *fields: Any) -> Any:
    """Type of a named tuple with fields of these types."""
    return types.NamedTuple(fields, kind)  # type: ignore[no-untyped-call]


def part(function: Function) -> Function:
    """Compile a function into those of its module that call it."""
    made: Function = _njit(function)
    return made


def whole(*arguments: Any) -> Callable[[Function], Function]:
    """Compile a function for arguments of these types, now.

    The code is kept beside the module or, where that may not be written, at home. It is compiled anew when
    any kernel's file changes: numba looks at the function's own only, so its name carries their digest.
    """

    def decorate(function: Function) -> Function:
        made: Function
        function.__qualname__ = f"{function.__name__}_{_digest()}"
        try:
            made = _njit([arguments], cache=True)(function)
        except RuntimeError as error:
            if "no locator" not in str(error):
                raise
            # neither place may be written: every process compiles for itself
            made = _njit([arguments])(function)
        return made

    return decorate


@cache
def _digest() -> str:
    files = sorted(Path(__file__).parent.glob("kernel*.py"))
    return sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]
