"""The stick on the rig: nozzle on the planned surface, deadman, lost stick, jogs, and the record."""

import math
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import can
import numpy as np
import pytest
from steer_bench import (
    ALLOWED_DEG,
    ALLOWED_MM,
    CAN,
    CODEC,
    CONTROL,
    NOMINAL,
    SAFETY,
    STEER,
    Operator,
    PlannedSurface,
    ScriptedStick,
    SteerBench,
    build_plan,
    commission,
    load_heading,
)

from ascrcp.control.steer import SteerStatus
from ascrcp.control.steer_plan import SteerPlan
from ascrcp.control.steer_tracker import SteerTracker
from ascrcp.control.tracker import Tracker
from ascrcp.core.config import load
from ascrcp.core.paths import CONFIG
from ascrcp.devices.joystick import REST, JoystickConfig, SetStick, StickState
from ascrcp.devices.joystick_can import CanJoystick, encode_frame, frame_id
from ascrcp.devices.machine_link import MachineLink
from ascrcp.kinematics.arm import Arm
from ascrcp.safety.gate import Gate, GateState
from ascrcp.safety.limit import Limits
from ascrcp.session.cycle import Cycle, CycleOutput, Stick
from ascrcp.session.order import decode_order, encode_order
from ascrcp.session.replay import replay
from ascrcp.session.steering import KernelMaker, SteerOrder

JOYSTICK = load(CONFIG / "devices" / "joystick.yaml", JoystickConfig)
_channel = count()


def hold(along: Callable[[float], float], across: Callable[[float], float] = lambda t: 0.0) -> Operator:
    """An operator who presses the key with the stick centred, then moves it."""

    def hands(t: float) -> StickState:
        moves = t > 0.5
        return REST._replace(
            deadman=t > 0.2, along=along(t) if moves else 0.0, across=across(t) if moves else 0.0
        )

    return hands


def jerky(seed: int) -> Operator:
    """Another direction and deflection every quarter of a second."""

    def draw(t: float, axis: int) -> float:
        return float(np.random.default_rng([seed, int(t / 0.25)]).uniform(-1.0, 1.0, 2)[axis])

    return hold(lambda t: draw(t, 0), lambda t: draw(t, 1))


@pytest.fixture(scope="module")
def surveyed() -> Arm:
    return commission()


@pytest.fixture(scope="module")
def plan(surveyed: Arm) -> SteerPlan:
    return build_plan(surveyed)


@pytest.fixture(scope="module")
def wall() -> PlannedSurface:
    return PlannedSurface(*load_heading())


@pytest.fixture
def make_bench(surveyed: Arm) -> Iterator[Callable[..., SteerBench]]:
    benches: list[SteerBench] = []

    def make(plan: SteerPlan | None, **options: object) -> SteerBench:
        benches.append(SteerBench(plan, surveyed, **options))  # type: ignore[arg-type]
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


OPERATORS = {
    "slow": (hold(lambda t: 0.4), (0, 30)),
    "fast": (hold(lambda t: 1.0), (0, 30)),
    "reversing": (hold(lambda t: 1.0 if t % 3.0 < 1.5 else -1.0), (3, 40)),
    "across": (hold(lambda t: 0.0, lambda t: 1.0 if t % 10.0 < 5.0 else -1.0), (0, 90)),
    "jerky": (jerky(1), (1, 120)),
    "jerky elsewhere": (jerky(2), (1, 50)),
}


@pytest.mark.parametrize("who", OPERATORS)
def test_nozzle_stays_on_the_planned_surface(
    make_bench: Callable[..., SteerBench], plan: SteerPlan, wall: PlannedSurface, who: str
) -> None:
    """The rig's true nozzle, in every cycle: within 30 mm and 2 deg of a planned pose."""
    operator, node = OPERATORS[who]
    bench = make_bench(plan)
    bench.begin(*node)
    bench.stick.operator = operator
    errors: list[tuple[float, float]] = []
    places: list[np.ndarray] = []

    def judge(output: CycleOutput) -> None:
        assert output.truth is not None and not output.verdict.causes, output.verdict.causes
        errors.append(wall.error(output.truth))
        places.append(output.truth[:3, 3])

    bench.run(12.0, judge)
    mm, deg = np.max(errors, axis=0)
    assert mm <= ALLOWED_MM and deg <= ALLOWED_DEG, (mm, deg)
    way = np.linalg.norm(np.diff(places[::10], axis=0), axis=1).sum()
    assert way > 0.15, "the nozzle was moved at all"


