"""One ring inside a duct by collision feedback (duct paper 2.2 and 3): poses -> joints that touch nothing.

What joints before the wrist can help is helped by self-motion (3.1); what the pose itself ties down is
helped by tilting the pose about the gun (3.2). The ring is travelled again until nothing is left.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ascrcp.core.errors import UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.duct import Duct, Gap
from ascrcp.kinematics.duct_body import SphereBody
from ascrcp.kinematics.gradient_projection import LimitCost, approach, damped_inverse, self_motion
from ascrcp.kinematics.ring_parameter import RingParameters
from ascrcp.kinematics.ring_target import Ring, find_lever, spread_round, tilt_ring

FIRST_TIED = 6
"""Joint from which the pose fixes what collides (eq. 5)."""


@dataclass(frozen=True)
class Scene:
    """What a ring is planned in."""

    arm: Arm
    body: SphereBody
    duct: Duct
    parameters: RingParameters


@dataclass(frozen=True)
class RingPlan:
    """Joints once round.

    Attributes:
        q: Joint vectors [rad, m]; the first pose stands at both ends, shape (n + 1, joints).
        T: Poses reached, tilted where the lever asked for it, shape (n, 4, 4).
        tilt: Their rotation vectors in the base frame [rad], shape (n, 3).
    """

    q: Array
    T: Array
    tilt: Array


def round_trip(n: int) -> list[int]:
    """Return the order of the poses: all, then the first again (fig. 8)."""
    return [*range(n), 0]


def plan_plain(scene: Scene, ring: Ring, start: Array) -> RingPlan:
    """Travel the ring by gradient projection alone (eq. 4 with eq. 6): the paper's state before.

    Raises:
        UnreachableError: A pose out of reach from this start.
    """
    p = scene.parameters.projection
    cost, q, rows = LimitCost.of(scene.arm, p), start, []
    for i in round_trip(len(ring.T)):
        q = approach(scene.arm, q, ring.T[i], cost, p)
        rows.append(q)
    return RingPlan(np.array(rows), ring.T, np.zeros((len(ring.T), 3)))


def plan_feedback(scene: Scene, ring: Ring, start: Array) -> RingPlan:
    """Travel the ring with collision feedback (3.1 and 3.2) until it is clear.

    Raises:
        UnreachableError: It does not become clear in so many rounds, or a pose is out of reach.
    """
    p = scene.parameters
    step, limit = np.radians(p.tilt_step_deg), np.radians(p.tilt_limit_deg)
    tilt = np.zeros((len(ring.T), 3))
    for _ in range(p.ring_rounds):
        T = tilt_ring(ring.T, tilt)
        rows: list[Array] = []
        q = start
        for i in round_trip(len(T)):
            q = give_way(scene, q, T[i])
            rows.append(q)
        plan = RingPlan(np.array(rows), T, tilt)
        gap = scene.body.measure(scene.arm, plan.q, scene.duct)
        short = gap.clearance.min(axis=1) < p.margin
        if not short.any():
            return plan
        turned = _lever(scene, plan, gap)
        if np.array_equal(turned, tilt):
            break
        tilt = spread_round(turned, step)
        if not np.linalg.norm(tilt, axis=1).max() <= limit:
            raise UnreachableError(
                f"{scene.duct.name}: keeping clear needs a tilt of more than {p.tilt_limit_deg:g} deg"
            )
    worst = float(gap.clearance.min())
    raise UnreachableError(
        f"{scene.duct.name}: {int(short.sum())} of {len(short)} poses stay nearer to the wall than "
        f"{1e3 * p.margin:g} mm; the least clearance is {1e3 * worst:.0f} mm"
    )


def give_way(scene: Scene, q: Array, T_wanted: Array) -> Array:
    """Reach a pose, then move away from avoidable collisions while holding it (3.1)."""
    arm, body, p = scene.arm, scene.body, scene.parameters
    cost = LimitCost.of(arm, p.projection)
    q = approach(arm, q, T_wanted, cost, p.projection)
    free = body.number < FIRST_TIED
    for _ in range(p.pose_rounds):
        gap = body.measure(arm, q[None], scene.duct)
        clearance = np.where(free, gap.clearance[0], np.inf)
        worst = int(clearance.argmin())
        if not clearance[worst] < p.margin:
            break
        escape = gap.escape[0, worst]
        joint = _choose_joint(scene, worst, escape)
        # with the pose held a joint moves only together with others: which way it helps is the projected gain
        projector = damped_inverse(arm.jacobian(q), p.projection)[1]
        gain = projector @ (body.jacobian(arm, q[None])[0, worst].T @ escape)
        cost = cost.push(q, joint, bool(gain[joint] > 0.0), p.projection)
        q = approach(arm, self_motion(arm, q, cost, p.projection), T_wanted, cost, p.projection)
    return q


def _choose_joint(scene: Scene, sphere: int, escape: Array) -> int:
    """Choose the nearest joint before a collision that turns left and right or up and down (eq. 7)."""
    p, body = scene.parameters, scene.body
    sideways = abs(escape[0]) >= abs(escape[1])
    group = p.left_right if sideways else p.up_down
    last = int(body.link[sphere]) - (body.share[sphere] == 0.0)
    return max((j for j in group if j <= last), default=min(group)) - 1


def _lever(scene: Scene, plan: RingPlan, gap: Gap) -> Array:
    """Tilt every pose whose wrist or lance is too near (3.2); rotation vectors (n, 3) [rad]."""
    tilt = plan.tilt.copy()
    body, p = scene.body, scene.parameters
    tied = np.where(body.number >= FIRST_TIED, gap.clearance, np.inf)
    centres = body.place(scene.arm, plan.q)
    n = len(plan.T)
    for i in range(n):
        visit = n if i == 0 and tied[n].min() < tied[0].min() else i
        k = int(tied[visit].argmin())
        lack = p.margin + p.lever_surplus - float(tied[visit, k])
        if tied[visit, k] < p.margin:
            lever = find_lever(centres[visit, k], plan.T[i, :3, 3], gap.escape[visit, k], lack)
            tilt[i] = tilt[i] + lever
    return tilt


def find_starts(scene: Scene, T: Array, rng: np.random.Generator) -> Iterator[Array]:
    """Yield joints that reach the first pose of a ring, the clearest and least strained first.

    The lance turns once round with the ring: its range is cut by that turn here, so that it has room.

    Args:
        scene: Arm and duct.
        T: The pose, shape (4, 4).
        rng: Source of chance for where the search begins.
    """
    arm, p = scene.arm, scene.parameters
    whole = LimitCost.of(arm, p.projection)
    upper = arm.upper.copy()
    upper[-1] = max(upper[-1] - 2 * np.pi, arm.lower[-1] + np.pi)
    cost = replace(whole, upper=upper)
    found = []
    middle, half = (arm.lower + upper) / 2, (upper - arm.lower) / 2
    spread = middle + p.start_spread * half * rng.uniform(-1.0, 1.0, (p.starts, arm.n))
    for guess in [middle, *spread]:
        try:
            q = approach(arm, guess, T, cost, p.projection)
            for _ in range(p.start_relax):
                q = approach(arm, self_motion(arm, q, cost, p.projection), T, cost, p.projection)
        except UnreachableError:
            continue
        clearance = float(scene.body.measure(arm, q[None], scene.duct).clearance.min())
        found.append((max(p.margin - clearance, 0.0), cost.value(q), q))
    if not found:
        raise UnreachableError(
            f"{scene.duct.name}: no posture of machine {arm.name} within its ranges reaches the first pose"
        )
    yield from (row[2] for row in sorted(found, key=lambda row: row[:2]))


def plan_ring(
    scene: Scene, ring: Ring, rng: np.random.Generator, near: Array | None = None
) -> tuple[Array, RingPlan]:
    """Plan a ring from the first start that leads to a clear one.

    Args:
        scene: Arm and duct.
        ring: The poses.
        rng: Source of chance for the starts.
        near: Joints to start from if that works, such as those of the ring before.

    Returns:
        The start that led to it [rad, m], shape (joints,), and the clear plan.

    Raises:
        UnreachableError: No start leads to a clear ring; the message is that of the best start.
    """
    why: UnreachableError | None = None
    starts = find_starts(scene, ring.T[0], rng)
    for start in starts if near is None else itertools.chain([near], starts):
        try:
            return start, plan_feedback(scene, ring, start)
        except UnreachableError as error:
            why = why or error
    raise why or UnreachableError(f"{scene.duct.name}: no start for the ring")
