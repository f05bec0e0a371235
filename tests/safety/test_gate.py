"""The gate: states, reaction times, and the invariant in every cycle of random histories."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_machine import CONFIG_SAFETY, JOINTS, LIMITS, MIDDLE, Bench, moving

from ascrcp.core.clock import CYCLE_NS
from ascrcp.core.event import EVENTS, Reaction
from ascrcp.core.machine_io import NEVER_NS, Command
from ascrcp.safety.gate import GateState

NAN = math.nan


def changed(index: int, value: float) -> tuple[float, ...]:
    return tuple(value if j == index else q for j, q in enumerate(MIDDLE))


def test_power_up_moves_nothing_until_reset_and_start():
    bench = Bench()
    for _ in range(3):
        verdict = bench.cycle(moving(0.5), start=True)
        assert verdict.causes[0] == "power_up" and verdict.latched
        assert not any(verdict.command.drive) and not verdict.command.enable
    bench.cycle(reset=False)
    assert bench.cycle(moving(0.5), reset=True).state is GateState.READY
    assert not any(bench.cycle(moving(0.5)).command.drive)
    assert bench.cycle(moving(0.5), start=True).state is GateState.ARMED
    assert bench.run(10, moving(0.5)).command.drive == (0.5,) * JOINTS


def test_reset_and_start_held_from_before_are_no_edges():
    bench = Bench()
    for _ in range(5):
        assert bench.cycle(moving(0.5), reset=True, start=True).state is GateState.STOPPED
    bench.cycle()
    assert bench.cycle(reset=True, start=True).state is GateState.READY  # one press, one step
    assert bench.cycle(reset=True, start=True).state is GateState.READY


FAULTS = {
    "F1 stale": ("joint_stale", {"age_ns": (NEVER_NS,) * JOINTS}),
    "F1 stale one": ("joint_stale", {"age_ns": (0,) * 7 + (61_000_000,)}),
    "F3 F4 corrupt frames": ("bad_frames", {"bad_frames": 5}),
    "F6 out of range": ("joint_range", {"in_range": (True,) * 7 + (False,)}),
    "F6 missing joint": ("joint_stale", {"q": MIDDLE[:7]}),
    "F13 beyond limit": ("joint_limit", {"q": changed(0, math.radians(91.1))}),
    "F13 lance inclination": ("joint_limit", {"q": changed(1, math.radians(82.0))}),
    "F15 NaN measured": ("not_finite", {"q": changed(3, NAN)}),
    "F20 pressed": ("estop", {"estop": True}),
    "F20 unknown": ("estop_stale", {"estop_age_ns": 61_000_000}),
    "F25 heartbeat": ("controller_stale", {"controller_age_ns": 61_000_000}),
    "F30 bus": ("bus_error", {"bus_ok": False}),
}


@pytest.mark.parametrize("code, change", FAULTS.values(), ids=FAULTS.keys())
def test_fault_zeroes_the_same_cycle_latches_and_needs_reset_then_start(code, change):
    bench = Bench().arm()
    if code == "joint_limit":  # standing just inside, so that it is no jump
        change = dict(change)
        target = change["q"]
        for step in range(1, 200):
            bench.q = tuple(a + (b - a) * step / 200 for a, b in zip(MIDDLE, target, strict=True))
            bench.cycle(moving(0.0))
    bench.run(10, moving(0.4, 0.0))
    verdict = bench.cycle(moving(0.4, 0.0, pump=0.5, air=True), **change)
    assert code in verdict.active and verdict.causes[0] == verdict.active[0]
    assert verdict.reaction == EVENTS[code].reaction >= Reaction.PROTECT
    assert verdict.command == Command(drive=(0.0,) * JOINTS)
    for _ in range(
        4 * (code != "joint_limit")
    ):  # reset held or pressed while the cause is there does nothing
        assert bench.cycle(moving(0.4), reset=True, start=True, **change).latched
        assert bench.cycle(moving(0.4), **change).latched
    bench.q = MIDDLE
    verdict = bench.run(40, moving(0.4))
    assert (
        verdict.latched
        and not verdict.active
        and verdict.causes[0] == code
        and not any(verdict.command.drive)
    )
    assert not any(bench.cycle(moving(0.4), reset=True).command.drive)
    assert not any(bench.cycle(moving(0.4)).command.drive)
    assert any(bench.cycle(moving(0.4), start=True).command.drive)


def test_f1_stale_value_is_off_the_wire_within_four_cycles():
    bench = Bench().arm()
    bench.run(10, moving(0.5))
    last_frame = bench.t_ns
    verdict = bench.cycle(moving(0.5), age_ns=(CYCLE_NS, *([0] * 7)))
    while any(verdict.command.drive):
        age = bench.t_ns + CYCLE_NS - last_frame
        verdict = bench.cycle(moving(0.5), age_ns=(age, *([0] * 7)))
    assert (bench.t_ns - last_frame) // CYCLE_NS <= 4


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["drive", "pump", "accelerator", "pan_target", "error"])
def test_f15_not_finite_request_is_refused_the_same_cycle(bad, field):
    bench = Bench().arm()
    bench.run(5, moving(0.5))
    if field == "drive":
        verdict = bench.cycle(moving(0.1, 0.2, bad, 0.3))
    elif field == "error":
        verdict = bench.cycle(moving(0.5), error_q=(bad,) * JOINTS)
    else:
        verdict = bench.cycle(moving(0.5, **{field: bad}))
    assert verdict.active == ("not_finite",) and verdict.command == Command(drive=(0.0,) * JOINTS)


def test_f15_request_for_other_joints_is_refused():
    bench = Bench().arm()
    assert bench.cycle(Command(drive=(0.1,) * 7, enable=True)).active == ("not_finite",)


def test_f7_one_jump_is_held_two_are_a_fault():
    bench = Bench().arm()
    bench.run(5, moving(0.2))
    assert bench.cycle(moving(0.2), q=changed(2, 1.3)).state is GateState.ARMED
    assert bench.cycle(moving(0.2)).state is GateState.ARMED
    bench.cycle(moving(0.2), q=changed(2, 1.3))
    verdict = bench.cycle(moving(0.2), q=changed(2, 1.3))
    assert verdict.active == ("joint_jump",) and not any(verdict.command.drive)
    bench.q = changed(2, 1.3)  # steady at the new value: after a while that value counts
    assert bench.run(20, moving(0.2)).active == ("joint_jump",)
    assert bench.run(20, moving(0.2)).active == ()
    assert bench.cycle(reset=True).state is GateState.READY


def test_f7_wild_values_stay_a_fault_and_the_fastest_real_motion_is_none():
    bench = Bench().arm()
    for k in range(20):
        verdict = bench.cycle(q=changed(2, 0.1 + 1.5 * (k % 3) / 2))
        assert k < 2 or verdict.latched
    assert verdict.causes == ("joint_jump",)
    bench = Bench().arm()
    for _ in range(40):
        bench.q = tuple(q + v * 0.02 for q, v in zip(bench.q, LIMITS.max_speed, strict=True))
        if bench.q[2] > 1.8 or bench.q[1] + bench.q[3] > 1.2:
            break
        assert bench.cycle().state is GateState.ARMED


def test_f11_following_error_stops_and_keeps_twice_protects():
    bench = Bench().arm()
    bench.run(10, moving(0.5))
    small = (math.radians(1.9),) + (0.0,) * 7
    for _ in range(20):
        assert bench.cycle(moving(0.5), error_q=small).state is GateState.ARMED
    large = (math.radians(4.5),) + (0.0,) * 7
    drives = []
    for _ in range(20):
        verdict = bench.cycle(moving(0.5, pump=0.5), error_q=large)
        drives.append(verdict.command.drive[0])
    assert verdict.state is GateState.READY and not verdict.latched
    assert verdict.causes == ("following_error",)
    assert drives.index(0.0) <= 4 + 10 and drives[4] == pytest.approx(0.4)
    assert verdict.command.pump == 0.0
    assert bench.cycle(moving(0.5), start=True).state is GateState.ARMED
    far = (math.radians(12.5),) + (0.0,) * 7
    for _ in range(5):
        verdict = bench.cycle(moving(0.5), error_q=far)
    assert "following_far" in verdict.active and verdict.latched


def test_controlled_stop_reaches_zero_within_ten_cycles_from_full_drive():
    bench = Bench().arm()
    bench.run(20, moving(1.0))
    bench.t_ns += 2 * CYCLE_NS + 30_000_000  # one cycle far too late (F28)
    verdict = bench.cycle(moving(1.0, pump=1.0))
    assert verdict.causes == ("cycle_late",) and verdict.command.pump == 0.0
    cycles = 1
    while any(verdict.command.drive):
        assert verdict.state is GateState.STOPPING
        verdict = bench.cycle(moving(1.0))
        cycles += 1
    assert cycles <= 10 and verdict.state is GateState.READY


def test_f28_five_late_cycles_in_fifty_stop_and_one_is_counted():
    bench = Bench().arm()
    for late in range(5):
        bench.run(3, moving(0.2))
        bench.t_ns += 15_000_000
        verdict = bench.cycle(moving(0.2))
        assert ("cycle_slow" in verdict.active) == (late < 4)
    assert verdict.state is GateState.STOPPING and verdict.causes == ("cycle_late",)


def test_motion_that_has_ended_is_not_taken_up_again_without_a_start():
    bench = Bench().arm()
    bench.run(10, moving(0.5, pump=0.5))
    idle = Command(drive=(0.0,) * JOINTS)
    verdict = bench.cycle(idle)
    assert verdict.state is GateState.STOPPING and not verdict.causes and verdict.command.pump == 0.0
    assert bench.run(10, idle).state is GateState.READY and not bench.sent.enable
    assert not any(bench.run(10, moving(0.5)).command.drive)
    assert any(bench.cycle(moving(0.5), start=True).command.drive)


def test_next_motion_may_start_while_the_last_one_comes_to_rest_but_not_out_of_a_controlled_stop():
    bench = Bench().arm()
    bench.run(10, moving(0.5))
    bench.cycle(Command(drive=(0.0,) * JOINTS))
    assert bench.cycle(moving(0.5), start=True).state is GateState.ARMED
    bench.run(10, moving(0.5))
    bench.t_ns += 50_000_000
    assert bench.cycle(moving(0.5)).state is GateState.STOPPING
    assert bench.cycle(moving(0.5), start=True).state is GateState.STOPPING


def test_f42_suspend_protects():
    bench = Bench().arm()
    bench.t_ns += 2_000_000_000
    assert "suspended" in bench.cycle(moving(0.2)).active


def test_f26_controller_that_contradicts_is_stopped():
    bench = Bench().arm()
    bench.run(5, moving(0.2))
    for _ in range(3):
        verdict = bench.cycle(moving(0.2), controller_enabled=False)
    assert verdict.active == ("controller_mismatch",) and verdict.latched
    bench = Bench().arm()
    bench.run(5, moving(0.2))
    for _ in range(3):
        verdict = bench.cycle(moving(0.2), controller_tripped=True)
    assert verdict.active == ("controller_mismatch",)


def test_f21_estop_release_moves_nothing():
    bench = Bench().arm()
    bench.run(5, moving(0.3))
    assert bench.cycle(moving(0.3), estop=True).reaction is Reaction.ESTOP
    assert bench.run(50, moving(0.3)).latched


def test_f12_outward_is_blocked_at_the_soft_limit_inward_is_free():
    bench = Bench().arm()
    bench.q = changed(2, 1.9 + 0.0065)
    bench.gate._jump._good = list(bench.q)
    verdict = bench.run(20, moving(0.0, 0.0, 0.5, 0.0))
    assert verdict.command.drive[2] == 0.0 and verdict.active == ("soft_limit",)
    assert verdict.state is GateState.ARMED and verdict.reaction is Reaction.WARN
    verdict = bench.run(20, moving(0.0, 0.0, -0.5, 0.0))
    assert verdict.command.drive[2] == -0.5 and verdict.active == ()


@pytest.mark.parametrize("joint", [0, 2, 4, 5, 6, 7])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_f12_full_drive_toward_a_limit_stops_short_of_the_hard_one(joint, sign):
    """A joint 30 % faster than nominal that answers 0.1 s late stays within the hard limit."""
    bench = Bench().arm()
    drives = [0.0] * 5
    request = moving(*(sign * (j == joint) for j in range(JOINTS)))
    for _ in range(3000):
        verdict = bench.cycle(request)
        assert verdict.state is GateState.ARMED, verdict.causes
        drives = [*drives[1:], verdict.command.drive[joint]]
        speed = 1.3 * LIMITS.max_speed[joint] * drives[0]
        bench.q = tuple(q + speed * 0.02 * (j == joint) for j, q in enumerate(bench.q))
    assert bench.sent.drive[joint] == 0.0 or abs(bench.sent.drive[joint]) <= CONFIG_SAFETY.dead_band + 0.01


def test_f13_recovery_is_inward_only_and_slow():
    bench = Bench()
    out = changed(0, math.radians(92.0))
    bench.q = out
    assert "joint_limit" in bench.cycle().causes
    bench.cycle(reset=True)
    bench.cycle(moving(1.0), start=True)
    assert bench.gate.state is GateState.ARMED
    verdict = bench.run(20, moving(1.0))
    assert verdict.command.drive[0] == 0.0
    assert all(0.0 <= d <= 0.1 for d in verdict.command.drive)
    assert bench.run(20, moving(-1.0)).command.drive == (-0.1,) * JOINTS
    bench.q = MIDDLE
    bench.gate._jump._good = list(MIDDLE)
    assert bench.run(20, moving(-1.0)).command.drive == (-1.0,) * JOINTS
    bench.q = out
    bench.gate._jump._good = list(out)
    assert "joint_limit" in bench.cycle(moving(-1.0)).active


def test_pan_head_scans_in_ready_and_not_while_stopped():
    bench = Bench()
    request = Command(drive=(0.0,) * JOINTS, pan_target=0.3)
    assert bench.cycle(request).command.pan_target is None
    assert bench.cycle(request, reset=True).command.pan_target == 0.3


def test_values_as_old_as_allowed_are_fresh():
    bench = Bench().arm()
    old = {"age_ns": (60_000_000,) * JOINTS, "estop_age_ns": 60_000_000, "controller_age_ns": 60_000_000}
    for _ in range(5):
        assert bench.cycle(moving(0.2), **old, bad_frames=4).active == ()


def test_f28_gaps_up_to_the_limits_are_in_time():
    for gap_ms, causes in (
        (30, ()), (31, ("cycle_slow",)), (60, ("cycle_slow",)), (61, ("cycle_late",)), (0, ("cycle_late",)),
        (1000, ("cycle_late",)), (1001, ("suspended", "cycle_late")),
    ):  # fmt: skip
        bench = Bench().arm()
        bench.t_ns += (gap_ms - 20) * 1_000_000
        assert bench.cycle(moving(0.2)).active == causes


def test_f7_limit_is_twice_the_largest_speed_and_noise_per_new_value():
    room = 2.0 * LIMITS.max_speed[2] * 0.02 + CONFIG_SAFETY.jump_noise_mm * 1e-3
    for share, jumps in ((0.99, False), (1.01, True)):
        bench = Bench().arm()
        bench.cycle(moving(0.0))
        bench.q = changed(2, 1.0 + share * room)
        first = bench.cycle(moving(0.0))
        bench.q = changed(2, 1.0 + 2.5 * share * room)
        second = bench.cycle(moving(0.0))
        assert not first.active and ("joint_jump" in second.active) == jumps


def test_f7_one_jumped_frame_shown_again_is_still_one():
    bench = Bench().arm()
    for cycle in range(3):
        age = (0, 0, CYCLE_NS * cycle, 0, 0, 0, 0, 0)
        assert bench.cycle(moving(0.0), q=changed(2, 1.5), age_ns=age).active == ()


def test_f7_value_after_a_gap_may_have_moved_as_far_as_the_gap_allows():
    bench = Bench().arm()
    for cycle in range(1, 4):
        bench.cycle(moving(0.0), age_ns=(0, 0, CYCLE_NS * cycle, 0, 0, 0, 0, 0))
    bench.q = changed(2, 1.0 + 2.0 * LIMITS.max_speed[2] * 0.06)
    for _ in range(3):
        assert bench.cycle(moving(0.0)).active == ()


def test_f7_new_steady_value_counts_exactly_after_it_has_settled():
    bench = Bench().arm()
    bench.q = changed(2, 1.5)
    active = [bool(bench.cycle(moving(0.0)).active) for _ in range(40)]
    first = CONFIG_SAFETY.jump_count - 1
    assert active == [False] * first + [True] * CONFIG_SAFETY.jump_settle + [False] * (39 - 25 - first + 1)


def test_f13_one_jumped_value_is_not_believed():
    bench = Bench().arm()
    assert bench.cycle(moving(0.0), q=changed(2, 2.5)).active == ()


def test_sprayed_things_flow_only_while_armed():
    bench = Bench().arm()
    request = moving(0.2, pump=0.5, accelerator=1.5, air=True)
    command = bench.cycle(request).command
    assert (command.pump, command.accelerator, command.air) == (0.5, 1.0, True)
    assert not bench.cycle(moving(0.2)).command.air
    bench.t_ns += 50_000_000
    command = bench.cycle(request).command
    assert any(command.drive) and (command.pump, command.accelerator, command.air) == (0.0, 0.0, False)


values = st.one_of(
    st.floats(-1.5, 1.5), st.sampled_from([0.0, 1.0, -1.0, NAN, math.inf]), st.floats(allow_nan=True)
)
healthy_drive = st.floats(-1.5, 1.5)
step = st.fixed_dictionaries(
    {"drive": st.one_of(healthy_drive, healthy_drive, healthy_drive, values)},
    optional={
        "reset": st.booleans(),
        "start": st.booleans(),
        "stop": st.sampled_from([False, False, False, True]),
        "fault": st.sampled_from([None] * 12 + list(FAULTS)),
        "enable": st.sampled_from([True, True, True, False]),
        "gap_ms": st.sampled_from([20] * 8 + [25, 40, 70, 1500, 0]),
        "error_deg": st.sampled_from([0.0, 1.0, 5.0, 20.0, NAN]),
        "cycles": st.integers(1, 12),
    },
)


@settings(max_examples=150, deadline=None)
@given(st.lists(step, max_size=40))
def test_g4_invariant_in_every_cycle_of_random_histories(history):
    bench = Bench()
    last = (0.0,) * JOINTS
    may_move = False
    bench.cycle()
    bench.cycle(reset=True)
    bench.cycle(start=True)
    for item in history:
        request = Command(drive=(item["drive"],) * JOINTS, enable=item.get("enable", True), pump=0.5)
        change = FAULTS[item["fault"]][1] if item.get("fault") else {}
        for _ in range(item.get("cycles", 1)):
            bench.t_ns += (item.get("gap_ms", 20) - 20) * 1_000_000
            buttons = {k: item[k] for k in ("reset", "start", "stop") if k in item}
            error = (math.radians(item["error_deg"]),) + (0.0,) * 7 if "error_deg" in item else None
            verdict = bench.cycle(request, error_q=error, **buttons, **change)
            command = verdict.command
            hard = [c for c in verdict.active if EVENTS[c].reaction >= Reaction.PROTECT]
            may_move = verdict.state in (GateState.ARMED, GateState.STOPPING)
            assert all(abs(d) <= 1.0 for d in command.drive)
            assert 0.0 <= command.pump <= 1.0
            if any(command.drive):
                assert may_move or last != (0.0,) * JOINTS  # the last step of a controlled stop
                assert command.enable and not hard and not verdict.latched
                assert not change or "q" in change  # one jumped value is held, not believed
                for d, was, ramp in zip(command.drive, last, CONFIG_SAFETY.ramp, strict=True):
                    assert abs(d - was) <= ramp * (1 + 1e-6)
            if hard or verdict.latched:
                assert command == Command(drive=(0.0,) * JOINTS)
            if command.pump:
                assert verdict.state is GateState.ARMED
            last = command.drive


def test_every_code_the_gate_names_is_in_the_table():
    named = {code for code, _ in FAULTS.values()} | {
        "power_up", "operator_stop", "joint_jump", "following_error", "following_far", "cycle_late",
        "cycle_slow", "suspended", "controller_mismatch", "soft_limit", "not_finite",
    }  # fmt: skip
    assert named <= set(EVENTS)


def test_gate_is_deterministic():
    def play() -> list:
        bench = Bench().arm()
        return [bench.cycle(moving(math.sin(k / 7))).command for k in range(300)]

    assert play() == play()