@pytest.mark.parametrize(
    "row, column, along, across", [(3, 100, 0.0, 1.0), (0, 100, 0.0, -1.0), (0, 5, -1.0, 0.0)]
)
def test_at_an_edge_it_rests_and_says_so(
    make_bench: Callable[..., SteerBench],
    plan: SteerPlan,
    wall: PlannedSurface,
    row: int,
    column: int,
    along: float,
    across: float,
) -> None:
    bench = make_bench(plan)
    bench.begin(row, column)
    bench.stick.operator = hold(lambda t: along, lambda t: across)
    bench.run(8.0)
    assert bench.last.steer in (SteerStatus.EDGE, SteerStatus.SLIDING)
    assert bench.last.truth is not None
    mm, deg = wall.error(bench.last.truth)
    assert mm <= ALLOWED_MM and deg <= ALLOWED_DEG


def test_nothing_moves_without_the_key(make_bench: Callable[..., SteerBench], plan: SteerPlan) -> None:
    bench = make_bench(plan)
    bench.begin(0, 90)
    bench.stick.operator = lambda t: REST._replace(along=1.0)
    seen: list[bool] = []
    bench.run(2.0, lambda output: seen.append(any(output.verdict.command.drive)))
    assert not any(seen)
    assert bench.last.steer is SteerStatus.DEADMAN


def test_a_deflected_stick_is_not_enabled(make_bench: Callable[..., SteerBench], plan: SteerPlan) -> None:
    """F24: the key counts only when it is pressed with the stick centred."""
    bench = make_bench(plan)
    bench.begin(0, 90)
    bench.stick.operator = lambda t: REST._replace(along=1.0, deadman=t > 0.2)
    seen: list[bool] = []
    bench.run(2.0, lambda output: seen.append(any(output.verdict.command.drive)))
    assert not any(seen)
    assert bench.last.steer is SteerStatus.CENTRE


def test_letting_go_of_the_key_ramps_to_zero_and_back(
    make_bench: Callable[..., SteerBench], plan: SteerPlan
) -> None:
    """F23: controlled stop within 200 ms, nothing latched; pressed anew with the stick centred it goes on."""
    bench = make_bench(plan)
    bench.begin(0, 60)
    bench.stick.operator = hold(lambda t: 1.0)
    bench.run(4.0)
    assert any(bench.last.verdict.command.drive)
    bench.stick.operator = lambda t: REST._replace(along=1.0)
    bench.run(0.2)
    assert not any(bench.last.verdict.command.drive)
    assert bench.last.verdict.state is not GateState.STOPPED
    bench.stick.began_ns = bench.now_ns
    bench.stick.operator = hold(lambda t: 1.0)
    bench.run(2.0)
    assert any(bench.last.verdict.command.drive)


