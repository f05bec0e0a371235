"""The session: what the screen and the command line ask of the job, and what they see of it."""

import contextlib
import hashlib
import math
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ascrcp.control.tracker import TrackerOutput
from ascrcp.core.errors import AscrcpError, CancelledError, DefectError, DeviceError, RefusedError
from ascrcp.core.event import EVENTS, Reaction
from ascrcp.session import state
from ascrcp.session.alarm_history import AlarmHistory
from ascrcp.session.compute import Compute
from ascrcp.session.cycle import Cycle, CycleOutput
from ascrcp.session.desk import Desk
from ascrcp.session.driver import LockstepDriver, RealTimeDriver
from ascrcp.session.loop import JOBS
from ascrcp.session.notice import Notices
from ascrcp.session.operation import Operation, StoppedError
from ascrcp.session.recorder import LOCKSTEP_DISK_S, Recorder
from ascrcp.session.remote import Remote
from ascrcp.session.round import Round
from ascrcp.session.scene import change_scene
from ascrcp.session.setup import Setup
from ascrcp.session.snapshot import Lateness, Scene, Snapshot
from ascrcp.session.state import JobState, Mode, Refusal, Step
from ascrcp.session.view import add_machine, estimate_factor, estimate_remaining
from ascrcp.session.wording import say_chinese

COMPUTE_NICENESS = 10  # in real time: below the application (placeholder)
RESET_PATIENCE_S = 0.25  # twice the time in which every sensor is heard


