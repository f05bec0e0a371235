"""The rig, the whole control cycle and an operator who is a function of time, in lockstep."""

import math
from collections.abc import Callable
from itertools import count, pairwise
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from ascrcp.app import load_simulation
from ascrcp.control.config import ControlConfig
from ascrcp.control.move import plan_move
from ascrcp.control.steer_config import load_steer_config
from ascrcp.control.steer_plan import SteerPlan, build_steer_plan
from ascrcp.control.steer_tracker import SteerTracker
from ascrcp.control.tracker import Tracker
from ascrcp.core.clock import CYCLE_NS, CYCLE_S
from ascrcp.core.config import load
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import angle_between
from ascrcp.core.paths import CONFIG
from ascrcp.devices.bus import Bus
from ascrcp.devices.codec import Codec
from ascrcp.devices.joystick import StickState
from ascrcp.devices.machine_link import DBC, MachineLink, load_can_config
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.safety.config import SafetyConfig
from ascrcp.safety.gate import Gate
from ascrcp.safety.limit import Limits
from ascrcp.session.cycle import Cycle, CycleOutput, Stick
from ascrcp.session.recorder import Recorder
from ascrcp.session.steering import KernelMaker, SteerOrder
from ascrcp.simulation.rig import Rig

NOMINAL = load_arm("kc")
CODEC, CAN = Codec(DBC), load_can_config()
CONTROL = load(CONFIG / "control" / "kc.yaml", ControlConfig)
SAFETY = load(CONFIG / "safety.yaml", SafetyConfig)
STEER = load_steer_config()
DATA = Path(__file__).resolve().parents[1] / "data" / "steered_heading.npz"
ALLOWED_MM, ALLOWED_DEG = 30.0, 2.0
REACH_M = 0.08
_channel = count()


def commission(seed: int = 1) -> Arm:
    """The arm with the sag a survey of the rig finds: eight poses at rest, true nozzle against model.

    The rig bends by another law than the platform's first guess, and a machine is surveyed before it
    sprays (docs/calibration.md); without it 20 mm of the 30 would go into the crown's sag.
    """
    _, sequence = load_heading()
    rows = np.linspace(0, len(sequence.q) - 1, 8).astype(int)
    sag = NOMINAL.description.sag
    assert sag is not None
    reach, drop = [], []
    bench = SteerBench(None, arm=NOMINAL, seed=seed)
    for q in sequence.q[rows]:
        bench.go_to(q)
        bench.run(2.0)
        rigid = NOMINAL.forward(bench.rig.true_q())
        reach.append(math.hypot(rigid[0, 3], rigid[1, 3]))
        drop.append(float(rigid[2, 3] - bench.last.truth[2, 3]))
    bench.close()
    exponent, scale = np.polyfit(np.log(reach), np.log(drop), 1)
    own_mm = 1e3 * math.exp(scale) * sag.reference_reach**exponent
    found = msgspec.structs.replace(sag, own_mm=own_mm, exponent=float(exponent))
    return Arm(msgspec.structs.replace(NOMINAL.description, sag=found))


def load_heading() -> tuple[SprayPath, JointSequence]:
    """Planned points of a short simulated heading, and their joints: one row a point, 1 s apart."""
    with np.load(DATA) as file:
        a = {name: file[name] for name in file.files}
    path = SprayPath(
        position=a["path_position"],
        theta2=a["theta2"],
        theta3=a["theta3"],
        station=a["station"],
        angle=a["angle"],
        bay=a["bay"].astype(np.int64),
        pass_index=a["pass_index"].astype(np.int64),
        overbreak=a["overbreak"],
        R_base_tunnel=a["R_base_tunnel"],
    )
    sequence = JointSequence(
        t=np.arange(len(a["q"]), dtype=float),
        q=a["q"],
        position=a["position"],
        direction=a["direction"],
        point=a["point"].astype(np.int64),
        spraying=np.zeros(len(a["q"]), bool),
    )
    return path, sequence


