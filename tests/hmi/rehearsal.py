"""A small honest session for the screen's tests: the real state machine, the real arm, no machine.

One `tick` of work is done per snapshot; nothing else moves. The same calls and refusals as the job.
"""

from dataclasses import replace

import numpy as np

from ascrcp.core.errors import RefusedError
from ascrcp.core.event import Reaction
from ascrcp.core.flow import Arch, Axis, Bay, JointSequence, Label, Overbreak, Surface
from ascrcp.core.machine_io import MachineInputs
from ascrcp.core.profile import Arc, Profile
from ascrcp.devices.codec import Codec
from ascrcp.devices.joystick import LOST, StickState
from ascrcp.devices.machine_link import DBC
from ascrcp.kinematics import load_arm
from ascrcp.session import state
from ascrcp.session.alarm_history import AlarmHistory
from ascrcp.session.snapshot import Announcement, Lateness, Scene, Snapshot, WallLayer
from ascrcp.session.state import Finding, JobState, Mode, Refusal, Step

LAYOUTS = tuple(Codec(DBC).by_name.values())
SCAN_POSE = np.array([0.0, np.radians(20), 0.5, np.radians(-10), 0.0, 0.5, np.radians(90), np.radians(120)])


def make_surface(points: np.ndarray, labels: np.ndarray) -> Surface:
    """Return the wall of `make_scene`, with a pocket whose middle nobody has seen."""
    profile = Profile(
        name="round",
        arcs=(Arc(centre=(0.0, 0.0), radius=5.5, start_deg=-10.0, end_deg=190.0),),
        arch_line=-0.22,
        overbreak_line=0.15,
        arch_width=0.2,
        spray_depth=3.0,
    )
    station = np.arange(4.0, 14.0, 0.05)
    along = np.arange(0.0, profile.length, 0.05)
    s, phi = np.meshgrid(station, profile.angle(along), indexing="ij")
    pocket = np.exp(-(((s - 11.6) / 0.5) ** 2) - ((phi - 2.0) / 0.25) ** 2)
    offset = np.where(s < 9.0, -0.22, 0.05 * np.sin(3 * s) * np.cos(5 * phi) + 0.35 * pocket).astype(
        np.float32
    )
    offset[(np.abs(s - 10.6) < 0.2) & (phi < 0.3)] = np.nan
    return Surface(
        axis=Axis(np.zeros(3), np.array([1.0, 0.0, 0.0])),
        profile=profile,
        unsprayed=(9.0, 12.4),
        arches=(Arch(10.5, 0.2, 1.5, (0.0, 180.0)),),
        overbreak=(Overbreak((11.1, 12.1), (98.0, 131.0), 2.1, 0.31, 0.24, 0.97),),
        bays=(Bay((9.0, 10.4), None, 0), Bay((10.6, 12.4), 0, None)),
        station=station,
        along=along,
        offset=offset,
        filled=np.zeros(offset.shape, bool),
        points=points,
        labels=labels,
    )


def make_sequence(path: np.ndarray, direction: np.ndarray, q: np.ndarray) -> JointSequence:
    """Return a slow sway about a pose over all planned points, half a second each."""
    n = len(path)
    sway = 0.2 * np.sin(np.linspace(0.0, 6.0, n))[:, None] * np.ones(len(q))
    every = np.arange(n)
    return JointSequence(0.5 * every, q + sway, path, direction, every, every % 60 != 59)


def make_scene(version: int = 1, points: int = 40_000, seed: int = 0, passes: int = 6) -> Scene:
    """Return a round tunnel with an arch, overbreak, a path of some passes and what hangs on them."""
    rng = np.random.default_rng(seed)
    x, phi = rng.uniform(4.0, 14.0, points), rng.uniform(-0.3, np.pi + 0.3, points)
    labels = np.full(points, Label.SPRAYED, np.uint8)
    labels[x > 9.0] = Label.BAY
    labels[np.abs(x - 10.5) < 0.1] = Label.ARCH
    labels[(np.abs(x - 11.6) < 0.6) & (np.abs(phi - 2.0) < 0.3)] = Label.OVERBREAK
    radius = np.where(labels == Label.ARCH, 5.2, 5.5) + rng.normal(0, 0.03, points)
    wall = np.stack([x, -radius * np.cos(phi), radius * np.sin(phi)], -1).astype(np.float32)
    angle = np.linspace(0.0, np.pi, 60)
    station = np.repeat(np.linspace(9.2, 12.0, passes), len(angle))
    swing = np.concatenate([angle if i % 2 == 0 else angle[::-1] for i in range(passes)])
    path = np.stack([station, -4.3 * np.cos(swing), 4.3 * np.sin(swing)], -1)
    solved = np.ones(len(path), bool)
    solved[100:104] = False
    direction = np.stack([np.zeros(len(path)), -np.cos(swing), np.sin(swing)], -1)
    clearance = np.full(len(path), 0.4)
    clearance[30:40] = 0.11
    surface = make_surface(wall, labels)
    laid = np.maximum(surface.offset + 0.03, 0.0)
    return Scene(
        version, wall, labels, path, np.repeat(np.arange(passes), len(angle)), solved,
        surface=surface, path_direction=direction, clearance=clearance,
        sequence=make_sequence(path, direction, SCAN_POSE),
        predicted=WallLayer(surface.station, surface.along, laid),
    )  # fmt: skip


