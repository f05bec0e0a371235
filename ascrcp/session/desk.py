"""What the jobs share: the present plan, the loaded sequence and the place in it, results so far."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ascrcp.control.steer_plan import SteerPlan
from ascrcp.core.errors import InputError
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.session.evaluation import evaluate
from ascrcp.session.outcome import Loaded
from ascrcp.session.remote import Remote
from ascrcp.session.round import Round
from ascrcp.session.state import Finding, Mode
from ascrcp.session.steering import SteerOrder
from ascrcp.session.store import read_json, write_json
from ascrcp.session.trace import TraceCollector

if TYPE_CHECKING:
    from ascrcp.session.session import Session


class Desk:
    """What the jobs share: the loaded sequence, the place in it, times and counts.

    Attributes:
        round: Folder of the present plan: the session's, or after a further scan one inside it.
        around: Folder of the newest scan: what moves keep clear of.
        result: Of the first run, with what came of the further ones.
        runs: Results of all runs of this heading.
        achieved: Figures of all further scans of it.
        finding: What the last of them led to.
    """

    def __init__(self, session: "Session") -> None:
        self.session = session
        self.round = session.round
        self.around = session.round
        self.runs: list[dict[str, Any]] = []
        self.achieved: list[dict[str, Any]] = []
        self.finding = Finding.MEASURED
        self.sequence: JointSequence | None = None
        self.resume_s = 0.0
        self.points = 0
        self.reached = 0
        self.skipped = 0
        self.collector = TraceCollector(session.arm.n)
        self.timing: dict[str, tuple[float, float]] = {}
        self.result: dict[str, Any] = {}
        self.planned = 0
        self.steer_plan: SteerPlan | None = None
        self.steer_node = (0, 0)
        self.left_areas: frozenset[int] = frozenset()

    def nozzle(self, q: Array) -> Array:
        """Nozzle pose the measured joints mean, with the sag of the boom; (8,) -> (4, 4)."""
        setup = self.session.setup
        return sagged_forward(setup.arm, q, setup.payload_kg)

    def load(self, loaded: Loaded) -> None:
        """Keep a checked sequence, to be run from its beginning."""
        self.sequence = loaded.sequence
        self.planned = loaded.planned
        self.steer_plan = None
        self.left_areas = frozenset()
        self.points = int((loaded.sequence.point >= 0).sum())
        self.begin_again()

    def jog(self, kind: Literal["nozzle", "joint"], joint: int) -> None:
        """Make the surroundings known, then give the arm to the stick."""
        session, setup = self.session, self.session.setup
        session.stage("Jog for set-up", "点动调整")
        around = session.run_compute(
            Remote.OBSTACLES, self.around.folder, setup.machine, setup.planning, share=(0.0, 0.0)
        )
        scan = self.name_of(self.around)
        setup.stick.kernels.set_around(around, scan)
        session.run_steering(SteerOrder(kind, joint=joint, q=session.measured_q(), scan=scan))

    def name_of(self, folder: Round) -> str:
        """Name of a folder inside the session's round, empty for the round itself."""
        return "" if folder is self.session.round else folder.folder.name

    def begin_again(self) -> None:
        """Forget the last run: the next starts at the first point."""
        self.resume_s = 0.0
        self.reached = self.skipped = 0
        self._visited: frozenset[int] = frozenset()
        self.collector = TraceCollector(self.session.arm.n)

    def keep_reached(self) -> None:
        """Note which planned points the stick has sprayed at, each once."""
        self._visited |= self.session.setup.stick.tracker.visited
        self.reached = len(self._visited)

    def leave_area(self) -> None:
        """Let the next semi-automatic start lie in another area; once all were left, all count again."""
        plan = self.steer_plan
        if plan is None:
            self.session.announce("Go to the start first.", "请先运动至初始点。", failure=True)
            return
        left = self.left_areas | {int(plan.area[self.steer_node])}
        count = int(plan.area.max()) + 1
        self.left_areas = left if len(left) < count else frozenset()
        self.session.announce(
            f"Step 4 goes to another area ({len(left) % count + 1} of {count}).",
            f"第 4 步将前往另一区域（{len(left) % count + 1}/{count}）。",
        )

    def loaded(self) -> JointSequence:
        """Return the loaded sequence.

        Raises:
            InputError: None is loaded.
        """
        if self.sequence is None:
            raise InputError("no joint sequence is loaded")
        return self.sequence

    def pose_at(self, t_s: float) -> Array:
        """Joints of the loaded sequence at one of its instants, shape (joints,)."""
        sequence = self.loaded()
        return np.array([np.interp(t_s, sequence.t, column) for column in sequence.q.T])

    def keep_place(self) -> None:
        """Note how far the run came, to go on from there after a stop; one that never began keeps its own."""
        if self.session.setup.tracker.sequence is not self.sequence:
            return
        self.resume_s = self.session.setup.tracker.time_s
        track = self.session.track()
        self.reached += track.reached
        self.skipped += track.skipped

    @property
    def is_finished(self) -> bool:
        """Whether the loaded sequence has been run to its end."""
        return self.sequence is not None and self.resume_s >= self.sequence.duration

    @property
    def is_done(self) -> bool:
        """Whether the sequence was run to its end and enough of the planned points were reached."""
        if self.session.snapshot().job.mode is Mode.AUTOMATIC and not self.is_finished:
            return False
        return self.reached >= self.session.setup.report.sprayed_share * self.planned

    def is_exact(self, at: dict[str, Any]) -> bool:
        """Whether enough of the points reached keep the thesis's rule; the stick has none to hit."""
        if self.session.snapshot().job.mode is Mode.SEMI_AUTOMATIC:
            return True
        return int(at["within_rule"]) >= self.session.setup.report.sprayed_share * int(at["count"])

    def timing_s(self, name: str) -> float | None:
        """Time of a stage [s]: machine time where the machine worked, else computing time."""
        if name not in self.timing:
            return None
        wall, machine = self.timing[name]
        return machine if name in ("scan", "run") else wall

    @property
    def realtime_factor(self) -> float | None:
        """Machine time of the run per wall time."""
        wall, machine = self.timing.get("run", (0.0, 0.0))
        return machine / wall if wall > 0.0 else None

    def begin_heading(self) -> None:
        """Forget what was done to the heading scanned before."""
        self.round = self.around = self.session.round
        self.runs, self.achieved, self.result = [], [], {}

    def finish_run(self) -> None:
        """Judge what was collected and write it into the folder of its plan; a resumed run counts once."""
        trace = self.collector.trace()
        self.round.write_trace(trace)
        found = describe_run(self, evaluate(trace))
        name = found["folder"]
        self.runs = [*(run for run in self.runs if run["folder"] != name), found]
        if self.round is not self.session.round:
            write_json(self.round.result, found)
        self.sum_up()

    def sum_up(self) -> None:
        """Write the first run's result with what further scans and runs came to."""
        if not self.runs:
            return  # the disk refused it, and the operator was told
        first, *others = self.runs
        brief = (
            "folder",
            "ok",
            "points",
            "nozzle_error_mm",
            "nozzle_error_deg",
            "predicted",
            "concrete_m3",
            "timing_s",
        )
        self.result = {
            **first,
            "ok": all(run["ok"] for run in self.runs),
            "achieved": self.achieved,
            "resprays": [{key: run[key] for key in brief} for run in others],
            "commands_sha256": self.session.command_digest(),
        }
        write_json(self.session.round.result, self.result)


