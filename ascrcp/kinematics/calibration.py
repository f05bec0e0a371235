"""Fit a machine to measured tip positions: Observations -> changed machine, with its honest uncertainty.

The model is the forward model everything else uses, sag included. Misses are weighed by what sensors and
survey cannot resolve, blunders are found by a robust fit and set aside, and what the data leave open is
refused by name (`identifiability.py`). Every row is also predicted by a fit that has not seen it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from ascrcp.core.config import Struct, load
from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.description import ArmDescription
from ascrcp.kinematics.identifiability import FULL_HOSE_KG, Determination, check_determined
from ascrcp.kinematics.misfit import HUBER, Noise, Problem, find_scale, fit
from ascrcp.kinematics.observation import Observations
from ascrcp.kinematics.parameter import (
    GROUPS,
    ExpectedErrors,
    Parameter,
    change_description,
    find_independent,
    list_parameters,
    read_value,
)

SAG_BOUNDS = {"own_mm": (0.0, np.inf), "load_mm_per_kg": (0.0, np.inf), "exponent": (0.0, 5.0)}
"""What the machine file allows."""


class NoGainError(InputError):
    """The machine file predicts a survey as well as any calibration to it would: keep it."""


class CalibrationConfig(Struct):
    """How a calibration judges; config/calibration.yaml says each number's source."""

    noise: Noise
    expected: ExpectedErrors
    undetermined: Annotated[float, Meta(gt=0.0, le=2.0)]
    largest: Annotated[float, Meta(ge=1.0, le=100.0)]
    blunder_sigma: Annotated[float, Meta(ge=3.0, le=20.0)]
    blunder_share: Annotated[float, Meta(ge=0.0, le=0.5)]
    folds: Annotated[int, Meta(ge=2, le=20)]


def load_config() -> CalibrationConfig:
    """Read config/calibration.yaml."""
    return load(CONFIG / "calibration.yaml", CalibrationConfig)


@dataclass(frozen=True)
class Change:
    """One fitted number, in the machine file's unit; sigma is one standard deviation of it."""

    name: str
    unit: str
    before: float
    after: float
    sigma: float


@dataclass(frozen=True)
class Misses:
    """Tip measured less tip computed, shape (n, 3) [m]."""

    vector: Array

    def summary_mm(self) -> dict[str, dict[str, float]]:
        """Mean, 95 % and largest size of x, y, z and of the distance [mm]."""
        sizes = np.column_stack([np.abs(self.vector), np.linalg.norm(self.vector, axis=1)]) * 1e3
        return {
            name: {
                "mean": float(column.mean()),
                "p95": float(np.percentile(column, 95)),
                "max": float(column.max()),
            }
            for name, column in zip(("x", "y", "z", "distance"), sizes.T, strict=True)
        }

    @property
    def mean_mm(self) -> float:
        """Mean distance [mm]."""
        return float(np.linalg.norm(self.vector, axis=1).mean() * 1e3)


@dataclass(frozen=True)
class Calibrated:
    """Outcome of a calibration.

    Attributes:
        description: The machine with lengths and sag changed; sensor zeros apart.
        changes: What was fitted.
        sensor_zero: To be added to the sensors' readings, in all [deg, m], shape (joints,).
        before, after: Misses of the old and the new machine on the rows used.
        held_out: Misses of each row by a fit without it.
        set_aside: Line of the survey and miss [m] of each blunder.
        held: Parameters not fitted, each with its reason.
        noise_ratio: Misses left over the noise assumed; about 1 if the model is right.
    """

    description: ArmDescription
    changes: tuple[Change, ...]
    sensor_zero: Array
    before: Misses
    after: Misses
    held_out: Misses
    set_aside: tuple[tuple[int, float], ...]
    held: dict[str, str]
    noise_ratio: float


