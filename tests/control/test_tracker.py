"""The tracker on the test plant, through the gate: thesis fig. 5-2 and its 100 mm, 5 deg rule."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from arc import arc_sequence
from plant import Plant, PlantSettings
from run import CONTROL, run

from ascrcp.control.judge import Outcome, PointJudge, TipError
from ascrcp.control.move import plan_move
from ascrcp.control.tracker import Tracker
from ascrcp.core.errors import ConfigError, InputError
from ascrcp.kinematics.arm import load_arm

ARM = load_arm("kc")
ARC = arc_sequence(ARM)
SHORT = arc_sequence(ARM, from_deg=60.0, to_deg=90.0)
SETTINGS = {
    "nominal": PlantSettings(),
    "gain +30 %": PlantSettings(gain=1.3),
    "gain -30 %": PlantSettings(gain=0.7),
    "dead band 8 %": PlantSettings(dead_band=(0.08,) * 8),
    "dead band 3 %": PlantSettings(dead_band=(0.03,) * 8),
    "lag 150 ms": PlantSettings(lag_s=0.15),
    "all fast": PlantSettings(gain=1.3, lag_s=0.15, frequency_hz=(4.0,) * 8, dead_band=(0.03,) * 8),
    "all weak": PlantSettings(
        gain=0.7, lag_s=0.15, frequency_hz=(4.0,) * 8, dead_band=(0.08,) * 8, stiction=0.05
    ),
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS.keys())
def test_arc_is_sprayed_within_100_mm_and_5_deg(settings):
    result = run(ARM, Plant(tuple(ARC.q[0]), settings), ARC)
    assert result.out.state == "finished", result.out.reason
    assert result.out.reached == (ARC.point >= 0).sum() and result.out.skipped == 0
    assert max(result.mm) < 60.0 and max(result.deg) < 1.5
    assert np.mean(result.mm) < 15.0
    assert result.cycles * 0.02 < ARC.duration * 1.15 + CONTROL.tracker.settle_s
    assert not any("following_error" in causes for causes in result.causes)


def test_same_inputs_give_bit_identical_commands():
    a, b = (run(ARM, Plant(tuple(SHORT.q[0])), SHORT) for _ in range(2))
    assert a.drives == b.drives and a.out.reached == b.out.reached > 0


def test_pump_runs_only_while_spraying():
    tracker = Tracker(ARM, CONTROL)
    plant = Plant(tuple(SHORT.q[0]))
    rows = len(SHORT.t)
    thin = replace(SHORT, flow=0.4 * SHORT.flow)
    dry = replace(SHORT, spraying=np.zeros(rows, bool), flow=np.zeros(rows))
    for sequence, most in ((SHORT, 1.0), (thin, 0.4), (dry, 0.0)):
        tracker.follow(sequence)
        seen = []
        for _ in range(100):
            out = tracker.update(plant.inputs())
            plant.step(out.command)
            seen.append(out.command.pump)
            assert out.command.air == (out.command.pump > 0.0)
            assert out.command.accelerator == CONTROL.tracker.accelerator * out.command.pump
        assert max(seen) <= most and (max(seen) > 0.5 * most) == (most > 0.0) and seen[0] == 0.0
        tracker.hold()
        assert tracker.update(plant.inputs()).command.pump == 0.0
        plant = Plant(tuple(SHORT.q[0]))


def test_joint_that_does_not_move_fails_the_run_and_names_itself():
    def stick(_k, plant, _tracker):
        plant.q[1] = SHORT.q[0, 1]

    start = plan_move(ARM, SHORT.q[0], SHORT.q[0] + [0, 0.1, 0, 0, 0, 0, 0, 0], CONTROL)
    result = run(ARM, Plant(tuple(SHORT.q[0])), start, stick)
    assert result.out.state == "failed" and "boom pitch" in result.out.reason


def test_reference_waits_for_an_arm_that_is_held_and_goes_on():
    kept: list[float] = []

    def hold_slew(k, plant, _tracker):
        if 150 <= k < 300:
            kept.append(plant.q[0])
            plant.q[0] = kept[0]

    plain = run(ARM, Plant(tuple(SHORT.q[0])), SHORT)
    result = run(ARM, Plant(tuple(SHORT.q[0])), SHORT, hold_slew)
    assert result.out.state == "finished", result.out.reason
    assert result.cycles > plain.cycles + 60
    assert max(result.mm) < 350.0 and result.out.reached + result.out.skipped == plain.out.reached


def test_pause_keeps_the_place_and_resume_goes_on():
    times = []

    def pause(k, _plant, tracker):
        if k == 150:
            tracker.pause()
        if k in (200, 299):
            times.append(tracker.time_s)
        if k == 300:
            tracker.resume()

    plain = run(ARM, Plant(tuple(SHORT.q[0])), SHORT)
    result = run(ARM, Plant(tuple(SHORT.q[0])), SHORT, pause)
    assert times[0] == times[1] > 0.0
    assert result.out.state == "finished" and result.out.reached == plain.out.reached


def test_hold_then_follow_from_the_kept_place():
    plant = Plant(tuple(SHORT.q[0]))
    tracker = Tracker(ARM, CONTROL)
    tracker.follow(SHORT)
    for _ in range(200):
        plant.step(tracker.update(plant.inputs()).command)
    tracker.hold()
    out = tracker.update(plant.inputs())
    assert out.state == "hold" and not out.command.enable and not any(out.command.drive)
    place = tracker.time_s
    for _ in range(50):
        plant.step(tracker.update(plant.inputs()).command)
    tracker.follow(SHORT, place)
    before = tracker.update(plant.inputs())
    assert before.state == "follow" and before.progress == pytest.approx(place / SHORT.duration)
    for _ in range(2000):
        out = tracker.update(plant.inputs())
        if out.state != "follow":
            break
        plant.step(out.command)
    assert out.state == "finished"
    outcomes = list(tracker.outcome.values())
    assert outcomes[0] is Outcome.PENDING and outcomes[-1] is Outcome.REACHED


def test_sequence_that_begins_elsewhere_is_refused_without_moving():
    result = run(ARM, Plant(tuple(SHORT.q[0] + [0.2, 0, 0, 0, 0, 0, 0, 0])), SHORT)
    assert result.out.state == "failed" and "slew" in result.out.reason
    assert not np.any(result.drives)


def test_machine_that_is_not_enabled_is_not_run_away_from():
    tracker = Tracker(ARM, CONTROL)
    plant = Plant(tuple(SHORT.q[0]))
    tracker.follow(SHORT)
    for _ in range(600):
        out = tracker.update(plant.inputs())  # the command goes nowhere
        if out.state == "failed":
            break
    assert out.state == "failed" and "not enabled" in out.reason and tracker.time_s == 0.0


def test_measurement_that_is_no_number_is_never_driven_on():
    tracker = Tracker(ARM, CONTROL)
    plant = Plant(tuple(SHORT.q[0]))
    tracker.follow(SHORT)
    for _ in range(50):
        plant.step(tracker.update(plant.inputs()).command)
    broken = replace(plant.inputs(), q=(*plant.inputs().q[:3], float("nan"), *plant.inputs().q[4:]))
    out = tracker.update(broken)
    assert not any(out.command.drive) and not out.command.enable


def test_without_a_sequence_it_holds():
    out = Tracker(ARM, CONTROL).update(Plant((0.0,) * 8).inputs())
    assert out.state == "hold" and np.isnan(out.position).all() and not out.command.enable


def test_point_is_reached_waited_for_skipped_or_failed():
    judge = PointJudge([(1.0, 0), (2.0, 1), (3.0, 2)], CONTROL.tracker)
    tolerance, safe = judge.tolerance[0], CONTROL.tracker.safe_mm * 1e-3
    near, far, unsafe = (TipError(d, 0.0) for d in (0.9 * tolerance, 0.9 * safe, 2.0 * safe))
    judge.update(0.5, near)
    assert judge.point == 0 and judge.reached == 0
    judge.update(1.0, near)
    assert judge.reached == 1 and judge.point == 1
    cycles = 0
    while judge.skipped == 0:
        judge.update(2.0, far)
        cycles += 1
    assert cycles == pytest.approx(CONTROL.tracker.settle_s / 0.02, abs=2)
    for _ in range(cycles + 5):
        judge.update(3.0, unsafe)
    assert judge.failure and judge.outcome == {0: Outcome.REACHED, 1: Outcome.SKIPPED, 2: Outcome.PENDING}


def test_wrong_arm_and_wrong_instant_are_refused():
    tracker = Tracker(ARM, CONTROL)
    with pytest.raises(InputError):
        tracker.follow(replace(SHORT, q=SHORT.q[:, :7]))
    with pytest.raises(InputError):
        tracker.follow(SHORT, SHORT.duration + 1.0)
    with pytest.raises(ConfigError):
        Tracker(load_arm("muck"), CONTROL)


def test_resume_after_a_hold_goes_on_at_the_kept_place():
    plant = Plant(tuple(SHORT.q[0]))
    tracker = Tracker(ARM, CONTROL)
    tracker.follow(SHORT)
    for k in range(2000):
        if k == 200:
            tracker.hold()
            place = tracker.time_s
        if k == 230:
            assert tracker.time_s == place > 0.0
            tracker.resume()
        out = tracker.update(plant.inputs())
        plant.step(out.command)
        if out.state in ("finished", "failed"):
            break
    assert out.state == "finished" and out.reached == (SHORT.point >= 0).sum()


def test_far_joint_of_the_coupled_pair_waits_for_the_near_one():
    q = SHORT.q[0]
    off = replace(Plant(tuple(q)).inputs(), controller_enabled=True)
    for offset, far_moves in (([0, -0.045, 0, -0.045], False), ([0, 0.0, 0, -0.045], True)):
        tracker = Tracker(ARM, CONTROL)
        tracker.follow(replace(SHORT, q=np.tile(q, (len(SHORT.t), 1))))
        measured = tuple(q + np.array([*offset, 0, 0, 0, 0]))
        for _ in range(20):
            out = tracker.update(replace(off, q=measured))
        assert (out.command.drive[3] != 0.0) == far_moves
        assert (out.command.drive[1] != 0.0) == (not far_moves)


@pytest.mark.parametrize("off_deg, state", [(1.0, "finished"), (2.5, "failed")])
def test_end_that_does_not_settle_is_accepted_only_when_close(off_deg, state):
    tracker = Tracker(ARM, CONTROL)
    q = SHORT.q[0]
    tracker.follow(plan_move(ARM, q, q, CONTROL))
    stuck = q + np.radians([off_deg] + [0.0] * 7)
    inputs = replace(Plant(tuple(stuck)).inputs(), controller_enabled=True)
    for _ in range(300):
        out = tracker.update(inputs)
    assert out.state == state and ("slew" in out.reason) == (state == "failed")


def test_point_missed_beyond_safe_fails_the_run():
    def stick(_k, plant, _tracker):
        plant.q[4] = SHORT.q[0, 4] + 0.02

    slack = msgspec.structs.replace(CONTROL.tracker, stall_s=60.0, slow_to=50.0, slow_from=40.0)
    tracker = Tracker(ARM, msgspec.structs.replace(CONTROL, tracker=slack))
    plant = Plant(tuple(SHORT.q[0]))
    tracker.follow(SHORT)
    for k in range(3000):
        stick(k, plant, tracker)
        out = tracker.update(plant.inputs())
        if out.state != "follow":
            break
        plant.step(out.command)
    assert out.state == "failed" and "planned point" in out.reason