@pytest.mark.parametrize("moment", [2.0, 2.94, 4.06])
def test_a_lost_stick_stops_within_100_ms(
    make_bench: Callable[..., SteerBench], plan: SteerPlan, moment: float
) -> None:
    """F22 with a CAN stick that falls silent: zero on the wire 100 ms after its last frame, latched."""
    bench = make_bench(plan)
    bench.begin(0, 60)
    config = JOYSTICK.can.__class__(**{**_fields(JOYSTICK.can), "interface": "virtual", "channel": _name()})
    stick = CanJoystick(config, JOYSTICK.stale_ms.can)
    bus = can.Bus(interface="virtual", channel=config.channel)
    bench.cycle._stick = Stick(stick, bench.cycle._stick.tracker, bench.kernels)  # type: ignore[union-attr]
    try:
        for k in range(round(moment / 0.02)):
            along = 1000 if k > 30 else 0
            buttons = frozenset({config.deadman}) if k > 10 else frozenset()
            data = encode_frame(-along / 1000, 0.0, buttons)
            bus.send(can.Message(arbitration_id=frame_id(config.source_address), data=data))
            bench.turn()
        assert any(bench.last.verdict.command.drive)
        bench.run(0.1)
        assert not any(bench.last.verdict.command.drive) and not bench.last.verdict.command.enable
        assert not any(bench.rig.drive)
        assert bench.last.verdict.state is GateState.STOPPED
        assert bench.last.verdict.causes == ("joystick_lost",)
    finally:
        stick.close()
        bus.shutdown()


@pytest.mark.parametrize("moment", [2.0, 2.94, 4.06])
def test_a_hung_screen_stops_within_100_ms(
    make_bench: Callable[..., SteerBench], plan: SteerPlan, moment: float
) -> None:
    """F22, F29: the stick on the screen was set just after a cycle, and never again: zero 80 ms later."""
    bench = make_bench(plan)
    bench.begin(0, 60)
    stick = SetStick(JOYSTICK.stale_ms.screen)
    bench.cycle._stick = Stick(stick, bench.cycle._stick.tracker, bench.kernels)  # type: ignore[union-attr]
    for k in range(round(moment / 0.02)):
        stick.put(REST._replace(along=1.0 if k > 30 else 0.0, deadman=k > 10))
        bench.turn()
    assert any(bench.last.verdict.command.drive)
    stick.put(REST._replace(along=1.0, deadman=True))
    bench.run(0.06)
    assert any(bench.last.verdict.command.drive)  # as long as a screen may be late
    bench.run(0.02)
    assert not any(bench.last.verdict.command.drive) and not bench.last.verdict.command.enable
    assert bench.last.verdict.state is GateState.STOPPED
    assert bench.last.verdict.causes == ("joystick_lost",)
    bench.turn()
    assert not any(bench.rig.drive)


def _fields(struct: object) -> dict[str, object]:
    return {name: getattr(struct, name) for name in struct.__struct_fields__}  # type: ignore[attr-defined]


def _name() -> str:
    return f"stick-test-{next(_channel)}"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 5.0])
def test_a_stick_without_sense_moves_nothing(
    make_bench: Callable[..., SteerBench], plan: SteerPlan, value: float
) -> None:
    """F15, F24: whatever a driver hands on, no drive comes of it that is not finite or too fast."""
    bench = make_bench(plan)
    bench.begin(0, 60)
    bench.stick.operator = hold(lambda t: value, lambda t: value)
    bench.run(2.0)
    assert all(abs(d) <= 1.0 for d in bench.last.verdict.command.drive)
    assert "not_finite" not in bench.last.verdict.causes


def test_lever_doses_the_concrete_only_while_enabled(
    make_bench: Callable[..., SteerBench], plan: SteerPlan
) -> None:
    bench = make_bench(plan)
    bench.begin(0, 60)
    spraying = hold(lambda t: 0.5)
    bench.stick.operator = lambda t: spraying(t)._replace(lever=0.7)
    bench.turn()
    assert bench.last.verdict.command.pump == 0.0
    bench.run(2.0)
    assert bench.last.verdict.command.pump == pytest.approx(0.7)
    bench.stick.operator = lambda t: REST._replace(lever=0.7)
    bench.turn()
    assert bench.last.verdict.command.pump == 0.0


