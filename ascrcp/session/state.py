"""The job's state machine, pure: which step may start, and what each event makes of the state.

Thesis 6.1.2: zero joints -> recognise and solve -> load -> go to start -> run, with stop from any
state. The arm's place and the plan are two things: moving the arm away from the scan pose takes
back "zeroed" but keeps a finished plan.
"""

from dataclasses import dataclass, replace
from enum import Enum


class Mode(Enum):
    """Who decides where the nozzle goes (thesis 6.1.2)."""

    AUTOMATIC = "automatic"
    SEMI_AUTOMATIC = "semi_automatic"


class Step(Enum):
    """The five buttons of the thesis, in order, and the one that closes the loop."""

    ZERO = "zero"
    RECOGNISE = "recognise"
    LOAD = "load"
    GO_TO_START = "go_to_start"
    RUN = "run"
    RESCAN = "rescan"

    @property
    def moves(self) -> bool:
        """Whether the arm may move in this step; a further scan looks from a second pose too."""
        return self in (Step.ZERO, Step.GO_TO_START, Step.RUN, Step.RESCAN)


STEPS = (Step.ZERO, Step.RECOGNISE, Step.LOAD, Step.GO_TO_START, Step.RUN)
"""The thesis's job; `RESCAN` leads from its end to the second spraying."""

# a step that starts takes back these, because they are no longer true
_TAKES_BACK = {
    Step.ZERO: {Step.ZERO, Step.GO_TO_START, Step.RUN},
    Step.RECOGNISE: {Step.RECOGNISE, Step.LOAD, Step.GO_TO_START, Step.RUN, Step.RESCAN},
    Step.LOAD: {Step.LOAD, Step.GO_TO_START, Step.RUN},
    Step.GO_TO_START: {Step.ZERO, Step.GO_TO_START, Step.RUN},
    Step.RUN: {Step.GO_TO_START, Step.RUN, Step.RESCAN},
    Step.RESCAN: {Step.ZERO, Step.RESCAN, Step.LOAD, Step.GO_TO_START, Step.RUN},
}
_NEEDS = {
    Step.RECOGNISE: Step.ZERO,
    Step.LOAD: Step.RECOGNISE,
    Step.GO_TO_START: Step.LOAD,
    Step.RUN: Step.GO_TO_START,
    Step.RESCAN: Step.ZERO,
}


class Finding(Enum):
    """What a further scan has led to."""

    MEASURED = "measured"
    """The layer is known; nothing more was asked."""
    PLANNED = "planned"
    """What is too thin is planned and solved: load it next."""
    COVERED = "covered"
    """Enough of the wall is within tolerance, or nothing is left that a spraying could mend."""


@dataclass(frozen=True)
class JobState:
    """Where the job stands.

    Attributes:
        mode: Chosen mode.
        active: The step being worked on, None at rest.
        done: Steps finished and still true.
        stopped: A stop is latched; only reset leads out.
        has_joystick: Whether a joystick is there for the semi-automatic run.
        jogging: Whether the stick jogs the arm for set-up, outside the five steps.
        sprayed: A run has been finished since the wall was last scanned.
        covered: The last scan found nothing that is worth another spraying.
        has_lidar: Whether the wall can be scanned; not where a cloud stands for it.
    """

    mode: Mode = Mode.AUTOMATIC
    active: Step | None = None
    done: frozenset[Step] = frozenset()
    stopped: bool = True
    has_joystick: bool = False
    jogging: bool = False
    sprayed: bool = False
    covered: bool = False
    has_lidar: bool = True