def describe_run(desk: Desk, judged: dict[str, Any]) -> dict[str, Any]:
    """Summarise the run that has just ended as plain values (design.md section 9)."""
    session = desk.session
    mode = session.snapshot().job.mode.value
    pump = session.setup.planning.process.spray.pump_m3_s
    plan = read_json(desk.round.prediction) if desk.round.prediction.exists() else {}
    return {
        "points": {
            "planned": desk.planned,
            "reached": desk.reached,
            "skipped": desk.skipped,
            "left_out": desk.planned - desk.points,
        },
        "ok": desk.is_done and desk.is_exact(judged["at_points"]),
        "mode": mode,
        "folder": desk.name_of(desk.round),
        **judged,
        "predicted": plan.get("driven"),
        "concrete_m3": {"pumped": desk.collector.pumped_s * pump, "truth": session.setup.concrete()},
        "timing_s": {name: desk.timing_s(name) for name in ("scan", "recognise", "plan", "solve", "run")},
        "lateness_ms": asdict(session.lateness),
        "realtime_factor": desk.realtime_factor,
        "commands_sha256": session.command_digest(),
        "joints": [
            {"number": j.number, "name": j.name, "kind": "prismatic" if j.prismatic else "revolute"}
            for j in session.arm.joints
        ],
    }
