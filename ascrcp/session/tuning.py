"""Tune a machine: small motions of one joint after the other over the bus -> its control parameters.

Every command passes the gate. A trial ends by itself when the joint has gone far enough, and goes
back by the next one. Joints that turn slowly get a characteristic and a delay, those that stick get
the drive that breaks them away, their creep speed and what a piece turns beyond its drive.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from msgspec import to_builtins

from ascrcp.control.config import ControlConfig, JointConfig
from ascrcp.control.identification import Trial, find_start, fit_characteristic, fit_creep, fit_delay
from ascrcp.control.move import plan_move
from ascrcp.control.tracker import Tracker
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.config import convert
from ascrcp.core.errors import DeviceError
from ascrcp.core.event import EVENTS
from ascrcp.core.machine_io import Command, MachineInputs, neutral
from ascrcp.kinematics.arm import Arm
from ascrcp.safety.gate import Gate, GateState
from ascrcp.session.cycle import Link

LEVELS = (0.10, 0.13, 0.18, 0.25, 0.35)
"""Drives of the trials: the speeds of spraying and somewhat more; dead bands reach 0.08 (design.md 7)."""

TRIAL_S = 3.5
TRAVEL = {"deg": 3.0, "mm": 120.0}
"""A trial ends after so much time or travel (placeholders: 0.6 m at the nozzle at full reach)."""

REST_S = 1.2
"""Between trials: the joint stands, its sensor shows it (placeholder: ten lags)."""

PIECES = (6, 12, 18, 6, 12, 18)
"""Cycles of the pieces from which creep and tail are found, there and back."""

BREAKAWAY_STEP = 0.01
BREAKAWAY_CYCLES = 6
BREAKAWAY_MARGIN = 1.5
"""Drive of a piece over the smallest that moved the joint (placeholder)."""

FAST = (0.6, 0.85)
FAST_CYCLES = 60
"""Trials of joints that stick: well above their creep speed, which hides the characteristic below."""

RESET_CYCLES = 8


class Machine(Protocol):
    """What is tuned, and the time in which it is."""

    @property
    def link(self) -> Link:
        """Its bus."""
        ...

    @property
    def gate(self) -> Gate:
        """What every command passes."""
        ...

    def advance(self) -> int:
        """Let one cycle pass; return its instant [ns]."""
        ...


@dataclass(frozen=True)
class Tuned:
    """What a tuning found.

    Attributes:
        control: The control parameters with it filled in.
        trials: Of each joint, for the pictures.
        duration_s: Machine time it took.
        oil_c: Oil temperature it holds for.
    """

    control: ControlConfig
    trials: dict[int, list[Trial]] = field(repr=False)
    duration_s: float
    oil_c: float


class Tuner:
    """Drives one joint at a time and listens."""

    def __init__(self, machine: Machine, arm: Arm, control: ControlConfig) -> None:
        self._machine = machine
        self._arm = arm
        self._control = control
        self._neutral = neutral(arm.n)
        self._cycles = 0
        self._inputs: MachineInputs | None = None
        self._started = False

    def tune(self, pose: tuple[float, ...], say: Callable[[str], None]) -> Tuned:
        """Go to a pose, try every joint there, fit.

        Args:
            pose: Joints at the middle of the trials [rad, m]; a few degrees around it must be free.
            say: Told which joint is tried.

        Raises:
            DeviceError: The gate stopped the machine.
            InputError: A joint that does not obey its drive.
        """
        for k in range(RESET_CYCLES):
            self._cycle(self._neutral.drive, reset=k == RESET_CYCLES - 3, enable=False)
        self._go_to(pose)
        joints: list[dict[str, Any]] = [to_builtins(joint) for joint in self._control.joints]
        trials: dict[int, list[Trial]] = {}
        for number, config in enumerate(self._control.joints, start=1):
            say(f"joint {number}, {config.name}")
            found, kept = (
                self._stuck(number, config)
                if config.controller == "stick_slip"
                else self._smooth(number, config)
            )
            joints[number - 1] |= found
            trials[number] = kept
        tree = {**to_builtins(self._control), "joints": joints}
        oil_c = self._seen().oil_temp_c
        return Tuned(convert(tree, ControlConfig, "tuned control"), trials, self._cycles * CYCLE_S, oil_c)

    def _smooth(self, number: int, config: JointConfig) -> tuple[dict[str, Any], list[Trial]]:
        """Characteristic and delay of a joint that can be driven gently."""
        travel = TRAVEL[config.unit] * config.si
        kept = []
        for level in LEVELS:
            for sign in (1.0, -1.0):
                kept.append(self._trial(number, sign * level, round(TRIAL_S / CYCLE_S), travel))
                self._rest()
        c = fit_characteristic(kept)
        found = {
            "full_speed": [c.full_up / config.si, c.full_down / config.si],
            "dead_band": [c.dead_up, c.dead_down],
            "delay_s": fit_delay(kept, c, config.lag_s),
            "oil_c": self._seen().oil_temp_c,
        }
        return found, kept

    def _stuck(self, number: int, config: JointConfig) -> tuple[dict[str, Any], list[Trial]]:
        """Breakaway, creep and full speed of a joint that sticks."""
        drive = self._find_breakaway(number, config) * BREAKAWAY_MARGIN
        kept, pieces = [], []
        for k, cycles in enumerate(PIECES):
            trial = self._trial(number, drive if k % 2 else -drive, cycles, np.inf)
            self._rest()
            pieces.append((cycles, abs(self._joint(number) - trial.reading[0])))
            kept.append(trial)
        creep = fit_creep(pieces)
        for level in FAST:
            for sign in (1.0, -1.0):
                kept.append(self._trial(number, sign * level, FAST_CYCLES, np.inf))
                self._rest()
        c = fit_characteristic(kept[len(PIECES) :])
        start_s = find_start(kept[: len(PIECES)], creep.speed, config.resolution * config.si)
        own = to_builtins(config.stick_slip) | {
            "creep": creep.speed / config.si,
            "drive": drive,
            "start_s": start_s,
            "stop_s": max(CYCLE_S, start_s + creep.tail_s),
            "tail_s": creep.tail_s,
        }
        found = {
            "full_speed": [c.full_up / config.si, c.full_down / config.si],
            "dead_band": [c.dead_up, c.dead_down],
            "stick_slip": own,
            "oil_c": self._seen().oil_temp_c,
        }
        return found, kept

    def _find_breakaway(self, number: int, config: JointConfig) -> float:
        """Smallest drive, in steps, whose short pieces move the joint both ways."""
        drive = 0.05
        while drive < 0.5:
            moved = []
            for sign in (1.0, -1.0):
                before = self._joint(number)
                self._trial(number, sign * drive, BREAKAWAY_CYCLES, np.inf)
                self._rest()
                moved.append(abs(self._joint(number) - before))
            if min(moved) > 1.5 * config.resolution * config.si:  # a reading may flip by a step
                return drive
            drive += BREAKAWAY_STEP
        raise DeviceError(f"joint {number}, {config.name}, does not break away below half its drive")

    def _trial(self, number: int, level: float, cycles: int, travel: float) -> Trial:
        """Hold a drive for so long, or until the joint has gone so far."""
        start = self._joint(number)
        drives, readings = [], []
        drive = tuple(level if i == number - 1 else 0.0 for i in range(self._arm.n))
        for _ in range(cycles):
            drives.append(self._cycle(drive)[number - 1])
            readings.append(self._joint(number))  # what was heard before the drive went out
            if not abs(self._joint(number) - start) < travel:
                break
        return Trial(tuple(drives), tuple(readings))

    def _rest(self) -> None:
        for _ in range(round(REST_S / CYCLE_S)):
            self._cycle(self._neutral.drive)

    def _joint(self, number: int) -> float:
        return self._seen().q[number - 1]

    def _seen(self) -> MachineInputs:
        if self._inputs is None:
            raise DeviceError("the machine has not been heard yet")
        return self._inputs

    def _cycle(
        self, drive: tuple[float, ...], *, reset: bool = False, enable: bool = True
    ) -> tuple[float, ...]:
        """Live one cycle under a drive; return what the gate let through."""
        start = enable and not self._started
        self._started = self._started or start
        return self._pass(Command(drive, enable), reset=reset, start=start)

    def _pass(self, command: Command, reset: bool = False, start: bool = False) -> tuple[float, ...]:
        machine = self._machine
        verdict = machine.gate.check(self._listen(), command, reset=reset, start=start)
        machine.link.send(verdict.command)
        if command.enable and verdict.state is not GateState.ARMED:
            cause = EVENTS[verdict.causes[0]].cause[0] if verdict.causes else "the machine is not ready"
            raise DeviceError(f"tuning stopped: {cause}")
        return verdict.command.drive

    def _listen(self) -> MachineInputs:
        self._inputs = self._machine.link.receive(self._machine.advance())
        self._cycles += 1
        return self._inputs

    def _go_to(self, pose: tuple[float, ...]) -> None:
        """Move there under the parameters as they are."""
        tracker = Tracker(self._arm, self._control)
        tracker.follow(plan_move(self._arm, self._seen().q, pose, self._control))
        start = True
        while True:
            inputs = self._listen()
            out = tracker.update(inputs)
            verdict = self._machine.gate.check(inputs, out.command, start=start)
            self._machine.link.send(verdict.command)
            start = False
            if out.state != "follow":
                break
        if out.state != "finished":
            raise DeviceError(f"tuning pose is not reached: {out.reason}")
        for _ in range(RESET_CYCLES):
            self._cycle(self._neutral.drive, enable=False)
        self._started = False
