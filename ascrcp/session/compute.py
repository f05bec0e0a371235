"""The compute process: heavy stages run beside the application, never inside it.

Open3D, SciPy and large parses hold the interpreter's lock for seconds; in the application's process
they made the control loop miss its deadlines (faults, trap 1). A spawned process does the
work, arrays travel through shared memory, and only the small rest is pickled.
"""

import gc
import itertools
import multiprocessing as mp
import pickle
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from ascrcp.core.errors import AscrcpError, CancelledError, DefectError, DeviceError
from ascrcp.core.priority import be_ordinary
from ascrcp.session.remote import Remote, load_stages

Progress = Callable[[float], None]
"""Called with the fraction done, 0..1; raises CancelledError when the job is to end."""

_CANCEL_PATIENCE_S = 2.0  # a stage that does not ask for so long is killed instead


class Compute:
    """One spawned process that runs stage functions, one at a time."""

    def __init__(self, niceness: int = 0) -> None:
        self._niceness = niceness
        self._context = mp.get_context("spawn")
        self._lock = threading.Lock()
        self._process: Any = None
        self._pipe: Connection | None = None
        self._cancel: Any = None
        self._closed = False

    def start(self) -> None:
        """Spawn the process and load the stages ahead of the first use, so that neither delays it."""
        with self._lock:
            if not self._closed:  # a session that is closed at once must leave no process behind
                self._ensure(is_ahead=True)

    def _ensure(self, is_ahead: bool = False) -> None:
        if self._process is not None and self._process.is_alive():
            return
        ours, theirs = self._context.Pipe()
        self._cancel = self._context.Event()
        self._process = self._context.Process(
            target=_serve,
            args=(theirs, self._cancel, self._niceness, is_ahead),
            name="ascrcp-compute",
            daemon=True,
        )
        self._process.start()
        theirs.close()
        self._pipe = ours

    def run(
        self,
        function: Remote | Callable[..., Any],
        *args: Any,
        progress: Progress | None = None,
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> Any:
        """Run `function(*args, progress=...)` in the compute process and return its result.

        Args:
            function: A stage by name, or a module-level function; it takes a keyword `progress`.
            args: Picklable arguments; arrays go through shared memory.
            progress: Called here with the fraction done.
            is_cancelled: Asked several times a second.

        Raises:
            CancelledError: If `is_cancelled` said so.
            DeviceError: If the process died.
            AscrcpError: Whatever the function raised on purpose.
            DefectError: Anything else it raised, its traceback as a note.
        """
        with self._lock:
            self._ensure()
            assert self._pipe is not None
            self._cancel.clear()
            try:
                _send(self._pipe, ("run", function, args))
                return self._wait(progress, is_cancelled)
            except (EOFError, BrokenPipeError, ConnectionResetError):
                self._kill()
                raise DeviceError(
                    f"the compute process died while running {_name(function)}; the next use starts it again"
                ) from None

    def _wait(self, progress: Progress | None, is_cancelled: Callable[[], bool]) -> Any:
        assert self._pipe is not None
        waited = 0.0
        while True:
            if is_cancelled():
                self._cancel.set()
                waited += 0.05
                if waited > _CANCEL_PATIENCE_S:
                    self._kill()
                    raise CancelledError("cancelled")
            if not self._pipe.poll(0.05):
                continue
            kind, value = _receive(self._pipe)
            if kind == "progress":
                if progress is not None:
                    progress(value)
            elif kind == "result":
                return value
            else:
                raise value

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None

    def close(self) -> None:
        """End the process, for good."""
        with self._lock:
            self._closed = True
            self._kill()


def _send(pipe: Connection, message: Any) -> None:
    """Pickle small things into the pipe, arrays out of band into one shared block."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    raws = [buffer.raw() for buffer in buffers]
    sizes = [raw.nbytes for raw in raws]
    total = sum(sizes)
    block = SharedMemory(create=True, size=total) if total else None
    if block is not None:
        place = np.frombuffer(_memory(block), np.uint8, total)
        at = 0
        for raw, size in zip(raws, sizes, strict=True):
            place[at : at + size] = np.frombuffer(raw, np.uint8)  # numpy frees the lock while it copies
            at += size
        del place
    pipe.send((head, sizes, block.name if block is not None else None))
    if block is not None:
        block.close()


def _memory(block: SharedMemory) -> memoryview:
    assert block.buf is not None
    return block.buf


def _receive(pipe: Connection) -> Any:
    head, sizes, name = pipe.recv()
    if name is None:
        return pickle.loads(head)  # noqa: S301 - our own child process
    block = SharedMemory(name=name)
    data = np.empty(sum(sizes), np.uint8)
    data[:] = np.frombuffer(_memory(block), np.uint8, len(data))
    block.close()
    block.unlink()
    edges = [0, *itertools.accumulate(sizes)]
    whole = memoryview(data).toreadonly()  # type: ignore[arg-type]
    views = [whole[a:b] for a, b in itertools.pairwise(edges)]
    return pickle.loads(head, buffers=views)  # noqa: S301 - our own child process


def _name(function: Remote | Callable[..., Any]) -> str:
    return function.value.partition(":")[2] if isinstance(function, Remote) else function.__name__


def _defect(name: str, error: Exception) -> DefectError:
    """Describe an error nobody expected; an exception's own object may not survive the journey."""
    defect = DefectError(f"internal error in {name}: {type(error).__name__}: {error}")
    defect.add_note("".join(traceback.format_exception(error)))
    return defect


def _serve(pipe: Connection, cancel: Any, niceness: int, is_ahead: bool) -> None:
    """Loop of the compute process."""
    be_ordinary(niceness)
    if is_ahead:
        load_stages()
        gc.freeze()  # what was loaded stays: no use in searching it for garbage

    def progress(fraction: float) -> None:
        if cancel.is_set():
            raise CancelledError("cancelled")
        _send(pipe, ("progress", float(fraction)))

    while True:
        try:
            _, function, args = _receive(pipe)
        except (EOFError, KeyboardInterrupt):
            return
        try:
            call = function.function if isinstance(function, Remote) else function
            answer = ("result", call(*args, progress=progress))
        except AscrcpError as error:
            answer = ("error", error)
        except Exception as error:  # noqa: BLE001 - carried to the caller with its traceback, not swallowed
            answer = ("error", _defect(_name(function), error))
        _send(pipe, answer)