class Refusal(Enum):
    """Why a step may not start now; texts are (English, Chinese)."""

    STOPPED = ("Stopped: remove the cause, press reset.", "请先排除原因并复位。")
    BUSY = ("Another step is still running.", "另一步骤正在进行。")
    NEEDS_ZERO = ("Zero the joints first.", "请先关节归零。")
    NEEDS_RECOGNISE = ("Recognise and solve first.", "请先识别解算。")
    NEEDS_LOAD = ("Load the joint sequence first.", "请先读取数据。")
    NEEDS_GO_TO_START = ("Go to the start first.", "请先运动至初始点。")
    NEEDS_RUN = ("Spray first.", "请先喷射。")
    NEEDS_LIDAR = ("A cloud file cannot be scanned again.", "点云文件无法再次扫描。")
    COVERED = ("Nothing is left to spray again.", "已无需补喷。")
    NEEDS_JOYSTICK = ("No joystick is connected.", "未连接摇杆。")
    JOG_NEEDS_JOYSTICK = ("No joystick is connected for a jog.", "点动需要摇杆；未连接摇杆。")


def refusal(state: JobState, step: Step) -> Refusal | None:
    """Return why a step may not start now, or None if it may."""
    if state.stopped:
        return Refusal.STOPPED
    if state.active is not None or state.jogging:
        return Refusal.BUSY
    if state.covered and step in (Step.LOAD, Step.RESCAN):
        return Refusal.COVERED
    if step is Step.RESCAN and not (state.has_lidar and state.sprayed):
        return Refusal.NEEDS_RUN if state.has_lidar else Refusal.NEEDS_LIDAR
    needed = _NEEDS.get(step)
    if needed is not None and needed not in state.done:
        return Refusal[f"NEEDS_{needed.name}"]
    if step is Step.RUN and state.mode is Mode.SEMI_AUTOMATIC and not state.has_joystick:
        return Refusal.NEEDS_JOYSTICK
    return None


def jog_refusal(state: JobState) -> Refusal | None:
    """Return why the arm may not be jogged now, None if it may."""
    if state.stopped:
        return Refusal.STOPPED
    if state.active is not None or state.jogging:
        return Refusal.BUSY
    return None if state.has_joystick else Refusal.JOG_NEEDS_JOYSTICK


def start_jog(state: JobState) -> JobState:
    """Begin a jog that `jog_refusal` allows: the arm leaves where the steps have brought it."""
    return replace(state, jogging=True, done=state.done - {Step.ZERO, Step.GO_TO_START, Step.RUN})


def end_jog(state: JobState) -> JobState:
    """The jog is over."""
    return replace(state, jogging=False)


def start(state: JobState, step: Step) -> JobState:
    """Begin a step that `refusal` allows."""
    begun = replace(state, active=step, done=state.done - _TAKES_BACK[step])
    return replace(begun, sprayed=False, covered=False) if step is Step.RECOGNISE else begun


def finish(state: JobState, finding: Finding = Finding.MEASURED) -> JobState:
    """The active step has succeeded; `finding` is what a further scan has led to."""
    step = state.active
    if step is None:
        return state
    now = {step, Step.ZERO} if step is Step.RESCAN else {step}  # the look ends where it began
    over = replace(state, active=None, done=state.done | now, sprayed=state.sprayed or step is Step.RUN)
    if step is not Step.RESCAN or finding is Finding.MEASURED:
        return over
    return replace(over, sprayed=False, covered=finding is Finding.COVERED)


def abandon(state: JobState) -> JobState:
    """The active step failed, was cancelled or was stopped in a controlled way."""
    return replace(state, active=None)


def stop(state: JobState) -> JobState:
    """A stop is latched: whatever was going on has ended."""
    return replace(state, active=None, jogging=False, stopped=True)


def reset(state: JobState) -> JobState:
    """The gate has accepted a reset."""
    return replace(state, stopped=False)


def choose_mode(state: JobState, mode: Mode) -> JobState:
    """Change the mode at rest; a step under way keeps its mode. Each mode has a start of its own."""
    if state.active is not None or state.jogging or state.mode is mode:
        return state
    return replace(state, mode=mode, done=state.done - {Step.GO_TO_START, Step.RUN})