class Session:
    """One job on one machine, from power-up to close. Every public call returns at once."""

    def __init__(self, setup: Setup, round_: Round) -> None:
        self.arm = setup.arm
        self.round = round_
        self.setup, self.site = setup, setup.plant
        self._lock = threading.Lock()
        self._job = JobState(done=frozenset({Step.RECOGNISE} if round_.joints.exists() else ()))
        self._latest: CycleOutput | None = None
        self._reset_over = threading.Event()
        self._notices = Notices()
        self.failure = ""
        self._scene = Scene()
        self._stage = ("", "")
        self._stage_began, self._stage_began_ns = time.monotonic(), 0
        self._causes: tuple[str, ...] = ()
        self._history = AlarmHistory()
        self._digest = hashlib.sha256()
        self._worker: threading.Thread | None = None
        self.compute = Compute(0 if setup.lockstep else COMPUTE_NICENESS)
        round_.note(**setup.manifest)
        self._recorder = Recorder(round_.folder, LOCKSTEP_DISK_S if setup.lockstep else 0.0)
        self._record_failed = self._closing = False
        self._defect: DefectError | None = None
        self.cycle = Cycle(setup.link, setup.tracker, setup.gate, self._tip, setup.truth, setup.stick)
        if setup.lockstep:
            assert setup.plant is not None
            self._driver: LockstepDriver | RealTimeDriver = LockstepDriver(
                self.cycle, self._on_cycle, self._on_defect, setup.plant
            )
        else:
            self._driver = RealTimeDriver(self.cycle, self._on_cycle, self._on_defect, setup.plant)
        self._operation = Operation(self.cycle, setup.lockstep, self._driver.wake)
        self.run_motion, self.run_scan = self._operation.run_motion, self._operation.run_scan
        self.run_steering, self.put_stick = self._operation.run_steering, setup.stick.put
        self.desk = Desk(self)
        self.leave_area = self.desk.leave_area
        self._driver.start()
        threading.Thread(target=self.compute.start, name="ascrcp-warm-up", daemon=True).start()

    def _tip(self, q: tuple[float, ...]) -> np.ndarray:
        return self.desk.nozzle(np.array(q))

    def refusal(self, step: Step) -> Refusal | None:
        """Return why a step may not start now, None if it may."""
        return self._or_busy(state.refusal(self._job_now, step))

    def jog_refusal(self) -> Refusal | None:
        """Return why the arm may not be jogged now, None if it may."""
        return self._or_busy(state.jog_refusal(self._job_now))

    def _or_busy(self, reason: Refusal | None) -> Refusal | None:
        worker = self._worker  # a stopped step's worker may still be on its way out
        return Refusal.BUSY if reason is None and worker is not None and worker.is_alive() else reason

    @property
    def _job_now(self) -> JobState:
        setup = self.setup
        return replace(self._job, has_joystick=setup.stick.is_present, has_lidar=setup.cloud is None)

    def start_jog(self, kind: Literal["nozzle", "joint"], joint: int = 0) -> None:
        """Give the arm to the stick for set-up: the nozzle freely, or one joint; slow, kept clear.

        Args:
            kind: What the stick moves.
            joint: Number from 1, for "joint".

        Raises:
            RefusedError: If the state machine does not allow it now.
        """
        if kind == "joint" and not 1 <= joint <= self.arm.n:
            raise RefusedError(f"joint {joint} cannot be jogged, allowed 1..{self.arm.n}")
        with self._lock:
            reason = self.jog_refusal()
            if reason is not None:
                raise RefusedError(reason.value[0])
            self._job = state.start_jog(self._job)
            self._operation.cancelled.clear()
        self._recorder.put_event(self.t_ns, "step", f"jog {kind} {joint or ''}".strip(), "started")
        self._worker = threading.Thread(
            target=self._jog, args=(kind, joint), name="ascrcp-worker", daemon=True
        )
        self._worker.start()

    def finish_steering(self) -> None:
        """The operator has finished with the stick: the step, or the jog, is done."""
        self._operation.finished.set()
        self._driver.wake()

    def start(self, step: Step) -> None:
        """Begin a step in a worker thread.

        Raises:
            RefusedError: If the state machine does not allow it now.
        """
        with self._lock:
            reason = self.refusal(step)
            if reason is not None:
                raise RefusedError(reason.value[0])
            self._job = state.start(self._job, step)
            self._operation.cancelled.clear()
            self.failure = ""
        self._recorder.put_event(self.t_ns, "step", step.value, "started")
        self._worker = threading.Thread(target=self._work, args=(step,), name="ascrcp-worker", daemon=True)
        self._worker.start()

    def stop(self) -> None:
        """Stop everything from any state; latched until reset."""
        self.cycle.press_stop()
        self._operation.cancelled.set()
        self._driver.wake()

    def reset(self) -> None:
        """Ask the gate to leave the stopped state; a bus whose adapter failed is opened anew first."""
        if "bus_error" in self._causes:
            self.cycle.begin(self._reopen)
        self.cycle.press_reset()
        self._driver.wake()

    def _reopen(self) -> bool:
        """Open the bus anew, in the control thread (fault F33)."""
        try:
            self.setup.reopen()
            self.announce("The CAN bus is open again: press reset.", "CAN 总线已重新打开：请再按复位。")
        except DeviceError as error:
            self.announce(str(error), say_chinese(error), failure=True)
        return False

    def reset_and_wait(self, timeout_s: float) -> None:
        """Press reset until the gate lets go; for the command line, never for the screen.

        The first press may come before every sensor has been heard.

        Raises:
            DeviceError: It did not, with the cause that stands in the way.
            DefectError: The control thread has ended.
        """
        deadline = time.monotonic() + timeout_s
        while self._job.stopped:
            if self._defect is not None:
                raise self._defect
            if time.monotonic() > deadline:
                causes = ", ".join(EVENTS[code].cause[0] for code in self._causes) or "the machine is silent"
                raise DeviceError(f"reset is not accepted: {causes}")
            self.reset()
            self._reset_over.wait(RESET_PATIENCE_S)

    def cancel(self) -> None:
        """Give up the step under way; the arm stops where it is."""
        self._operation.cancelled.set()
        self._driver.wake()

    def choose_mode(self, mode: Mode) -> None:
        """Change the mode at rest."""
        with self._lock:
            self._job = state.choose_mode(self._job, mode)
        self._recorder.put_event(self.t_ns, "request", "mode", mode.value)

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until no step is under way; for the command line, never for the screen."""
        worker = self._worker
        if worker is not None:
            worker.join(timeout_s)

    def close(self) -> None:
        """Stop, end every thread, release the machine; a second call does nothing more."""
        self._closing = True  # this stop is not news to the operator
        self.stop()
        self.wait(5.0)
        self._driver.close()
        self.compute.close()
        self._recorder.close()
        self.setup.close()

    @property
    def t_ns(self) -> int:
        """Job time [ns]."""
        return self._latest.t_ns if self._latest is not None else 0

    def scene(self) -> Scene:
        """Return what the 3-D view draws besides the arm."""
        return self._scene

    @property
    def _elapsed_s(self) -> float:
        """Wall time the active step has taken [s], NaN at rest."""
        return math.nan if self._job.active is None else time.monotonic() - self._stage_began

    def snapshot(self) -> Snapshot:
        """Return the newest picture of the job."""
        output = self._latest
        general = Snapshot(
            t_s=self.t_ns * 1e-9,
            job=self._job_now,
            stage=self._stage,
            progress=self._operation.progress,
            remaining_s=estimate_remaining(output, self._operation.progress, self._elapsed_s),
            announcements=self._notices.lines,
            lateness=self.lateness,
            realtime_factor=estimate_factor((self.t_ns - self._stage_began_ns) * 1e-9, self._elapsed_s),
            simulated=self.setup.plant is not None,
            round_dir=str(self.round.folder),
            points=self.desk.points,
            reached=self.desk.reached,
            skipped=self.desk.skipped,
            lockstep=self.setup.lockstep,
            screen_stick=self.setup.stick.on_screen,
            alarms=self._history.alarms,
            frames=(*self.setup.link.received, *self.setup.link.sent),
        )
        return general if output is None else add_machine(general, output)

    def _on_cycle(self, output: CycleOutput) -> bool:
        """Take in one cycle; return whether something still goes on."""
        self._latest = output
        for _, data in self.setup.link.sent:
            self._digest.update(data)
        self._recorder.put_cycle(output, self.setup.link.received, self.setup.link.sent)
        self._watch_gate(output)
        if self._recorder.failed and not self._record_failed:
            self._record_failed = True
            self.announce(self._recorder.failed, f"运行记录失败：{self._recorder.failed}", failure=True)
        return self._operation.on_cycle(output)

    def _watch_gate(self, output: CycleOutput) -> None:
        verdict = output.verdict
        is_news = "power_up" not in verdict.causes and not self._closing
        if verdict.causes != self._causes:
            self._history.update(output.t_ns * 1e-9, verdict.causes)
            for code in verdict.causes:
                if code not in self._causes:
                    self._recorder.put_event(output.t_ns, "fault", code, EVENTS[code].cause[0])
                    if EVENTS[code].reaction >= Reaction.STOP and is_news:
                        self.announce(*EVENTS[code].cause, failure=True)
            self._causes = verdict.causes
        if verdict.latched and not self._job.stopped:
            with self._lock:
                self._operation.cancelled.set()
                self._job = state.stop(self._job)
            self._reset_over.clear()
        elif not verdict.latched and self._job.stopped:
            with self._lock:
                self._job = state.reset(self._job)
            self._reset_over.set()
            self._recorder.put_event(output.t_ns, "request", "reset", "gate left the stopped state")

    def _on_defect(self, error: Exception) -> None:
        """The control thread has ended: say so, let nobody wait for it."""
        self._defect = DefectError(f"internal error in the control cycle, it has ended: {error!r}")
        with self._lock:
            self._operation.cancelled.set()
            self._job = state.stop(self._job)
        self._operation.fail(self._defect)
        self.announce(str(self._defect), f"控制周期内部错误，已终止：{error!r}", failure=True)
        text = "".join(traceback.format_exception(error))
        self._recorder.put_event(self.t_ns, "defect", "control", text)

    def _work(self, step: Step) -> None:
        self._stage_began, self._stage_began_ns = time.monotonic(), self.t_ns
        self._operation.progress = 0.0
        is_done = self._attempt(step.value, lambda: JOBS[step](self.desk))
        with self._lock:
            if self._job.active is step:
                over = state.finish(self._job, self.desk.finding)
                self._job = over if is_done else state.abandon(self._job)
        self.stage("", "")
        self._recorder.put_event(self.t_ns, "step", step.value, "done" if is_done else "failed")

    def _jog(self, kind: Literal["nozzle", "joint"], joint: int) -> None:
        if self._attempt("jog", lambda: self.desk.jog(kind, joint)):
            self.announce("Jog finished.", "点动结束。")
        with self._lock:
            self._job = state.end_jog(self._job)
        self.stage("", "")

    def _attempt(self, name: str, job: Callable[[], None]) -> bool:
        """Do a worker's job; tell the operator why it failed."""
        try:
            job()
            return True
        except CancelledError:
            self._fail("Cancelled.", "已取消。")
        except StoppedError as error:
            self._fail(f"Stopped: {error}", f"已停止：{error.chinese}")
        except AscrcpError as error:
            self._fail(str(error), say_chinese(error))
            for note in getattr(error, "__notes__", ()):
                self._recorder.put_event(self.t_ns, "defect", name, note)
        except Exception as error:  # noqa: BLE001 - a worker's exception must reach the screen
            self._fail(f"Internal error in {name}: {error!r}", f"内部错误：{error!r}")
            self._recorder.put_event(self.t_ns, "defect", name, traceback.format_exc())
        return False

    def _fail(self, english: str, chinese: str) -> None:
        self.failure = english
        self.announce(english, chinese, failure=True)

    def announce(self, english: str, chinese: str, failure: bool = False) -> None:
        """Tell the operator one line (thesis 6.1.2: every part done is announced)."""
        self._notices.add(english, chinese, failure)
        self._recorder.put_event(self.t_ns, "note", "failure" if failure else "info", english)

    def stage(self, english: str, chinese: str, progress: float = 0.0) -> None:
        """Say what the active step is doing now."""
        self._stage = (english, chinese)
        self._operation.progress = progress

    def track(self) -> TrackerOutput:
        """Return what the tracker said last."""
        if self._latest is None:
            raise DeviceError("the machine has not been heard yet")
        return self._latest.track

    def measured_q(self) -> tuple[float, ...]:
        """Return the joints as measured last, SI; in lockstep once time stands still.

        Raises:
            DeviceError: A joint was never heard.
        """
        self._driver.wait_for_rest()
        q = self._latest.inputs.q if self._latest is not None else (math.nan,) * self.arm.n
        if not all(map(math.isfinite, q)):
            missing = [str(i) for i, x in enumerate(q, start=1) if not math.isfinite(x)]
            raise DeviceError(f"joint sensors {', '.join(missing)} have not been heard yet")
        return q

    @property
    def lateness(self) -> Lateness:
        """How late the control cycle has been."""
        return self._driver.meter.lateness()

    def command_digest(self) -> str:
        """SHA-256 over every command frame sent so far: equal runs in lockstep have equal digests."""
        self._driver.wait_for_rest()
        return self._digest.copy().hexdigest()

    def run_compute(self, stage: Remote, *args: object, share: tuple[float, float]) -> Any:
        """Run a stage in the compute process; its progress fills a share of the step's bar."""
        low, high = share

        def progress(fraction: float) -> None:
            self._operation.progress = low + (high - low) * fraction

        return self.compute.run(
            stage, *args, progress=progress, is_cancelled=self._operation.cancelled.is_set
        )

    def show(self, **parts: Any) -> None:
        """Replace parts of the 3-D scene, named as `change_scene` does."""
        self._scene = change_scene(self._scene, **parts)

    @contextlib.contextmanager
    def stopwatch(self, name: str):  # type: ignore[no-untyped-def]
        """Measure a stage: job time for what moves, wall time for what computes."""
        wall, job = time.perf_counter(), self.t_ns
        yield
        self.desk.timing[name] = (time.perf_counter() - wall, (self.t_ns - job) * 1e-9)
