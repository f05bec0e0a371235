"""What the command line says: one JSON object on stdout or a table; progress and errors on stderr."""

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from ascrcp.core.errors import AscrcpError, EndedError, InputError
from ascrcp.session.store import encode_json

if TYPE_CHECKING:
    from ascrcp.session.session import Session

OK, FAILED, BAD_INPUT = 0, 1, 2
REFRESH_S = 2.0


class Output:
    """Where messages go."""

    def __init__(self, json: bool) -> None:
        self.json = json

    def say(self, line: str) -> None:
        """Print one line of progress."""
        print(line, file=sys.stderr, flush=True)

    def result(self, tree: dict[str, Any], text: str) -> None:
        """Print the result: the tree as JSON, or the text for people."""
        print(encode_json(tree).decode() if self.json else text, flush=True)

    def bar(self, title: str) -> Callable[[float], None]:
        """Return a progress callback that prints each tenth."""
        last = -1

        def tell(fraction: float) -> None:
            nonlocal last
            if int(10 * fraction) > last:
                last = int(10 * fraction)
                self.say(f"  {title} {10 * last:3d} %")

        return tell

    @contextlib.contextmanager
    def progress(self, session: "Session") -> Iterator[Callable[[str], None]]:
        """Print announcements and the progress of a session's step while the block runs."""
        over = threading.Event()

        def watch() -> None:
            shown, last = 0, ""
            while not over.wait(REFRESH_S / 10):
                snapshot = session.snapshot()
                for line in snapshot.announcements:
                    if line.number > shown:
                        shown = line.number
                        self.say(("! " if line.failure else "✓ ") + line.text[0])
                if snapshot.stage[0]:
                    left = snapshot.remaining_s
                    rest = (
                        f", {left:.0f} s of machine time left"
                        if left == left and session.setup.lockstep
                        else ""
                    )
                    now = f"  {snapshot.stage[0]} {10 * int(10 * snapshot.progress)} %"
                    if now != last:
                        last = now
                        self.say(now + rest)

        thread = threading.Thread(target=watch, name="ascrcp-progress", daemon=True)
        thread.start()
        try:
            yield self.say
        finally:
            over.set()
            thread.join()


def guarded(output: Output, action: Callable[[], int]) -> int:
    """Run an action; turn what it raises on purpose into one line and an exit code."""
    try:
        return action()
    except InputError as error:
        return _refuse(output, error, BAD_INPUT)
    except EndedError as error:
        return _refuse(output, error, error.exit_code)
    except AscrcpError as error:
        return _refuse(output, error, FAILED)
    except KeyboardInterrupt:
        output.say("interrupted")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED


def _refuse(output: Output, error: AscrcpError, code: int) -> int:
    line = " ".join(str(error).split())
    print(f"ascrcp: {line}", file=sys.stderr, flush=True)
    if output.json:
        print(encode_json({"ok": False, "error": line}).decode(), flush=True)
    return code