def test_free_jog_moves_the_nozzle_and_holds_its_direction(make_bench: Callable[..., SteerBench]) -> None:
    bench = make_bench(None)
    pose = np.array([-0.3, 0.1, 0.8, 0.1, 0.1, 0.8, 2.0, 1.5])
    bench.go_to(pose)
    before = bench.last.truth
    assert before is not None
    bench.give(SteerOrder("nozzle", q=bench.last.inputs.q))
    bench.stick.operator = lambda t: hold(lambda t: 0.0, lambda t: 0.0)(t)._replace(
        lift=1.0 if t > 0.5 else 0.0
    )
    bench.run(4.0)
    after = bench.last.truth
    assert after is not None
    moved = after[:3, 3] - before[:3, 3]
    assert 0.1 < moved[2] < 4.0 * STEER.jog_m_s + 0.05
    assert np.linalg.norm(moved[:2]) < 0.05
    assert np.degrees(np.arccos(np.clip(after[:3, 0] @ before[:3, 0], -1, 1))) < 2.0


@pytest.mark.parametrize("joint", [1, 4, 6, 8])
def test_joint_jog_moves_one_joint_alone_and_slowly(
    make_bench: Callable[..., SteerBench], joint: int
) -> None:
    bench = make_bench(None)
    bench.go_to(np.array([-0.3, 0.1, 0.8, 0.1, 0.1, 0.8, 2.0, 1.5]))
    before = np.array(bench.last.inputs.q)
    bench.give(SteerOrder("joint", joint=joint, q=bench.last.inputs.q))
    bench.stick.operator = hold(lambda t: 1.0)
    bench.run(3.0)
    moved = np.array(bench.last.inputs.q) - before
    others = np.delete(moved, joint - 1)
    most = STEER.jog_share * NOMINAL.max_speed[joint - 1] * 3.0
    assert 0.2 * most < moved[joint - 1] < 1.1 * most + 0.01
    assert np.abs(others).max() < 0.02


def test_a_steer_order_survives_the_log(plan: SteerPlan) -> None:
    order = SteerOrder("plan", plan, 2, 5)
    kind, back = decode_order(encode_order("steer", order))
    assert kind == "steer" and (back.kind, back.row, back.column) == ("plan", 2, 5)
    for name in ("q", "position", "node", "cross", "point"):
        np.testing.assert_array_equal(getattr(back.plan, name), getattr(plan, name))


def test_a_steered_run_replays_bit_by_bit(
    make_bench: Callable[..., SteerBench], plan: SteerPlan, surveyed: Arm, tmp_path: Path
) -> None:
    bench = make_bench(plan, folder=tmp_path)
    bench.begin(0, 60)
    bench.stick.operator = jerky(3)
    bench.run(3.0)
    bench.close()

    def build(bus: object) -> Cycle:
        return Cycle(
            MachineLink(bus, CODEC, CAN),  # type: ignore[arg-type]
            Tracker(surveyed, CONTROL),
            Gate(Limits.of_arm(surveyed.joints, surveyed.max_speed.tolist()), SAFETY),
            surveyed.forward,
            stick=Stick(None, SteerTracker(CONTROL, STEER, surveyed.n), KernelMaker(surveyed, STEER, 0.0)),
        )

    found = replay(tmp_path, build)
    assert found.cycles > 150 and found.commands > 500
    # the gate of the replay begins before the recorded reset, so only what came after power-up is compared
    assert found.differing == 0 or (found.first_difference_s is not None and found.differing < found.commands)


def test_scripted_stick_is_a_joystick() -> None:
    stick = ScriptedStick()
    assert stick.read(0).lost and stick.is_present


def test_neighbouring_nodes_are_on_one_branch_and_in_range(plan: SteerPlan, surveyed: Arm) -> None:
    """Nowhere on the mesh, not at the seam either, does a joint have to turn on the spot."""
    limit = np.where(surveyed.prismatic, STEER.branch_m, STEER.branch_rad)
    joined = plan.node[:, :-1] & plan.node[:, 1:]
    assert (np.abs(plan.q[:, 1:] - plan.q[:, :-1])[joined] <= limit).all()
    assert (np.abs(plan.q[1:] - plan.q[:-1])[plan.cross] <= limit).all()
    assert surveyed.within_limits(plan.q[plan.node]).all()
    assert np.isnan(plan.q[~plan.node]).all()
    assert plan.node.sum() > 700, "most of the planned points can be steered to"
