"""Machine code of the task: joint vectors and targets -> misses, their derivatives, joints on target.

Callers use `task.py` and `reason.py`. Every posture is computed by itself.
"""

import numpy as np
from numba import float64, int64
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_chain import CHAIN, make_room, walk
from ascrcp.kinematics.kernel_compiler import array_of, part, whole
from ascrcp.kinematics.kernel_table import SLIDE, ChainTable

GRAIN = 1e-12
"""Share of its trace added to a pose's matrix: a singular one does not stop the others."""

LINES, TARGETS, VECTOR = array_of(float64, 2), array_of(float64, 3), array_of(float64, 1)


@part
def find_miss(
    chain: ChainTable, T: Array, q: Array, frames: Array, joints: Array, residual: Array, jacobian: Array
) -> bool:
    """Compare the tool's position and direction with a target; see `task.TaskError`, of one posture."""
    walk(chain, q, frames, joints)
    tool = frames[-1]
    facing = 0.0
    for i in range(3):
        residual[i] = tool[3, i] - T[i, 3]
        facing += T[i, 0] * tool[0, i]
    for row in range(2):
        residual[3 + row] = 0.0
        for i in range(3):
            residual[3 + row] += T[i, 1 + row] * tool[0, i]
    for k in range(len(chain.motion)):
        kind, _, joint, _ = chain.motion[k]
        if joint < 0:
            continue
        z, o = joints[joint]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            if kind == SLIDE:
                jacobian[i, joint] = z[i]
            else:
                jacobian[i, joint] = z[j] * (tool[3, m] - o[m]) - z[m] * (tool[3, j] - o[j])
        for row in range(2):
            turned = 0.0
            if kind != SLIDE:
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    turned += (tool[0, j] * T[m, 1 + row] - tool[0, m] * T[j, 1 + row]) * z[i]
            jacobian[3 + row, joint] = turned
    return facing > 0.0


