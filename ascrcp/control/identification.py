"""What a joint's drive does: recorded trials (drive -> reading) -> dead band, full speed, delay, creep.

A trial holds one drive from rest and records what the sensor shows. Its steady speed is the slope of
the readings; speeds at several drives lie on a line whose foot is the dead band. The delay is the
one with which the model's readings match the recorded ones best.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ascrcp.control.characteristic import Characteristic
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.errors import InputError

SETTLE_S = 0.4
"""Left out at the beginning of a trial: valve and sensor lag (placeholder: four time constants)."""

DELAYS_S = tuple(0.005 * k for k in range(4, 33))
"""Delays that are tried: 20 to 160 ms."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One joint driven from rest.

    Attributes:
        drive: What was on the wire in each cycle, -1..1.
        reading: The joint as measured at the beginning of each cycle [rad or m].
    """

    drive: tuple[float, ...]
    reading: tuple[float, ...]

    @property
    def level(self) -> float:
        """The drive that was held: the largest."""
        return max(self.drive, key=abs)


def find_speed(trial: Trial) -> float:
    """Find the steady speed of a trial [rad/s or m/s]: slope of the readings while its drive was held."""
    held = [i for i, u in enumerate(trial.drive) if u == trial.level]
    first = held[0] + round(SETTLE_S / CYCLE_S)
    reading = np.array(trial.reading[first : held[-1] + 1])
    if len(reading) < 10:
        raise InputError(f"trial at drive {trial.level:g} is too short to find a speed in")
    t = CYCLE_S * np.arange(len(reading))
    return float(np.polyfit(t, reading, 1)[0])


def fit_line(drives: Sequence[float], speeds: Sequence[float]) -> tuple[float, float]:
    """Fit dead band and full speed of one direction; both as positive numbers.

    Args:
        drives: Drives held, all of one sign, at least two.
        speeds: Steady speeds [rad/s or m/s].

    Returns:
        Dead band 0..0.3 and speed at full drive [rad/s or m/s].

    Raises:
        InputError: Speeds that do not rise with the drive: the joint does not obey.
    """
    u, v = np.abs(np.array(drives)), np.array(speeds) * np.sign(drives)
    moving = v > 0.05 * v.max()
    if moving.sum() < 2 or not v.max() > 0.0:
        raise InputError("the joint does not move with its drive: speeds " + np.array2string(v, precision=4))
    slope, foot = np.polyfit(u[moving], v[moving], 1)
    if not slope > 0.0:
        raise InputError("the joint's speed does not rise with its drive")
    dead = min(0.3, max(0.0, -foot / slope))
    return float(dead), float(slope * (1.0 - dead))


def fit_characteristic(trials: Sequence[Trial]) -> Characteristic:
    """Fit dead bands and full speeds to trials in both directions."""
    rows = [(trial.level, find_speed(trial)) for trial in trials]
    up, down = ([row for row in rows if row[0] * sign > 0.0] for sign in (1.0, -1.0))
    dead_up, full_up = fit_line([u for u, _ in up], [v for _, v in up])
    dead_down, full_down = fit_line([u for u, _ in down], [v for _, v in down])
    return Characteristic(full_up, full_down, dead_up, dead_down)


def fit_delay(trials: Sequence[Trial], characteristic: Characteristic, lag_s: float) -> float:
    """Find the delay from drive to speed [s], the sensor's lag being known.

    Only the strongest trials tell: at a weak drive most of the time goes by in the dead band.
    """
    most = max(abs(trial.level) for trial in trials)
    trials = [trial for trial in trials if abs(trial.level) > 0.6 * most]
    best, best_miss = DELAYS_S[0], math.inf
    for delay in DELAYS_S:
        miss = sum(_miss(trial, characteristic, delay, lag_s) for trial in trials)
        if miss < best_miss:
            best, best_miss = delay, miss
    return best


def _miss(trial: Trial, characteristic: Characteristic, delay: float, lag_s: float) -> float:
    """Sum of squares between recorded and modelled readings, both from where the joint stood."""
    whole, part = int(delay / CYCLE_S), delay / CYCLE_S % 1.0
    drive = np.concatenate([np.zeros(whole + 2), np.array(trial.drive)])
    n = len(trial.drive)
    # the reading at the beginning of cycle k has lived through drives up to that of cycle k - 1
    late = (1.0 - part) * drive[1 : n + 1] + part * drive[:n]
    speed = np.array([characteristic.speed(float(u)) for u in late])
    position = CYCLE_S * np.cumsum(speed)
    share = 1.0 - math.exp(-CYCLE_S / lag_s) if lag_s > 0.0 else 1.0
    shown = np.empty(n)
    state = 0.0
    for k in range(n):
        state += share * (position[k] - state)
        shown[k] = state
    rest = np.array(trial.reading) - trial.reading[0] - shown
    return float((rest * rest).sum())


@dataclass(frozen=True, slots=True)
class Creep:
    """A joint that cannot turn slowly.

    Attributes:
        speed: Speed of its pieces [rad/s or m/s].
        tail_s: Time by which a piece turns longer than it is driven.
    """

    speed: float
    tail_s: float


def fit_creep(pieces: Sequence[tuple[int, float]]) -> Creep:
    """Fit creep speed and tail to pieces at one drive.

    Args:
        pieces: Cycles driven and distance turned [rad or m], of different lengths.

    Raises:
        InputError: Pieces that do not grow with their length.
    """
    t = CYCLE_S * np.array([cycles for cycles, _ in pieces], dtype=float)
    distance = np.array([turned for _, turned in pieces])
    slope, foot = np.polyfit(t, distance, 1)
    if not slope > 0.0:
        raise InputError("longer pieces of motion do not turn the joint farther")
    return Creep(float(slope), float(foot / slope))


def find_start(trials: Sequence[Trial], creep: float, resolution: float) -> float:
    """Find the time from the first drive of a piece to motion [s], the median of some.

    A reading that has changed by more than a step and a half tells that the joint turns; on its way there
    it has crept about one and a quarter.
    """
    times = []
    for trial in trials:
        gone = np.abs(np.array(trial.reading) - trial.reading[0])
        told = np.flatnonzero(gone > 1.4 * resolution)
        if told.size:
            times.append(float(told[0]) * CYCLE_S - 1.25 * resolution / creep)
    if not times:
        raise InputError("pieces of motion do not show in the readings")
    return float(min(0.15, max(CYCLE_S, np.median(times))))