class PlannedSurface:
    """What the nozzle should stay on: every pass and the strips between neighbours, finely sampled.

    Built from the planned points alone, without the code under test.
    """

    def __init__(self, path: SprayPath, sequence: JointSequence) -> None:
        index = sequence.point
        places, aims = [], []
        rows = {}
        for number in np.unique(path.pass_index[index]):
            at = np.flatnonzero((path.pass_index[index] == number) & ~path.overbreak[index])
            if len(at) > 20:
                order = at[np.argsort(path.angle[index[at]])]
                angle = np.linspace(path.angle[index[order[0]]], path.angle[index[order[-1]]], 2000)
                known = path.angle[index[order]]
                row = [
                    np.stack([np.interp(angle, known, c) for c in values[order].T], 1)
                    for values in (sequence.position, sequence.direction)
                ]
                rows[float(path.station[index[at]].mean())] = (angle, *row)
        ordered = [rows[key] for key in sorted(rows)]
        for (angle, p, d), (other, p2, d2) in pairwise(ordered):
            low, high = max(angle[0], other[0]), min(angle[-1], other[-1])
            grid = np.linspace(low, high, 2000)
            for share in np.linspace(0.0, 1.0, 40):
                for out, a, b in ((places, p, p2), (aims, d, d2)):
                    first = np.stack([np.interp(grid, angle, c) for c in a.T], 1)
                    second = np.stack([np.interp(grid, other, c) for c in b.T], 1)
                    out.append((1 - share) * first + share * second)
        for _, p, d in ordered:
            places.append(p)
            aims.append(d)
        self._places = np.vstack(places)
        self._tree = cKDTree(self._places)
        aim = np.vstack(aims)
        self._aim = aim / np.linalg.norm(aim, axis=1, keepdims=True)

    def error(self, T: np.ndarray) -> tuple[float, float]:
        """How far a nozzle pose is from the planned pose it is nearest to: [mm] and [deg].

        Nearest by the larger of distance over 30 mm and angle over 2 deg: beside an arch the planned
        direction turns by 15 deg within a few centimetres of the nozzle's way.
        """
        near = np.array(self._tree.query_ball_point(T[:3, 3], REACH_M))
        if not len(near):
            near = np.array([self._tree.query(T[:3, 3])[1]])
        mm = 1e3 * np.linalg.norm(self._places[near] - T[:3, 3], axis=1)
        deg = np.degrees(angle_between(self._aim[near], T[:3, 0]))
        best = int(np.maximum(mm / ALLOWED_MM, deg / ALLOWED_DEG).argmin())
        return float(mm[best]), float(deg[best])


Operator = Callable[[float], StickState]
"""Job time since steering began [s] -> what the hands do."""


class ScriptedStick:
    """A joystick whose operator is a function of time."""

    name = "scripted"
    is_present = True

    def __init__(self) -> None:
        self.operator: Operator = lambda t: StickState()
        self.began_ns = 0

    def read(self, now_ns: int) -> StickState:
        """Return what the operator does now."""
        return self.operator((now_ns - self.began_ns) * 1e-9)

    def close(self) -> None:
        """Nothing is open."""


class SteerBench:
    """Everything from the stick to the true nozzle."""

    def __init__(
        self,
        plan: SteerPlan | None,
        arm: Arm = NOMINAL,
        seed: int = 1,
        load_kg: float = 0.0,
        folder: Path | None = None,
    ) -> None:
        """Args: folder: where everything is recorded from power-up on, None for nowhere."""
        self.recorder = Recorder(folder) if folder is not None else None
        self.channel = channel = f"steer-test-{next(_channel)}"
        self.buses = [Bus(CAN.bus, channel) for _ in range(2)]
        self.rig = Rig(load_simulation(None).rig, NOMINAL, self.buses[0], seed, load_kg, CODEC)
        self.stick = ScriptedStick()
        self.kernels = KernelMaker(arm, STEER, load_kg)
        self.arm = arm
        self.gate = Gate(Limits.of_arm(arm.joints, arm.max_speed.tolist()), SAFETY)
        self.link = MachineLink(self.buses[1], CODEC, CAN)
        self.cycle = Cycle(
            self.link,
            Tracker(arm, CONTROL),
            self.gate,
            lambda q: sagged_forward(arm, np.array(q), load_kg),
            self.rig.true_nozzle,
            Stick(self.stick, SteerTracker(CONTROL, STEER, arm.n), self.kernels),
        )
        self.plan, self.load_kg = plan, load_kg
        self.now_ns = 0
        for k in range(8):
            if k == 5:
                self.cycle.press_reset()
            self.turn()

    def turn(self) -> CycleOutput:
        """One cycle of rig and platform."""
        self.now_ns += CYCLE_NS
        self.rig.step(self.now_ns)
        self.cycle.admit()
        self.last = self.cycle.step(self.now_ns)
        if self.recorder is not None:
            self.recorder.put_cycle(self.last, self.link.received, self.link.sent)
        return self.last

    def run(self, seconds: float, each: Callable[[CycleOutput], None] = lambda output: None) -> None:
        """Many cycles."""
        for _ in range(round(seconds / CYCLE_S)):
            each(self.turn())

    def go_to(self, q: np.ndarray) -> None:
        """Move to a pose and wait."""
        self.cycle.follow(plan_move(self.arm, self.last.inputs.q, q.tolist(), CONTROL))
        self.turn()
        while self.last.track.state == "follow":
            self.turn()
        assert self.last.track.state == "finished", self.last.track.reason

    def begin(self, row: int, column: int) -> None:
        """Go to a node of the plan and give the arm to the stick."""
        assert self.plan is not None
        self.go_to(self.plan.q[row, column])
        self.give(SteerOrder("plan", self.plan, row, column))

    def give(self, order: SteerOrder) -> None:
        """Give the arm to the stick."""
        self.cycle.prepare_steering(order)
        self.cycle.steer(order)
        self.stick.operator = lambda t: StickState(lost=False, reason="")
        self.run(1.0)
        self.stick.began_ns = self.now_ns

    def close(self) -> None:
        """Release the buses, finish the record."""
        if self.recorder is not None:
            self.recorder.close()
        for bus in self.buses:
            bus.close()


def build_plan(arm: Arm = NOMINAL, load_kg: float = 0.0) -> SteerPlan:
    """The steering surface of the test heading."""
    return build_steer_plan(arm, *load_heading(), STEER, load_kg)