@whole(CHAIN, TARGETS, LINES)
def find_misses(chain: ChainTable, T: Array, q: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Compare joint vectors (n, joints) with targets (n, 4, 4); the fields of `task.TaskError`."""
    n, count = q.shape
    frames, joints = make_room(q)
    residual, jacobian, facing = np.empty((n, 5)), np.zeros((n, 5, count)), np.empty(n, np.bool_)
    for row in range(n):
        facing[row] = find_miss(chain, T[row], q[row], frames, joints, residual[row], jacobian[row])
    return residual, jacobian, facing


@part
def _solve(matrix: Array, right: Array) -> None:
    """Solve a symmetric positive system (k, k) in place by elimination; right (k,) takes the solution."""
    k = len(right)
    for i in range(k):
        for j in range(i + 1, k):
            share = matrix[j, i] / matrix[i, i]
            for m in range(i, k):
                matrix[j, m] -= share * matrix[i, m]
            right[j] -= share * right[i]
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@whole(CHAIN, TARGETS, LINES, VECTOR, int64)
def project(chain: ChainTable, T: Array, q: Array, ease: Array, rounds: int) -> Array:
    """Move joint vectors (n, joints) onto their targets; see `task.project_task`."""
    n, count = q.shape
    frames, joints = make_room(q)
    residual, J, gram, found = np.empty(5), np.zeros((5, count)), np.empty((5, 5)), q.copy()
    for row in range(n):
        for _ in range(rounds):
            find_miss(chain, T[row], found[row], frames, joints, residual, J)
            trace = 0.0
            for i in range(5):
                for j in range(5):
                    gram[i, j] = 0.0
                    for k in range(count):
                        gram[i, j] += J[i, k] * ease[k] * J[j, k]
                trace += gram[i, i]
            for i in range(5):
                gram[i, i] += GRAIN * trace
            _solve(gram, residual)
            for k in range(count):
                for i in range(5):
                    found[row, k] -= ease[k] * J[i, k] * residual[i]
    return found


@part
def _find_slides(chain: ChainTable, count: int) -> NDArray[np.bool_]:
    """Tell which joints slide, shape (count,)."""
    slides = np.zeros(count, np.bool_)
    for k in range(len(chain.motion)):
        if chain.motion[k, 2] >= 0:
            slides[chain.motion[k, 2]] = chain.motion[k, 0] == SLIDE
    return slides


@part
def _ease_out(J: Array, gram: Array, pull: Array, ease: Array, damping: float, q: Array) -> None:
    """Move a joint vector q by the least damped effort that meets a pull (k,) of derivative J (k, joints)."""
    for i in range(len(pull)):
        for j in range(len(pull)):
            gram[i, j] = damping if i == j else 0.0
            for k in range(len(q)):
                gram[i, j] += J[i, k] * ease[k] * J[j, k]
    _solve(gram, pull)
    for k in range(len(q)):
        for i in range(len(pull)):
            q[k] += ease[k] * J[i, k] * pull[i]


@whole(CHAIN, LINES, VECTOR, float64, float64)
def raise_tool(chain: ChainTable, q: Array, ease: Array, lift: float, damping: float) -> Array:
    """Raise the tool by a small lift with its direction kept, by least effort.

    Args:
        chain: The arm's motions.
        q: Joint vectors [rad, m], shape (n, joints).
        ease: How lightly each joint moves: its squared speed, shape (joints,).
        lift: How far [m].
        damping: Keeps the step finite where the tool can hardly rise.

    Returns:
        Joint vectors, not kept within their ranges, shape (n, joints).
    """
    (n, count), (frames, joints), found = q.shape, make_room(q), q.copy()
    J, gram, pull, slides = np.zeros((4, count)), np.empty((4, 4)), np.empty(4), _find_slides(chain, count)
    for row in range(n):
        walk(chain, q[row], frames, joints)
        for k in range(count):
            z, o, p = joints[k, 0], joints[k, 1], frames[-1, 3]
            J[0, k] = z[2] if slides[k] else z[0] * (p[1] - o[1]) - z[1] * (p[0] - o[0])
            for i in range(3):
                J[1 + i, k] = 0.0 if slides[k] else z[i]
        pull[:] = 0.0
        pull[0] = lift
        _ease_out(J, gram, pull, ease, damping, found[row])
    return found


@whole(CHAIN, LINES, LINES, LINES, VECTOR, float64)
def step_onto(
    chain: ChainTable, q: Array, position: Array, direction: Array, ease: Array, damping: float
) -> Array:
    """Move joint vectors towards wanted poses by least effort, the roll about the tool's direction free.

    Args:
        chain: The arm's motions.
        q: Joint vectors [rad, m], shape (n, joints).
        position, direction: Where the tool should be [m] and point to, shape (n, 3).
        ease: How lightly each joint moves: its squared speed, shape (joints,).
        damping: Keeps the step finite in a singular pose.

    Returns:
        Joint vectors, not kept within their ranges, shape (n, joints).
    """
    (n, count), (frames, joints), found = q.shape, make_room(q), q.copy()
    J, gram, pull, slides = np.zeros((6, count)), np.empty((6, 6)), np.empty(6), _find_slides(chain, count)
    for row in range(n):
        walk(chain, q[row], frames, joints)
        d, p = frames[-1, 0], frames[-1, 3]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            pull[i] = position[row, i] - p[i]
            pull[3 + i] = d[j] * direction[row, m] - d[m] * direction[row, j]
        for k in range(count):
            z, o = joints[k, 0], joints[k, 1]
            along = z[0] * d[0] + z[1] * d[1] + z[2] * d[2]
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                J[i, k] = z[i] if slides[k] else z[j] * (p[m] - o[m]) - z[m] * (p[j] - o[j])
                J[3 + i, k] = 0.0 if slides[k] else z[i] - along * d[i]
        _ease_out(J, gram, pull, ease, damping, found[row])
    return found


@whole(LINES, LINES, VECTOR, VECTOR)
def find_excess(q: Array, limit_matrix: Array, lower: Array, upper: Array) -> Array:
    """Find by what share of a range joint vectors (n, joints) leave it most; NaN where q is; (n,)."""
    n, count = q.shape
    found = np.zeros(n)
    for row in range(n):
        for i in range(count):
            g = 0.0
            for k in range(count):
                if limit_matrix[i, k] != 0.0:
                    g += limit_matrix[i, k] * q[row, k]
            over = max(lower[i] - g, g - upper[i]) / (upper[i] - lower[i])
            if over > found[row]:
                found[row] = over
            elif not over <= found[row]:
                found[row] = np.nan
                break
    return found
