"""The whole ring as a sequence of quadratic programs: a clear plan -> a closed one with little acceleration.

Better than travelling the ring pose by pose: every pose knows those after it, the turn ends exactly where it
began, and the tilts are no more than the clearance asks for. The spray cone is round, so a turn about the
spray direction costs nothing; the gun stays where it is planned.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.gradient_projection import pose_error
from ascrcp.kinematics.ring import RingPlan, Scene
from ascrcp.kinematics.ring_target import Ring

PLACE_TOLERANCE = 1e-10
"""Miss of the gun's place at which it is kept [m]."""

CORRECTIONS = 20
"""Most Newton steps back onto the gun's places."""

HALVINGS = 8
"""Most halvings of a step."""

NEAR_END = 0.3
"""Distance to an end of a range within which it is a constraint [rad, m]: the trust region's largest size."""

RIDGE = 1e-6
"""Share of the mean curvature added, so that what costs nothing stays where it is."""


def find_turn(arm: Arm, q: Array) -> Array:
    """Return by how many whole turns each joint is on after a ring (m, n) [rad], 0 for sliding ones, (n,)."""
    return np.where(arm.prismatic, 0.0, 2 * np.pi * np.rint((q[-1] - q[0]) / (2 * np.pi)))


def close_ring(scene: Scene, ring: Ring, plan: RingPlan) -> RingPlan:
    """Make accelerations and tilts round the closed ring small, clearances and ranges kept.

    Minimise the sum of squares of accelerations, each as a share of the joint's largest, and of the
    tilts of the spray direction, over the motions that leave the gun in place; all else is linear there.

    Args:
        scene: What it is planned in.
        ring: The poses wanted.
        plan: A clear plan; its last row is replaced by its first, whole turns on.

    Raises:
        UnreachableError: No iterate is clear.
    """
    arm, p = scene.arm, scene.parameters
    turn = find_turn(arm, plan.q)
    q, trust = plan.q[:-1], p.program.trust
    best, least = None, np.inf
    for _ in range(p.program.rounds):
        try:
            step = RingProgram.at(scene, ring, q, turn, trust).solve()
        except UnreachableError:  # no step of this size; a smaller one asks for less
            trust = 0.5 * trust
            continue
        q, whole = _move(scene, ring, q, turn, step)
        trust = min(1.5 * trust, NEAR_END) if whole else 0.5 * trust
        clearance = scene.body.measure(arm, q, scene.duct).clearance.min()
        cost = _cost(scene, ring, q, turn)
        if clearance >= p.margin and cost < least:
            best, least = q, cost
    if best is None:
        raise UnreachableError(f"{scene.duct.name}: no closed ring keeps {1e3 * p.margin:g} mm clear")
    T = arm.forward(best)
    tilt = pose_error(ring.T, T)[:, 3:]
    return RingPlan(np.vstack([best, best[:1] + turn]), T, tilt)


def _bends(q: Array, turn: Array) -> Array:
    """Second differences round the closed ring, shape (n, joints)."""
    ahead, behind = np.roll(q, -1, axis=0), np.roll(q, 1, axis=0)
    ahead[-1] += turn
    behind[0] -= turn
    return ahead - 2 * q + behind


def _tilt(ring: Ring, T: Array) -> Array:
    """Turns from the wanted poses in their own axes [rad], shape (n, 3): x, y tilt the spray, z does not."""
    return np.einsum("nij,ni->nj", ring.T[:, :3, :3], pose_error(ring.T, T)[:, 3:])


def _cost(scene: Scene, ring: Ring, q: Array, turn: Array) -> float:
    p = scene.parameters
    bend = _bends(q, turn) / (p.dt**2 * scene.arm.max_acceleration)
    tilt = _tilt(ring, scene.arm.forward(q)) * _tilt_weight(scene)
    return float((bend**2).sum() + (tilt**2).sum())


def _tilt_weight(scene: Scene) -> Array:
    """Weights of turns about the wanted pose's axes [1/rad], shape (3,)."""
    program = scene.parameters.program
    unit_tilt = np.radians([program.tilt_deg, program.tilt_deg, program.roll_deg])
    return np.asarray(1.0 / unit_tilt)


