"""The compute process: results, errors, cancelling and death, on a real spawned process."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from ascrcp.core.errors import CancelledError, DefectError, DeviceError, InputError
from ascrcp.session.compute import Compute


def double(values: np.ndarray, progress: Callable[[float], None]) -> np.ndarray:
    progress(0.5)
    return 2 * values


def refuse(text: str, progress: Any) -> None:
    raise InputError(text)


def divide(progress: Any) -> float:
    return 1 / 0


def patient(progress: Callable[[float], None]) -> None:
    for i in range(10_000):
        progress(i / 10_000)
        time.sleep(0.005)


def stubborn(progress: Any) -> None:
    while True:
        time.sleep(1.0)


def die(progress: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture
def compute() -> Iterator[Compute]:
    process = Compute()
    yield process
    process.close()


def test_arrays_come_back_whole_and_read_only(compute: Compute) -> None:
    values = np.random.default_rng(0).normal(size=(300_000, 3))
    seen: list[float] = []
    result = compute.run(double, values, progress=seen.append)
    assert np.array_equal(result, 2 * values)
    assert seen == [0.5]


def test_errors_on_purpose_keep_their_kind_and_text(compute: Compute) -> None:
    with pytest.raises(InputError, match="line 7 is bad"):
        compute.run(refuse, "line 7 is bad")
    with pytest.raises(DefectError, match="divide: ZeroDivisionError") as defect:
        compute.run(divide)
    assert "Traceback" in defect.value.__notes__[0]


def test_cancel_ends_a_stage_that_asks_and_one_that_does_not(compute: Compute) -> None:
    for stage in (patient, stubborn):
        begun = time.monotonic()
        with pytest.raises(CancelledError):
            compute.run(stage, is_cancelled=lambda begun=begun: time.monotonic() - begun > 0.3)
    assert np.array_equal(compute.run(double, np.ones(3)), [2, 2, 2]), "usable again afterwards"


def test_death_is_one_clear_error_and_the_next_use_starts_anew(compute: Compute) -> None:
    with pytest.raises(DeviceError, match="compute process died while running die"):
        compute.run(die)
    assert compute.run(double, np.ones(1))[0] == 2