class Rehearsal:
    """Answers like the session; a step takes `ticks` snapshots."""

    def __init__(self, ticks: int = 6, *, has_joystick: bool = False, fail: Step | None = None) -> None:
        self.arm = load_arm("kc")
        self.job = JobState(has_joystick=has_joystick)
        self.ticks, self.fail = ticks, fail
        self.left = 0
        self.moment = 0
        self.causes: tuple[str, ...] = ("power_up",)
        self.estop = False
        self.stops = 0
        self.closed = 0
        self.site = self
        self.stick = LOST
        self.faults: dict[str, str] = {}
        self.more: dict[str, object] = {}
        self.messages: list[Announcement] = []
        self.drawn = Scene()
        self.history = AlarmHistory()
        self.findings: list[Finding] = []

    def snapshot(self) -> Snapshot:
        self.moment += 1
        self._work()
        n = len(self.arm.joints)
        q = SCAN_POSE + (0.002 * self.moment if self.job.active and self.job.active.moves else 0.0)
        points = len(self.drawn.path)
        self.history.update(0.02 * self.moment, self.causes)
        share = 1.0 - self.left / self.ticks if self.job.active else 0.0
        running = self.job.active is Step.RUN
        point = int(share * (points - 1)) if running else -1
        tip = self.arm.forward(q)
        shown = Snapshot(
            t_s=0.02 * self.moment,
            job=self.job,
            stage=("Working", "正在处理") if self.job.active else ("", ""),
            progress=share,
            remaining_s=float(self.left) if self.job.active else float("nan"),
            announcements=tuple(self.messages[-10:]),
            reaction=Reaction.PROTECT if self.causes else Reaction.LOG,
            causes=self.causes,
            estop=self.estop,
            q=tuple(q.tolist()),
            q_target=tuple((q + 0.01).tolist()),
            drive=(0.25,) * n,
            age_ms=(8.0,) * n,
            tip=tuple(tip[:3, 3].tolist()),
            tip_direction=tuple(tip[:3, 0].tolist()),
            tip_target=tuple((tip[:3, 3] + 0.01).tolist()),
            tip_error_mm=17.3,
            tip_error_deg=0.42,
            point=point,
            points=points,
            reached=max(0, point),
            skipped=0,
            spraying=running,
            oil_temp_c=43.6,
            lateness=Lateness(0.1, 1.2, 2.7, 0),
            realtime_factor=20.4,
            screen_stick=True,
            lockstep=True,
            round_dir="rounds/2026-11-02_round_0042",
            alarms=self.history.alarms,
            inputs=MachineInputs(
                t_ns=20_000_000 * self.moment,
                q=tuple(q.tolist()),
                age_ns=(8_000_000,) * n,
                in_range=(True,) * n,
                estop=self.estop,
                controller_age_ns=9_000_000,
                controller_enabled=running,
                oil_temp_c=43.6,
                pump_flow=0.8 if running else 0.0,
            ),
            frames=tuple((layout.can_id, bytes([self.moment % 256] * layout.length)) for layout in LAYOUTS),
        )
        return replace(shown, **self.more)

    def scene(self) -> Scene:
        return self.drawn

    def refusal(self, step: Step) -> Refusal | None:
        return state.refusal(self.job, step)

    def start(self, step: Step) -> None:
        reason = self.refusal(step)
        if reason is not None:
            raise RefusedError(reason.value[0])
        self.job, self.left = state.start(self.job, step), self.ticks

    def stop(self) -> None:
        self.stops += 1
        self.job = state.end_jog(state.stop(self.job))
        self.causes = self.causes or ("operator_stop",)

    def reset(self) -> None:
        if not self.estop:
            self.causes, self.job = (), state.reset(self.job)

    def cancel(self) -> None:
        self.job = state.abandon(self.job)
        self._announce("Cancelled", "已取消", failure=True)

    def choose_mode(self, mode: Mode) -> None:
        self.job = state.choose_mode(self.job, mode)

    def jog_refusal(self) -> Refusal | None:
        return state.jog_refusal(self.job)

    def start_jog(self, kind: str, joint: int = 0) -> None:
        reason = self.jog_refusal()
        if reason is not None:
            raise RefusedError(reason.value[0])
        self.job = state.start_jog(self.job)

    def leave_area(self) -> None:
        self._announce("Another area", "另一区域")

    def finish_steering(self) -> None:
        self.job = state.end_jog(self.job)

    def put_stick(self, stick: StickState) -> None:
        self.stick = stick
        self.job = replace(self.job, has_joystick=not stick.lost)

    def plant_fault(self, kind: str, frame: str, value: float) -> None:
        self.faults[frame] = kind

    def clear_faults(self) -> None:
        self.faults.clear()
        self.estop = False

    def press_estop(self) -> None:
        self.estop = True

    def release_estop(self) -> None:
        self.estop = False

    def close(self) -> None:
        self.closed += 1

    def _announce(self, en: str, zh: str, failure: bool = False) -> None:
        self.messages.append(Announcement(len(self.messages) + 1, (en, zh), failure))

    def _work(self) -> None:
        step = self.job.active
        if step is None:
            return
        self.left -= 1
        if self.left > 0:
            return
        if step is self.fail:
            self.job = state.abandon(self.job)
            self._announce("No tunnel in the cloud", "点云中无隧道", failure=True)
            return
        if step is Step.RECOGNISE:
            self.drawn = make_scene(self.drawn.version + 1)
        is_led_on = step is Step.RESCAN and self.findings
        self.job = state.finish(self.job, self.findings.pop(0) if is_led_on else Finding.MEASURED)
        self._announce(f"{step.value} done", f"{step.name} 完成")
