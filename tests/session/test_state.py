"""The job's state machine: properties over random event sequences."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from ascrcp.session.state import (
    STEPS,
    Finding,
    JobState,
    Mode,
    Refusal,
    Step,
    abandon,
    choose_mode,
    end_jog,
    finish,
    jog_refusal,
    refusal,
    reset,
    start,
    start_jog,
    stop,
)

READY = JobState(stopped=False)


def do(job: JobState, step: Step) -> JobState:
    assert refusal(job, step) is None
    return finish(start(job, step))


def test_automatic_job_in_the_thesis_order() -> None:
    job = READY
    for step in STEPS:
        job = do(job, step)
    assert Step.RUN in job.done and Step.RECOGNISE in job.done


def test_each_step_names_the_one_it_needs() -> None:
    assert refusal(READY, Step.RECOGNISE) is Refusal.NEEDS_ZERO
    assert refusal(READY, Step.LOAD) is Refusal.NEEDS_RECOGNISE
    assert refusal(READY, Step.GO_TO_START) is Refusal.NEEDS_LOAD
    assert refusal(READY, Step.RUN) is Refusal.NEEDS_GO_TO_START


def test_moving_away_keeps_the_plan_but_not_the_scan_pose() -> None:
    job = READY
    for step in STEPS[:4]:
        job = do(job, step)
    assert Step.ZERO not in job.done and Step.LOAD in job.done
    job = do(job, Step.ZERO)
    assert refusal(job, Step.RUN) is Refusal.NEEDS_GO_TO_START
    assert refusal(job, Step.GO_TO_START) is None


def test_semi_automatic_run_needs_a_joystick() -> None:
    job = choose_mode(READY, Mode.SEMI_AUTOMATIC)
    for step in STEPS[:4]:
        job = do(job, step)
    assert refusal(job, Step.RUN) is Refusal.NEEDS_JOYSTICK
    assert refusal(replace(job, has_joystick=True), Step.RUN) is None


def test_mode_is_kept_while_a_step_is_under_way() -> None:
    job = start(READY, Step.ZERO)
    assert choose_mode(job, Mode.SEMI_AUTOMATIC) == job


EVENTS = st.lists(
    st.one_of(
        st.sampled_from(Step),
        st.sampled_from(Finding),
        st.sampled_from(["finish", "abandon", "stop", "reset"]),
    ),
    max_size=40,
)


@given(EVENTS)
def test_invariants_hold_over_any_history(events: list[object]) -> None:
    job = JobState()
    for event in events:
        if isinstance(event, Step):
            if refusal(job, event) is None:
                job = start(job, event)
        elif isinstance(event, Finding):
            job = finish(job, event)
        else:
            job = {"finish": finish, "abandon": abandon, "stop": stop, "reset": reset}[str(event)](job)
        assert not (job.stopped and job.active is not None), "nothing goes on while stopped"
        if job.active is not None:
            assert job.active not in job.done, "a step under way is not done"
            assert all(refusal(job, step) is not None for step in Step), "one step at a time"
        assert not (job.sprayed and job.covered), "a covered wall waits for no scan"
        if refusal(job, Step.RESCAN) is None:
            assert job.sprayed and Step.ZERO in job.done, (
                "something was laid, and the arm is at the scan pose"
            )
        if Step.GO_TO_START in job.done:
            assert {Step.LOAD, Step.RECOGNISE} <= job.done
        if job.stopped:
            assert all(refusal(job, step) is Refusal.STOPPED for step in Step)


def sprayed() -> JobState:
    job = READY
    for step in STEPS:
        job = do(job, step)
    return job


def test_a_second_scan_is_offered_after_a_run_from_the_scan_pose() -> None:
    job = READY
    for step in STEPS:
        assert refusal(job, Step.RESCAN) is Refusal.NEEDS_RUN
        job = do(job, step)
    assert refusal(job, Step.RESCAN) is Refusal.NEEDS_ZERO
    job = do(job, Step.ZERO)
    assert refusal(job, Step.RESCAN) is None
    assert refusal(replace(job, has_lidar=False), Step.RESCAN) is Refusal.NEEDS_LIDAR


def test_a_second_spraying_is_loaded_and_run_like_the_first_and_scanned_again() -> None:
    job = start(do(sprayed(), Step.ZERO), Step.RESCAN)
    planned = finish(job, Finding.PLANNED)
    assert refusal(planned, Step.RESCAN) is Refusal.NEEDS_RUN, "what it planned comes first"
    assert refusal(planned, Step.RUN) is Refusal.NEEDS_GO_TO_START, "the old sequence is not run again"
    assert refusal(planned, Step.GO_TO_START) is Refusal.NEEDS_LOAD
    for step in (Step.LOAD, Step.GO_TO_START, Step.RUN, Step.ZERO):
        planned = do(planned, step)
    assert refusal(planned, Step.RESCAN) is None


def test_a_covered_wall_is_offered_nothing_more_until_the_next_heading() -> None:
    job = finish(start(do(sprayed(), Step.ZERO), Step.RESCAN), Finding.COVERED)
    assert refusal(job, Step.RESCAN) is refusal(job, Step.LOAD) is Refusal.COVERED
    assert refusal(do(job, Step.RECOGNISE), Step.LOAD) is None


def test_a_scan_that_failed_or_only_measured_may_be_repeated() -> None:
    job = start(do(sprayed(), Step.ZERO), Step.RESCAN)
    assert refusal(do(abandon(job), Step.ZERO), Step.RESCAN) is None
    assert refusal(finish(job, Finding.MEASURED), Step.RESCAN) is None
    halted = reset(stop(job))
    assert refusal(do(halted, Step.ZERO), Step.RESCAN) is None


def test_a_new_heading_has_not_been_sprayed() -> None:
    job = do(do(sprayed(), Step.ZERO), Step.RECOGNISE)
    assert refusal(job, Step.RESCAN) is Refusal.NEEDS_RUN


def test_refusals_speak_both_languages() -> None:
    for reason in Refusal:
        english, chinese = reason.value
        assert english and any("一" <= c <= "鿿" for c in chinese)


def test_each_mode_has_a_start_of_its_own() -> None:
    job = READY
    for step in STEPS[:4]:
        job = do(job, step)
    changed = choose_mode(replace(job, has_joystick=True), Mode.SEMI_AUTOMATIC)
    assert refusal(changed, Step.RUN) is Refusal.NEEDS_GO_TO_START
    assert choose_mode(job, Mode.AUTOMATIC) == job
    assert {Step.LOAD, Step.RECOGNISE} <= changed.done


def test_a_jog_needs_rest_a_reset_and_a_joystick_and_takes_the_start_back() -> None:
    job = READY
    for step in STEPS[:4]:
        job = do(job, step)
    assert jog_refusal(job) is Refusal.JOG_NEEDS_JOYSTICK
    job = replace(job, has_joystick=True)
    assert jog_refusal(job) is None
    assert jog_refusal(start(job, Step.ZERO)) is Refusal.BUSY
    assert jog_refusal(stop(job)) is Refusal.STOPPED
    jogging = start_jog(job)
    assert all(refusal(jogging, step) is Refusal.BUSY for step in STEPS)
    assert choose_mode(jogging, Mode.SEMI_AUTOMATIC) == jogging
    assert not stop(jogging).jogging
    over = end_jog(jogging)
    assert refusal(over, Step.RUN) is Refusal.NEEDS_GO_TO_START
    assert refusal(over, Step.RECOGNISE) is Refusal.NEEDS_ZERO


def test_a_further_scan_given_up_leaves_the_arm_anywhere_but_one_finished_at_the_scan_pose() -> None:
    job = READY
    for step in STEPS:
        job = do(job, step)
    job = start(do(job, Step.ZERO), Step.RESCAN)
    for given_up in (abandon(job), reset(stop(job))):
        assert refusal(given_up, Step.RESCAN) is Refusal.NEEDS_ZERO
        assert refusal(given_up, Step.RECOGNISE) is Refusal.NEEDS_ZERO
    assert Step.RESCAN.moves and refusal(finish(job), Step.RESCAN) is None
