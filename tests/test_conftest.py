"""The net under all other tests: a thread or process that outlives its test is caught."""

from pathlib import Path

import pytest

CONFTEST = Path(__file__).with_name("conftest.py")


def test_what_outlives_its_test_is_caught(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(CONFTEST.read_text(encoding="utf-8").replace("GRACE_S = 2.0", "GRACE_S = 0.2"))
    pytester.makepyfile("""
        import multiprocessing
        import threading
        import time

        def test_thread_left():
            threading.Thread(target=threading.Event().wait, name="forgotten", daemon=True).start()

        def test_process_left():
            multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,), daemon=True).start()

        def test_tidy():
            thread = threading.Thread(target=lambda: None)
            thread.start()
    """)
    result = pytester.runpytest_subprocess("-p", "no:dash")
    result.assert_outcomes(passed=3, errors=2)
    result.stdout.fnmatch_lines(["*still running after the test: thread forgotten*"])