def calibrate(
    arm: Arm,
    seen: Observations,
    config: CalibrationConfig,
    groups: Sequence[str] = GROUPS,
    hold: Sequence[str] = (),
) -> Calibrated:
    """Fit sensor zeros, lengths and sag to measured tip positions.

    Args:
        arm: The machine as its file describes it.
        seen: Measured tip positions.
        config: Noise, expected errors, limits of judgement.
        groups: Which of "zeros", "lengths", "sag" to fit.
        hold: Names of parameters to leave as they are.

    Raises:
        InputError: Unknown names, too few rows, a parameter or joint not exercised, data that do not
            belong to this machine.
        NoGainError: A result that predicts no better than the file as it is.
    """
    parameters, held = _choose(arm, config, groups, hold)
    _check_rows(seen, len(parameters), config)
    _check_determined(arm, seen, parameters, config)
    problem = Problem(arm, seen, tuple(parameters), config.noise)
    good = _find_good(problem, config)
    problem = start = problem.pick(good)
    _check_determined(arm, problem.seen, parameters, config)
    x = fit(problem)
    x, problem = _keep_bounds(problem, x, held)
    change = x * problem.scale
    lost = np.flatnonzero(~good)
    everything = Problem(problem.arm, seen, problem.parameters, config.noise)
    misses = np.linalg.norm(everything.miss(x)[lost], axis=1)
    sigma, ratio = _find_sigma(problem, x)
    found = Calibrated(
        description=change_description(problem.arm.description, problem.parameters, change),
        changes=_list_changes(problem, change, sigma),
        sensor_zero=_total_zero(arm, problem.parameters, change),
        before=Misses(start.miss(np.zeros(len(parameters)))),
        after=Misses(problem.miss(x)),
        held_out=Misses(_predict_held_out(problem, config.folds)),
        set_aside=tuple(zip(seen.line[lost].tolist(), misses.tolist(), strict=True)),
        held=held,
        noise_ratio=ratio,
    )
    _judge(found, problem, x, config)
    return found


def _choose(
    arm: Arm, config: CalibrationConfig, groups: Sequence[str], hold: Sequence[str]
) -> tuple[list[Parameter], dict[str, str]]:
    """Pick the parameters to fit, and say of the others why not."""
    everything = list_parameters(arm, config.expected)
    names = [p.name for p in everything]
    for name in hold:
        if name not in names:
            raise InputError(f"no parameter {name!r} to hold; there are {', '.join(names)}")
    for group in groups:
        if group not in GROUPS:
            raise InputError(f"no group {group!r}; there are {', '.join(GROUPS)}")
    wanted = [p for p in everything if p.group in groups and p.name not in hold]
    chosen, dropped = find_independent(arm, wanted, FULL_HOSE_KG)
    if not chosen:
        raise InputError(f"machine {arm.name}: nothing to fit in {', '.join(groups)}")
    held = dict.fromkeys(hold, "held as asked")
    for name, same in dropped.items():
        held[name] = f"does the same as {', '.join(same)}" if same else "does not move the tip"
    return chosen, held


def _check_rows(seen: Observations, parameters: int, config: CalibrationConfig) -> None:
    """Ask for twice as many measured coordinates as parameters in every fold."""
    needed = int(np.ceil(2 * parameters / 3 * config.folds / (config.folds - 1)))
    if len(seen) < needed:
        raise InputError(
            f"{seen.source}: {len(seen)} rows are too few for {parameters} parameters, "
            f"at least {needed} are needed"
        )


def _check_determined(
    arm: Arm, seen: Observations, parameters: Sequence[Parameter], config: CalibrationConfig
) -> None:
    """Refuse data that leave a parameter open."""

    def design(rows: Observations, chosen: Sequence[Parameter]) -> Array:
        problem = Problem(arm, rows, tuple(chosen), config.noise)
        return problem.design(np.zeros(len(chosen)))

    check_determined(Determination(arm, seen, design, config.undetermined), parameters)


def _find_good(problem: Problem, config: CalibrationConfig) -> NDArray[np.bool_]:
    """Find the rows that are no blunders, by a robust fit, shape (n,)."""
    x = np.zeros(len(problem.parameters))
    for _ in range(4):  # the scale settles in two or three rounds
        x = fit(problem, x, HUBER * find_scale(problem.whitened(x)))
    r = problem.whitened(x)
    good = np.linalg.norm(r, axis=1) <= config.blunder_sigma * find_scale(r)
    share = 1.0 - good.mean()
    if share > config.blunder_share:
        lines = ", ".join(map(str, problem.seen.line[~good][:10]))
        raise InputError(
            f"{problem.seen.source}: {share:.0%} of the rows fit no machine of this structure, allowed "
            f"{config.blunder_share:.0%}; the first are lines {lines}: check columns, frame and units"
        )
    return np.asarray(good)


