"""bench control, single joints: random moves of every joint under every controller (thesis 5.1)."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec import to_builtins

from ascrcp.cli.bench import Figure
from ascrcp.cli.cell import Cell
from ascrcp.control.choice import make_controller
from ascrcp.control.config import ControlConfig, JointConfig, PositionConfig
from ascrcp.control.joint import Observer, Want
from ascrcp.control.position import PositionControl
from ascrcp.control.separated import SeparatedControl
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.config import convert
from ascrcp.core.geometry import Array
from ascrcp.core.machine_io import Command
from ascrcp.kinematics.arm import Arm
from ascrcp.simulation.rig import load_rig_config
from ascrcp.simulation.servo import Servo

MOVES = 50
MOVE_S = 20.0
REST_S = 1.0
TRAVEL = {"deg": 25.0, "mm": 350.0}

PRINTED: dict[str, tuple[float, ...]] = {
    "position": (1.0, 0.9, 10.0, 0.8, 9.0, 10.0, 1.0, 1.1),  # table 5-2
    "fuzzy": (0.3, 0.4, 4.0, 0.4, 4.0, 3.0, 1.0, 1.1),  # table 5-6
    "segmented": (0.1, 0.1, 1.0, 0.1, 1.0, 1.0, 0.9, 0.8),  # table 5-8
    "pulsed": (0.1, 0.1, 1.0, 0.1, 1.0, 1.0, 0.2, 0.2),  # table 5-9
    "own": (0.1, 0.1, 1.0, 0.1, 1.0, 1.0, 0.1, 0.1),  # asked
}
TITLES = {
    "position": "classic PID, table 5-2",
    "fuzzy": "fuzzy PID, table 5-6",
    "segmented": "segmented PID, table 5-8",
    "pulsed": "pulsed jog, table 5-9",
    "own": "ours",
}
JOINT_5_MM_PER_DEG = 10.0
"""The thesis gives joint 5 in millimetres of its cylinder: 1 mm = 0.1 deg."""


@dataclass(frozen=True)
class JointRun:
    """Moves of all joints under one controller.

    Attributes:
        shown: Error at rest as the sensors show it, in the tables' units, shape (moves, 8).
        true: The same from the rig's truth.
        settle_s: Time until the joint came to rest for good, shape (moves, 8).
    """

    shown: Array
    true: Array
    settle_s: Array


def choose(config: JointConfig, name: str) -> JointConfig:
    """Give a joint another controller; pulses are for joints that have them."""
    if name == "own":
        return config
    if name == "pulsed" and config.pulse is None:
        name = "segmented"
    tree: dict[str, Any] = {**to_builtins(config), "controller": name, "rides_on": 0}
    return convert(tree, JointConfig, config.name)


def draw_targets(arm: Arm, moves: int, rng: np.random.Generator) -> Array:
    """Draw poses within limits, each a bounded way from the last in every joint, shape (moves + 1, 8)."""
    si = [1e-3 * TRAVEL["mm"] if slides else math.radians(TRAVEL["deg"]) for slides in arm.prismatic]
    middle = 0.5 * (arm.lower + arm.upper)
    middle[3] = 0.0
    poses = [np.where(arm.within_limits(middle), middle, arm.zero_pose)]
    room = 0.05 * (arm.upper - arm.lower)
    while len(poses) <= moves:
        q = poses[-1] + rng.uniform(-1.0, 1.0, arm.n) * si
        if bool(arm.within_limits(q)) and bool(((q > arm.lower + room) & (q < arm.upper - room)).all()):
            poses.append(q)
    return np.array(poses)


def run_moves(arm: Arm, control: ControlConfig, name: str, seed: int, moves: int = MOVES) -> JointRun:
    """Move all joints at once from set-point to set-point under one kind of controller."""
    joints = [choose(joint, name) for joint in control.joints]
    poses = draw_targets(arm, moves, np.random.default_rng([seed, 5]))
    unit = np.array([1.0 / joint.si for joint in joints])
    unit[4] *= JOINT_5_MM_PER_DEG
    start = {
        f"j{i + 1}": {"start": float(q / joint.si)}
        for i, (q, joint) in enumerate(zip(poses[0], joints, strict=True))
    }
    shown, true, settled = [], [], []
    with Cell(load_rig_config({"arm": {"joints": start}}), arm, arm, seed) as cell:
        stand = _Stand(cell, joints)
        for target in poses[1:]:
            settled.append(stand.go(target))
            shown.append(np.abs(np.array(stand.measured) - target) * unit)
            true.append(np.abs(cell.rig.true_q() - target) * unit)
    return JointRun(np.array(shown), np.array(true), np.array(settled))


class _Stand:
    """Eight joint controllers on a machine, without path and gate."""

    def __init__(self, cell: Cell, joints: list[JointConfig]) -> None:
        self._cell = cell
        self._joints = joints
        self._controls = [make_controller(joint) for joint in joints]
        self._observers = [
            Observer(1.0 - math.exp(-CYCLE_S / joint.lag_s) if joint.lag_s > 0.0 else 1.0) for joint in joints
        ]
        for k in range(8):
            self._drive((0.0,) * 8, enable=k > 3)

    @property
    def measured(self) -> tuple[float, ...]:
        """Joints as the sensors show them [rad, m]."""
        return self._inputs.q

    def _drive(self, drive: tuple[float, ...], enable: bool = True) -> None:
        self._inputs = self._cell.link.receive(self._cell.advance())
        self._cell.link.send(Command(drive, enable))

    def go(self, target: Array) -> Array:
        """Go to a set-point; return when each joint came to rest for good [s]."""
        for control in self._controls:
            control.clear()
        for observer in self._observers:
            observer.clear()
        n = len(self._joints)
        moved_at, before = np.zeros(n), self._cell.rig.true_q()
        for k in range(round(MOVE_S / CYCLE_S)):
            drives: list[float] = []
            for i, (control, observer) in enumerate(zip(self._controls, self._observers, strict=True)):
                measured, wanted = self._inputs.q[i], float(target[i])
                base = self._joints[i].rides_on - 1
                carrier = (self._controls[base].position, self._inputs.q[base]) if base >= 0 else (0.0, 0.0)
                error = observer.update(wanted, measured)
                want = Want(wanted, 0.0, 0.0, measured, error, 1.0, False, True, *carrier)
                drives.append(control.drive(want))
            self._drive(tuple(drives))
            now = self._cell.rig.true_q()
            moved_at[np.abs(now - before) > 1e-7] = (k + 1) * CYCLE_S
            before = now
            if (k + 1) * CYCLE_S - moved_at.max() > REST_S:
                break
        return moved_at


def measure_joints(
    arm: Arm, control: ControlConfig, seed: int, say: Callable[[str], None], moves: int = MOVES
) -> list[Figure]:
    """Measure every controller on every joint; prove their order and what is asked of ours."""
    runs = {}
    for name in PRINTED:
        say(f"{moves} moves, {TITLES[name]}")
        runs[name] = run_moves(arm, control, name, seed, moves)
    figures = []
    for name, run in runs.items():
        for i, printed in enumerate(PRINTED[name]):
            unit = "mm" if i in (2, 4, 5) else "deg"
            own = name == "own"
            how = f"mean of {moves} by its sensor; true {run.true[:, i].mean():.2g}"
            how += f", settles in {run.settle_s[:, i].mean():.1f} s"
            how += "" if own else f"; thesis {printed:g}"
            value = float(run.shown[:, i].mean())
            figures.append(
                Figure(f"{TITLES[name]}, joint {i + 1}", value, unit, printed if own else None, note=how)
            )
    figures += _order(runs)
    return figures


def _order(runs: dict[str, JointRun]) -> list[Figure]:
    """Prove the thesis's order, over all joints, and that ours comes to rest no later than its best."""
    scale = np.array(PRINTED["own"])
    mean = {name: float((run.shown.mean(axis=0) / scale).mean()) for name, run in runs.items()}
    found = []
    for worse, better in itertools.pairwise(("position", "fuzzy", "segmented", "pulsed")):
        title = f"{TITLES[better]} over {TITLES[worse]}"
        how = "ratio of mean errors over all joints"
        found.append(Figure(title, mean[better] / mean[worse], "", 1.0, note=how))
    rest = float(runs["own"].settle_s.mean() / runs["pulsed"].settle_s.mean())
    found.append(Figure("ours over pulsed jog, settling", rest, "", 1.0, note="ratio of mean times to rest"))
    return found


def measure_separation(joint: JointConfig) -> list[Figure]:
    """Second paper, figure 10: overshoot of a 5 deg step on the plant of errata 2."""
    tree: dict[str, Any] = {
        **to_builtins(joint),
        "position": to_builtins(PositionConfig(kp=20.0, ti_s=0.5, td_s=0.0, separation=1.0)),
    }
    config = convert(tree, JointConfig, "figure 10")
    figures = []
    for title, kind, printed in (("classic", PositionControl, 21.3), ("separated", SeparatedControl, 2.6)):
        servo = Servo()
        control = kind(config, servo.period_s)
        angles = []
        for _ in range(400):
            servo.advance(control.output(5.0 - servo.angle_deg))
            angles.append(servo.angle_deg)
        over = 100.0 * (max(angles) / 5.0 - 1.0)
        figures.append(
            Figure(f"figure 10, {title} PID, overshoot", over, "%", None, note=f"paper {printed} %")
        )
        figures.append(Figure(f"figure 10, {title} PID, off the paper", abs(over - printed), "points", 1.0))
    return figures
