"""Faults of the bus through cycle and gate: a foreign sender (F32), an adapter that went away (F33)."""

from collections.abc import Iterator

import can
import numpy as np
import pytest
from steer_bench import CODEC, CONTROL, NOMINAL, SteerBench

from ascrcp.control.move import plan_move
from ascrcp.safety.gate import GateState


@pytest.fixture
def bench() -> Iterator[SteerBench]:
    made = SteerBench(None)
    yield made
    made.close()


def set_moving(bench: SteerBench) -> None:

    away = (np.array(bench.last.inputs.q) + np.array([0.5] + [0.0] * 7)).tolist()
    bench.cycle.follow(plan_move(NOMINAL, bench.last.inputs.q, away, CONTROL))
    bench.run(1.5)
    assert any(bench.last.verdict.command.drive)


@pytest.mark.parametrize("name", ["ValveCommand1", "ValveCommand2", "SprayCommand", "PanCommand"])
def test_f32_a_foreign_sender_of_our_commands_stops_in_one_cycle(bench: SteerBench, name: str) -> None:
    set_moving(bench)
    intruder = can.Bus(interface="virtual", channel=bench.channel)
    try:
        number = CODEC.layout(name).can_id
        intruder.send(can.Message(arbitration_id=number, data=bytes(8), is_extended_id=False))
        bench.turn()
        assert "foreign_sender" in bench.last.verdict.causes
        assert not any(bench.last.verdict.command.drive) and not bench.last.verdict.command.enable
        bench.run(1.0)
        assert bench.last.verdict.state is GateState.STOPPED
        bench.cycle.press_reset()
        bench.run(0.2)
        assert bench.last.verdict.state is GateState.READY, "with the intruder gone reset leads out"
    finally:
        intruder.shutdown()


def test_f33_an_unplugged_adapter_stops_and_is_opened_anew_only_by_hand(bench: SteerBench) -> None:
    set_moving(bench)
    ours = bench.buses[1]
    ours._fail("unplugged")
    bench.turn()
    assert "bus_error" in bench.last.verdict.causes and not any(bench.last.verdict.command.drive)
    bench.run(2.0)
    assert not ours.ok and not any(bench.rig.drive), "the rig's watchdog has made it neutral"
    bench.cycle.press_reset()
    bench.run(0.2)
    assert bench.last.verdict.state is GateState.STOPPED
    bench.cycle.begin(lambda: ours.reopen() is not None)
    bench.run(0.2)
    bench.cycle.press_reset()
    bench.run(0.2)
    assert ours.ok and bench.last.verdict.state is GateState.READY, bench.last.verdict.causes
