"""Speed of forward and inverse kinematics beside EAIK and pinocchio, where these are installed."""

import tempfile
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.cli.bench import Figure, Say, time_per_item
from ascrcp.cli.bench_calibration import measure_calibration
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.export import write_urdf
from ascrcp.kinematics.proof import draw_within_limits, held_values

POSES = 20_000
NUMERIC_POSES = 200
"""Poses a numeric inverse is given: it needs milliseconds for each."""

NUMERIC_ROUNDS = 200
NUMERIC_DAMPING = 1e-6
ARRIVED = 1e-9
"""Miss [m, rad] at which pinocchio's numeric inverse has found its one solution."""

# A Puma 560, the arm with a spherical wrist that EAIK's own paper measures: rows of alpha, a, d.
PUMA_ALPHA = (-np.pi / 2, 0.0, np.pi / 2, -np.pi / 2, np.pi / 2, 0.0)
PUMA_A = (0.0, 0.4318, -0.0203, 0.0, 0.0, 0.0)
PUMA_D = (0.6718, 0.1505, 0.0, 0.4318, 0.0, 0.0560)


def measure_inverse(machine: str, seed: int, say: Say) -> list[Figure]:
    """Measure the arm, its peers on the same core, and what calibration leaves."""
    arm = load_arm(machine)
    q = draw_within_limits(arm, POSES, np.random.default_rng(seed))
    T, held = arm.forward(q), held_values(arm, q)
    say(f"bench: {POSES} poses of {arm.name}")
    count = arm.inverse(T, held).valid.sum(axis=1).mean()
    return [
        Figure(
            "inverse, all solutions",
            time_per_item(lambda: arm.inverse(T, held), POSES),
            "us/pose",
            2.0,
            note=f"{arm.name}, batch, confirmed, {count:.1f} solutions a pose",
        ),
        _measure_eaik(seed),
        _measure_pinocchio(arm, T, q),
        Figure(
            "forward", time_per_item(lambda: arm.forward(q), POSES), "us/pose", 0.5, note=f"{arm.name}, batch"
        ),
        Figure(
            "forward, one pose a call",
            time_per_item(lambda: [arm.forward(row) for row in q[:1000]], 1000, 3),
            "us/pose",
            note="as the control cycle calls it",
        ),
        *measure_calibration(machine, seed, say),
    ]


def _find(package: str, module: str) -> tuple[Any, str]:
    """Import an optional peer: the module (None if it is not there) and its name with version."""
    try:
        return import_module(module), f"{package} {version(package)}"
    except (ImportError, PackageNotFoundError):
        return None, f"{package}: not installed"


def _measure_eaik(seed: int) -> Figure:
    what = "inverse of a 6R arm, EAIK"
    eaik, name = _find("EAIK", "eaik.IK_DH")
    if eaik is None:
        return Figure(what, None, "us/pose", note=name)
    robot = eaik.DhRobot(np.array(PUMA_ALPHA), np.array(PUMA_A), np.array(PUMA_D))
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (POSES, 6))
    T = np.array([robot.fwdKin(row) for row in q])
    took = time_per_item(lambda: robot.IK_batched(T, num_worker_threads=1), POSES)
    return Figure(
        what, took, "us/pose", note=f"{name}, batch, one thread, Puma 560: it knows no sliding joint"
    )


def _measure_pinocchio(arm: Arm, T: np.ndarray, q: np.ndarray) -> Figure:
    what = "numeric inverse, pinocchio"
    pin, name = _find("pin", "pinocchio")
    if pin is None:
        return Figure(what, None, "us/pose", note=name)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "arm.urdf"
        write_urdf(arm, place)
        model = pin.buildModelFromUrdf(str(place))
    found = [_search(pin, model, arm, T[i], q[i]) for i in range(NUMERIC_POSES)]
    took = time_per_item(
        lambda: [_search(pin, model, arm, T[i], q[i]) for i in range(NUMERIC_POSES)], NUMERIC_POSES, 3
    )
    return Figure(
        what,
        took,
        "us/pose",
        note=f"{name}, {arm.name}, one solution, found for {np.mean(found):.0%} of the poses from mid range",
    )


def _search(pin: Any, model: Any, arm: Arm, T: np.ndarray, true_q: np.ndarray) -> bool:
    """Run pinocchio's own closed-loop inverse from the middle of the ranges, held joints given."""
    data, tool = model.createData(), model.getFrameId("tool")
    free = [i for i in range(arm.n) if i + 1 not in arm.held]
    q = (arm.lower + arm.upper) / 2
    for number in arm.held:
        q[number - 1] = true_q[number - 1]
    goal = pin.SE3(T)
    for _ in range(NUMERIC_ROUNDS):
        pin.framesForwardKinematics(model, data, q)
        miss = pin.log6(data.oMf[tool].actInv(goal))
        if np.abs(miss.vector).max() < ARRIVED:
            return True
        J = pin.computeFrameJacobian(model, data, q, tool, pin.ReferenceFrame.LOCAL)[:, free]
        J = pin.Jlog6(data.oMf[tool].actInv(goal)) @ J
        q[free] += J.T @ np.linalg.solve(J @ J.T + NUMERIC_DAMPING * np.eye(6), miss.vector)
    return False
