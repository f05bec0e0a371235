"""How late cycles are, what the collector does between them, and what the probes see."""

import gc
import math
import weakref
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.clock import CYCLE_NS
from ascrcp.session.collector import FULL_CYCLES, YOUNG_CYCLES, Collector
from ascrcp.session.lateness import WINDOW, LatenessMeter
from ascrcp.session.probe import BurdenMeter, CollectorProbe, SleepProbe, TwinProbe


@given(st.lists(st.integers(0, 5 * CYCLE_NS), min_size=1, max_size=60))
def test_missed_cycles_are_the_periods_in_which_none_began(lengths: list[int]) -> None:
    """The driver's own rule: a cycle takes so long, whole periods it overran are left out."""
    meter, due, now = LatenessMeter(), CYCLE_NS, 0
    began = []
    for length in lengths:
        now = max(now, due)
        began.append(now)
        meter.add(due, now, now + length)
        now += length
        due += CYCLE_NS
        if now - due > CYCLE_NS:
            due += (now - due) // CYCLE_NS * CYCLE_NS
    periods = {(at - CYCLE_NS) // CYCLE_NS for at in began}
    assert meter.missed == max(periods) + 1 - len(periods)


def test_newest_samples_are_kept_and_told_in_milliseconds() -> None:
    meter = LatenessMeter()
    for k in range(WINDOW + 10):
        meter.add(k * CYCLE_NS, k * CYCLE_NS + k, k * CYCLE_NS + k + 1_000_000)
    late, body = meter.since(0)
    assert len(late) == WINDOW
    np.testing.assert_allclose(late * 1e6, np.arange(10, WINDOW + 10))
    np.testing.assert_allclose(body, 1.0)
    assert meter.lateness().max == pytest.approx((WINDOW + 9) * 1e-6)
    assert meter.missed == 0


class _Knot:
    """Something only the collector can take away."""

    def __init__(self) -> None:
        self.own = self


@pytest.fixture
def collector() -> Any:
    collector = Collector()
    collector.start()
    yield collector
    collector.stop()


def test_nothing_is_collected_but_after_a_cycle(collector: Collector) -> None:
    assert not gc.isenabled()
    knot = weakref.ref(_Knot())
    for _ in range(YOUNG_CYCLES - 1):
        collector.turn()
    assert knot() is not None
    collector.turn()
    assert knot() is None


def test_old_garbage_goes_with_the_full_collection(collector: Collector) -> None:
    for _ in range(FULL_CYCLES):  # what was built until then stays for good
        collector.turn()
    knot = _Knot()
    for _ in range(FULL_CYCLES - 1):
        collector.turn()
    gone = weakref.ref(knot)
    del knot
    collector.turn()
    assert gone() is None


def test_collecting_is_given_back() -> None:
    collector = Collector()
    collector.start()
    collector.stop()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_probes_see_what_there_is() -> None:
    lock, twin, pauses, burden = SleepProbe(), TwinProbe(), CollectorProbe(), BurdenMeter()
    twin.start()
    lock.start()
    pauses.start()
    gc.collect()
    pauses.stop()
    gc.collect()
    late, alone = lock.stop(), twin.stop()
    assert len(pauses.pauses_ms[2]) == 1
    for seen in (late, alone):
        assert np.all(seen >= 0.0)
    told = burden.stop()
    assert told.own >= 0.0
    assert told.others >= 0.0
    assert math.isfinite(told.load)