def _keep_bounds(problem: Problem, x: Array, held: dict[str, str]) -> tuple[Array, Problem]:
    """Leave sag coefficients that went out of bounds on the bound and fit the rest again."""
    for i, p in enumerate(problem.parameters):
        if p.kind != "sag":
            continue
        low, high = SAG_BOUNDS[str(p.key)]
        value = read_value(problem.arm.description, p)
        wanted = value + float(x[i]) * p.expected
        if low <= wanted <= high:
            continue
        bound = low if wanted < low else high
        held[p.name] = f"the data want {wanted:.3g} {p.unit}: set to {bound:g}"
        stopped = change_description(problem.arm.description, [p], np.array([bound - value]))
        rest = [other for other in problem.parameters if other is not p]
        if p.key == "own_mm":  # without sag its exponent means nothing
            rest = [other for other in rest if other.key != "exponent"]
        smaller = Problem(Arm(stopped), problem.seen, tuple(rest), problem.noise)
        return _keep_bounds(smaller, fit(smaller), held)
    return x, problem


def _find_sigma(problem: Problem, x: Array) -> tuple[Array, float]:
    """Compute one sigma of each parameter, in its unit (k,), and the misses left over the noise."""
    r, A = problem.whitened(x), problem.design(x)
    freedom = max(r.size - len(x), 1)
    ratio = float(np.sqrt((r**2).sum() / freedom))
    covariance = np.linalg.inv(np.einsum("nij,nik->jk", A, A) + np.diag(problem.prior))
    # noise smaller than assumed is luck or a better survey: do not promise more for it
    return np.sqrt(np.diag(covariance)) * problem.scale * max(1.0, ratio), ratio


def _list_changes(problem: Problem, change: Array, sigma: Array) -> tuple[Change, ...]:
    values = [read_value(problem.arm.description, p) for p in problem.parameters]
    fitted = [
        Change(p.name, p.unit, v, v + d, s)
        for p, v, d, s in zip(problem.parameters, values, change.tolist(), sigma.tolist(), strict=True)
    ]
    return tuple(fitted)


def _total_zero(arm: Arm, parameters: Sequence[Parameter], change: Array) -> Array:
    """Add the fitted sensor zeros to those the file has, [deg, m], shape (joints,)."""
    noted = arm.description.calibration.sensor_zero if arm.description.calibration else []
    total = np.array(noted) if noted else np.zeros(arm.n)
    for p, delta in zip(parameters, change.tolist(), strict=True):
        if p.kind == "zero":
            total[p.joint] += delta
    return total


def _predict_held_out(problem: Problem, folds: int) -> Array:
    """Predict each row by a fit without its fold; misses [m], shape (n, 3)."""
    n = len(problem.seen)
    fold = np.random.default_rng(0).permutation(n) % folds
    miss = np.empty((n, 3))
    for k in range(folds):
        x = fit(problem.pick(fold != k))
        miss[fold == k] = problem.pick(fold == k).miss(x)
    return miss


def _judge(found: Calibrated, problem: Problem, x: Array, config: CalibrationConfig) -> None:
    """Refuse a change too large to be true, and one that predicts no better than the old file."""
    worst = int(np.abs(x).argmax()) if len(x) else -1
    if len(x) and not abs(x[worst]) <= config.largest:
        p, limit = problem.parameters[worst], config.largest * problem.scale[worst]
        raise InputError(
            f"{problem.seen.source}: {p.name} would change by {x[worst] * p.expected:.4g} {p.unit}, "
            f"allowed {limit:.4g}: check columns, frame and units, or hold it"
        )
    if not found.held_out.mean_mm < found.before.mean_mm:
        raise NoGainError(
            f"{problem.seen.source}: a calibration predicts no better: mean {found.before.mean_mm:.1f} mm "
            f"with the file as it is, {found.held_out.mean_mm:.1f} mm on rows not fitted"
        )
