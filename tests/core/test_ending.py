"""Signals become a wish that is looked for; the second one does what it always did."""

import os
import signal
import subprocess
import sys

import pytest

from ascrcp.core.ending import SIGNALS, Ending, interrupted_by_terminate
from ascrcp.core.errors import EndedError


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_noted_and_told_by_its_name(number: signal.Signals) -> None:
    before = [signal.getsignal(n) for n in SIGNALS]
    with Ending() as ending:
        ending.check()
        assert not ending.is_asked
        os.kill(os.getpid(), number)
        assert ending.is_asked
        with pytest.raises(EndedError, match=number.name) as ended:
            ending.check()
        assert ended.value.exit_code == 128 + number
        assert [signal.getsignal(n) for n in SIGNALS] == before, "the second one ends at once"
    assert [signal.getsignal(n) for n in SIGNALS] == before


def test_terminate_interrupts_a_command() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), interrupted_by_terminate():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("number", SIGNALS)
def test_the_program_ends_in_order_with_one_line(number: signal.Signals, tmp_path: object) -> None:
    """Signalled while the arm moves: the window stops it, closes the session, and nobody is left behind."""
    with subprocess.Popen(
        [sys.executable, "-m", "ascrcp", "--offscreen", "--round", f"{tmp_path}/round"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
    ) as program:
        assert program.stderr is not None
        while not program.stderr.readline().startswith("1/"):
            assert program.poll() is None
        program.send_signal(number)
        _, told = program.communicate()
    assert program.returncode == 128 + number
    assert told.splitlines()[-1] == f"ascrcp: ended by {number.name}"
    assert "Traceback" not in told
