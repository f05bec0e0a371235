"""bench: figures beside a peer in the same run; ratios, because machines differ and are noisy."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ascrcp.cli.output import OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table
from ascrcp.kinematics.arm import Arm, load_arm

POSES = 20_000
PEER_POSES = 20
REPEATS = 3


def bench(options: Options, output: Output) -> int:
    """Measure and print."""
    figures: list[dict[str, Any]] = []
    if options.which in ("all", "kinematics"):
        figures += _kinematics(load_arm("kc"), options.seed)
    rows = [
        [
            f["what"],
            f"{f['value']:.3g} {f['unit']}",
            f"{f['peer_value']:.3g} {f['unit']}",
            f["peer"],
            f"{f['ratio']:.0f} x",
        ]
        for f in figures
    ]
    text = table(["what", "here", "peer", "peer is", "faster"], rows)
    output.result({"ok": True, "figures": figures}, text)
    return OK


def _best(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def _kinematics(arm: Arm, seed: int) -> list[dict[str, Any]]:
    """Closed-form inverse of `kc` beside damped least squares on the same forward model."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (POSES, arm.n))
    T = arm.forward(q)
    held = {5: q[:, 4], 6: q[:, 5]}
    ours = _best(lambda: arm.inverse(T, held=held)) / POSES
    peer = _best(lambda: [_numeric(arm, T[i], q[i]) for i in range(PEER_POSES)]) / PEER_POSES
    one = _best(lambda: [arm.forward(row) for row in q[:200]]) / 200
    batch = _best(lambda: arm.forward(q)) / POSES
    return [
        _figure("inverse, all solutions, batched", ours, "damped least squares, one solution", peer),
        _figure("forward, batched", batch, "forward, one pose a call", one),
    ]


def _figure(what: str, ours: float, peer: str, theirs: float) -> dict[str, Any]:
    return {
        "what": what,
        "value": 1e6 * ours,
        "unit": "us/pose",
        "peer": peer,
        "peer_value": 1e6 * theirs,
        "ratio": theirs / ours,
    }


def _numeric(arm: Arm, T: np.ndarray, q_true: np.ndarray) -> np.ndarray:
    """Find one solution with joints 5, 6 held, started 0.2 off the true one."""
    free = [0, 1, 2, 3, 6, 7]
    q = q_true.copy()
    q[free] += 0.2
    for _ in range(100):
        now = arm.forward(q)
        R = T[:3, :3] @ now[:3, :3].T
        turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        error = np.concatenate([T[:3, 3] - now[:3, 3], turn])
        if np.abs(error).max() < 1e-10:
            break
        J = arm.jacobian(q)[:, free]
        q[free] += J.T @ np.linalg.solve(J @ J.T + 1e-9 * np.eye(6), error)
    return q