@dataclass(frozen=True)
class RingProgram:
    """The ring linearised: minimise |A z + b|^2 + small |z|^2 with G z >= h.

    Attributes:
        N: Motions z of each pose as changes of its joints, shape (n, joints, 5).
        A, b: Accelerations and tilts, each over what it may cost.
        G, h: Clearances, ranges and the trust region.
    """

    N: Array
    A: Array
    b: Array
    G: Array
    h: Array

    @classmethod
    def at(cls, scene: Scene, ring: Ring, q: Array, turn: Array, trust: float) -> "RingProgram":
        """Linearise at joints q (n, joints), `turn` on after the last, steps no larger than `trust`."""
        arm, p = scene.arm, scene.parameters
        n, joints = q.shape
        J = arm.jacobian(q)
        N = np.swapaxes(np.linalg.svd(J[:, :3])[2][:, 3:], 1, 2)  # leaves the gun where it is
        free = N.shape[2]
        scale = 1.0 / (p.dt**2 * arm.max_acceleration)
        row = np.arange(n)
        bend = np.zeros((n, joints, n, free))
        for at, factor in ((row, -2.0), ((row + 1) % n, 1.0), ((row - 1) % n, 1.0)):
            bend[row, :, at] += factor * scale[:, None] * N[at]
        tilting = np.zeros((n, 3, n, free))
        weight = _tilt_weight(scene)[:, None]
        tilting[row, :, row] = weight * (np.swapaxes(ring.T[:, :3, :3], 1, 2) @ J[:, 3:] @ N)
        A = np.concatenate([bend.reshape(-1, n * free), tilting.reshape(-1, n * free)])
        tilt = _tilt(ring, arm.forward(q)) * weight[:, 0]
        b = np.concatenate([(_bends(q, turn) * scale).ravel(), tilt.ravel()])
        G, h = _constraints(scene, q, turn, N, trust)
        return cls(N, A, b, G, h)

    def solve(self) -> Array:
        """Solve the program exactly as a least-distance problem (Lawson and Hanson 1974, chapter 23).

        Returns:
            The change of the joints, shape (n, joints).

        Raises:
            UnreachableError: The constraints contradict each other.
        """
        H = self.A.T @ self.A
        H += RIDGE * np.trace(H) / len(H) * np.eye(len(H))
        L = cholesky(H, lower=True)
        u = solve_triangular(L, self.A.T @ self.b, lower=True)
        G = solve_triangular(L, self.G.T, lower=True).T
        E = np.vstack([G.T, self.h + G @ u])
        target = np.zeros(len(E))
        target[-1] = 1.0
        try:
            dual, _ = nnls(E, target, maxiter=30 * E.shape[1])
        except RuntimeError as error:  # out of iterations
            raise UnreachableError(f"a ring's program is not solved: {error}") from None
        r = E @ dual - target
        if not abs(r[-1]) > 1e-12:
            raise UnreachableError("the constraints of a ring's program contradict each other")
        z = solve_triangular(L, -r[:-1] / r[-1] - u, lower=True, trans="T")
        return np.einsum("ijk,ik->ij", self.N, z.reshape(len(self.N), -1))


def _ranges(arm: Arm, q: Array, turn: Array) -> tuple[Array, Array]:
    """Ranges of every row (n, joints); the first comes again a turn on, so its range is cut by that."""
    lower, upper = (np.broadcast_to(end, q.shape).copy() for end in (arm.lower, arm.upper))
    lower[0] -= np.minimum(turn, 0.0)
    upper[0] -= np.maximum(turn, 0.0)
    return lower, upper


def _constraints(scene: Scene, q: Array, turn: Array, N: Array, trust: float) -> tuple[Array, Array]:
    """Rows G z >= h: clearances, ranges where they are near, and the trust region."""
    arm, p = scene.arm, scene.parameters
    n, _, free = N.shape
    size = n * free
    gap = scene.body.measure(arm, q, scene.duct)
    pose, sphere = np.nonzero(gap.clearance < p.margin + p.program.watch)
    J = scene.body.jacobian(arm, q)[pose, sphere]
    gain = np.einsum("kc,kcj,kjl->kl", gap.inward[pose, sphere], J, N[pose])
    clear = np.zeros((len(pose), n, free))
    clear[np.arange(len(pose)), pose] = gain
    lack = p.margin + p.program.surplus - gap.clearance[pose, sphere]
    within = np.minimum(lack, 0.5 * trust * np.abs(gain).sum(axis=1))  # no more than one step can give
    ends, room = [], []
    lower, upper = _ranges(arm, q, turn)
    for sign, left in ((1.0, q - lower), (-1.0, upper - q)):
        i, joint = np.nonzero(left < NEAR_END)
        rows = np.zeros((len(i), n, free))
        rows[np.arange(len(i)), i] = sign * N[i, joint]
        ends.append(rows.reshape(-1, size))
        room.append(-left[i, joint])
    box = np.eye(size)
    G = np.vstack([clear.reshape(-1, size), *ends, box, -box])
    return G, np.concatenate([within, *room, np.full(2 * size, -trust)])


def _move(scene: Scene, ring: Ring, q: Array, turn: Array, step: Array) -> tuple[Array, bool]:
    """Take as much of a step as keeps ranges and nearly the clearances; say whether it was all of it."""
    arm, p = scene.arm, scene.parameters
    lower, upper = _ranges(arm, q, turn)
    for halving in range(HALVINGS):
        tried = _restore(arm, q + 0.5**halving * step, ring.T[:, :3, 3])
        if tried is None or not ((tried >= lower) & (tried <= upper)).all():
            continue
        if scene.body.measure(arm, tried, scene.duct).clearance.min() >= p.margin - p.program.overstep:
            return tried, halving == 0
    return q, False


def _restore(arm: Arm, q: Array, place: Array) -> Array | None:
    """Bring the guns back onto their places (n, 3) by least steps; None if they stay off."""
    for _ in range(CORRECTIONS):
        error = place - arm.forward(q)[:, :3, 3]
        if np.abs(error).max() <= PLACE_TOLERANCE:
            return q
        q = q + (np.linalg.pinv(arm.jacobian(q)[:, :3]) @ error[..., None])[..., 0]
    return None
