"""Route of a joint move: two postures -> postures to pass through, clear of everything on the way.

Straight first. Where that comes too near to something, a small graph is searched: both ends, their mean
and the zero pose, drawn in and raised in steps, and climbs to where there is more room, joined by straight
legs. Legs are looked at only when the cheapest route uses them (lazy shortest path: Dellin and
Srinivasa, ICAPS 2016). Where that finds nothing, an end stands in a pocket that only its own stroke leads
out of: the strokes' postures join the graph, each to its neighbours on the stroke and to the middles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra

from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.clearance import HALF_DIAGONAL, clearance, least_distance, rough_clearance
from ascrcp.kinematics.description import ClearanceModel
from ascrcp.kinematics.leg import keep_ranges
from ascrcp.kinematics.obstacle import Obstacles

DRAWN_IN = (1.0, 0.5, 0.0)
"""Shares of their travel at which the telescopes stand in the middles tried; placeholder."""

LIFTS_M = (0.0, 0.75, 1.5, 3.0)
"""Heights by which the nozzle is raised in them [m]; placeholder."""

LIFT_STEP_M = 0.25
"""A lift is made in steps of this, each with its own Jacobian."""

ROW_M = 0.06
"""No joint of the arm moves further between two looks [m]: what is between them is 3 cm from one."""

FEW = 9
"""Looks at a leg before it is looked at closely: most bad legs are seen through at once."""

NEAR_PRICE = 8.0
"""Seconds that a second at the least clearance counts more than one at the wanted; placeholder."""

CLIMB_STEPS = 16
"""Steps of the climb out from an end; placeholder."""

SHIFT_S = 0.1
"""Each joint is shifted by what it moves in this time, to see where there is more room [s]; placeholder."""

CLIMB_S = 0.7
"""A step is what the fastest joint moves in this time [s]; placeholder."""

CLIMB_KEPT = 4
"""Every so many steps a posture is kept."""

DAMPING = 1e-6
"""Keeps a lift finite where the arm can hardly rise, against squared speeds of joints; placeholder."""

STOP_S = 2.0
"""What a stop on the way costs [s]: slowing down, starting again and settling; placeholder."""

SCREEN = (0.5, 0.25, 0.75)
"""Shares of a leg at which it is looked at roughly, all legs at once, before any is looked at."""

EASY = 8
"""After so many rounds a search is no easy one: all legs are looked at together, before one by one."""

LEGS = 500
"""Legs looked at at once."""

MOST_ROUNDS = 250
"""A search gives up after so many rounds; those that find a way need a few dozen."""

MORE_ROUNDS = 1000
"""The same with the postures of strokes, which are many; placeholder."""

TRAIL_S = 0.7
"""A trail's postures begin so far apart [s] and lie further apart with every one; placeholder."""

TRAIL_GROWTH = 1.08
"""Factor from one such distance to the next: pockets are near the ends of a move; placeholder."""

TRAIL_REACH = 3
"""A trail's posture is joined to so many of the next ones on it."""

SLACK = 1e-6
"""Rounding allowed on a clearance [m]."""


@dataclass(frozen=True)
class Look:
    """A straight leg as looked at: least clearance [m], the posture that has it, price [s]."""

    least: float
    at: Array
    price: float


def find_route(
    arm: Arm,
    start: Array,
    end: Array,
    obstacles: Obstacles,
    first: Sequence[Array] = (),
    trails: Sequence[Array] = (),
) -> tuple[Array, ...]:
    """Find the postures a move passes through so that no link comes too near to anything.

    The wanted clearance is kept where there is a way, the least always. An arm that stands nearer than
    the least may leave, but comes no nearer.

    Args:
        arm: An arm with a clearance model.
        start: Joints where the move begins [rad, m], shape (joints,).
        end: Joints where it ends.
        obstacles: What to keep clear of.
        first: Postures between that are wanted if the way through them is clear.
        trails: Ways that are known, from an end of the move onwards, each (m, joints): the stroke it
            leaves, backwards, and the one it goes to; tried where nothing else leads there.

    Returns:
        The postures between, none if the straight way is clear.

    Raises:
        InputError: A bad posture, or an arm without a clearance model.
        UnreachableError: No way found; the message says what would be hit.
    """
    model = arm.description.clearance
    if model is None:
        raise InputError(f"machine {arm.name} has no clearance model")
    there = clearance(arm, np.stack([start, end]), obstacles)
    if not there.distance[1] >= model.least - SLACK:
        raise UnreachableError(f"target: {there.describe(arm, 1)}, at least {model.least:g} m is kept")
    least = min(model.least, float(there.distance[0])) - SLACK
    enough = min(model.wanted, *there.distance.tolist()) - SLACK
    scout = _Scout(arm, obstacles, model)
    straight = [scout.look(a, b, least) for a, b in pairwise([start, *first, end])]
    if min(look.least for look in straight) >= enough:
        return tuple(first)
    nodes = np.stack([start, end, *first, *_middles(arm, start, end, obstacles)])
    free = least_distance(arm, nodes, obstacles)
    for floor in (enough, least):
        route = scout.search(nodes[free >= floor], floor)
        if route:
            return tuple(route[1:-1])
    if trails:
        route = scout.search(nodes[free >= least], least, [thin_trail(arm, trail) for trail in trails])
        if route:
            return tuple(route[1:-1])
    worst = min(straight, key=lambda look: look.least)
    met = clearance(arm, worst.at, obstacles).describe(arm, 0)
    raise UnreachableError(f"no clear way found; straight, {met}, at least {model.least:g} m is kept")


class _Scout:
    """Looks at straight legs and searches the graph of them."""

    def __init__(self, arm: Arm, obstacles: Obstacles, model: ClearanceModel) -> None:
        self.arm, self.obstacles, self.model = arm, obstacles, model

    def look(self, a: Array, b: Array, floor: float) -> Look:
        """Look at a leg: first at a few postures on it, then closely if none is nearer than the floor."""
        n = FEW
        while n:
            q = a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)
            free = least_distance(self.arm, q, self.obstacles)
            i = int(free.argmin())
            if not free[i] >= floor:
                return Look(float(free[i]), q[i], np.inf)
            closely = int(np.ceil(self._travel(a, b) / ROW_M)) + 1 if n == FEW else 0
            n = closely if closely > FEW else 0
        short = (self.model.wanted - free) / (self.model.wanted - self.model.least)
        price = float(self.time(a, b)) * (1.0 + NEAR_PRICE * float(np.maximum(short, 0.0).mean())) + STOP_S
        return Look(float(free[i]), q[i], price)

    def time(self, a: Array, b: Array) -> Array:
        """Time of legs at the joints' largest speeds [s]; (..., joints) twice -> (...)."""
        return np.asarray((np.abs(b - a) / self.arm.max_speed).max(axis=-1))

    def _travel(self, a: Array, b: Array) -> float:
        """Measure how far the joint or nozzle that moves most moves on a leg [m]."""
        frames = self.arm.frames(a + np.linspace(0.0, 1.0, FEW)[:, None] * (b - a))
        return float(np.linalg.norm(np.diff(frames[..., :3, 3], axis=0), axis=-1).sum(axis=0).max())

    def search(self, nodes: Array, floor: float, trails: Sequence[Array] = ()) -> list[Array] | None:
        """Find the cheapest route from the first node to the second; None if none is found."""
        hubs, most = len(nodes), MORE_ROUNDS if trails else MOST_ROUNDS
        nodes = np.concatenate([nodes, *trails])
        price = self.time(nodes[:, None], nodes[None]) + STOP_S
        along = np.arange(len(nodes))
        trail = np.repeat(np.arange(len(trails) + 1), [hubs, *map(len, trails)])
        apart = (np.minimum.outer(along, along) >= hubs) & (
            np.abs(np.subtract.outer(along, along)) > TRAIL_REACH
        )
        price[apart & np.equal.outer(trail, trail)] = np.inf
        self._screen(nodes, hubs, floor, price)
        looked = np.eye(len(nodes), dtype=bool)
        for count in range(most):
            if count == EASY:
                self._look_at_all(nodes, floor, price)
            route = _shortest(price)
            unseen = [(a, b) for a, b in pairwise(route) if not looked[a, b]]
            if not unseen:
                return [nodes[i] for i in route] if route else None
            for a, b in unseen:
                price[a, b] = price[b, a] = self.look(nodes[a], nodes[b], floor).price
                looked[a, b] = looked[b, a] = True
                if not np.isfinite(price[a, b]):
                    break
        return None

    def _look_at_all(self, nodes: Array, floor: float, price: Array) -> None:
        """Bar legs that a look at few postures tells are too near, all at once."""
        a, b = np.nonzero(np.triu(np.isfinite(price), 1))
        for k in range(0, len(a), LEGS):
            i, j = a[k : k + LEGS], b[k : k + LEGS]
            q = nodes[i] + np.linspace(0.0, 1.0, FEW)[:, None, None] * (nodes[j] - nodes[i])
            free = least_distance(self.arm, q.reshape(-1, self.arm.n), self.obstacles)
            bad = ~(free.reshape(FEW, -1).min(axis=0) >= floor)
            price[i[bad], j[bad]] = price[j[bad], i[bad]] = np.inf

    def _screen(self, nodes: Array, hubs: int, floor: float, price: Array) -> None:
        """Bar legs between the first `hubs` nodes that a rough look at a few postures tells are too near."""
        a, b = np.triu_indices(hubs, 1)
        slack = HALF_DIAGONAL * self.obstacles.cell
        for share in SCREEN:
            q = nodes[a] + share * (nodes[b] - nodes[a])
            bad = rough_clearance(self.arm, q, self.obstacles) + slack < floor
            price[a[bad], b[bad]] = price[b[bad], a[bad]] = np.inf
            a, b = a[~bad], b[~bad]


def thin_trail(arm: Arm, trail: Array) -> Array:
    """Thin a trail's postures (m, joints): close together where it begins, further apart further on."""
    way = np.abs(np.diff(trail, axis=0, prepend=trail[:1])) / arm.max_speed
    along, kept, step = np.cumsum(way.max(axis=1)), [0], TRAIL_S
    for i in range(1, len(trail)):
        if along[i] - along[kept[-1]] >= step or i == len(trail) - 1:
            kept.append(i)
            step *= TRAIL_GROWTH
    return trail[kept]


def _shortest(price: Array) -> list[int]:
    """Find the cheapest way from node 0 to node 1 of a dense graph; empty if there is none."""
    _, before = dijkstra(np.where(np.isfinite(price), price, 0.0), indices=0, return_predecessors=True)
    if before[1] < 0:
        return []
    route = [1]
    while route[-1] != 0:
        route.append(int(before[route[-1]]))
    return route[::-1]


def _middles(arm: Arm, start: Array, end: Array, obstacles: Obstacles) -> Array:
    """Make the postures a route may pass through, shape (n, joints).

    The ends, their mean and the zero pose, drawn in and raised, and the ways out from both ends.
    """
    bases = np.stack([start, (start + end) / 2.0, end, arm.zero_pose])
    drawn = _draw_in(arm, np.repeat(bases, len(DRAWN_IN), axis=0), np.tile(DRAWN_IN, len(bases)))
    out = _climb(arm, np.stack([start, end]), obstacles)
    middles = np.concatenate([_lift(arm, drawn), out, _lift(arm, _draw_in(arm, out[-2:], np.full(2, 0.5)))])
    return np.asarray(middles[arm.within_limits(middles)])


def _draw_in(arm: Arm, q: Array, share: Array) -> Array:
    """Draw the telescopes of postures (n, joints) in to shares (n,) of their travel."""
    return np.where(arm.prismatic, arm.lower + share[:, None] * (q - arm.lower), q)


def _lift(arm: Arm, q: Array) -> Array:
    """Raise postures (n, joints) by every lift; (n * lifts, joints)."""
    found, height = [], 0.0
    for lift in LIFTS_M:
        while height < lift - 1e-9:
            q, height = _raise(arm, q, LIFT_STEP_M), height + LIFT_STEP_M
        found.append(q)
    return np.concatenate(found)


def _climb(arm: Arm, q: Array, obstacles: Obstacles) -> Array:
    """Climb from postures (n, joints) to where there is more room; some on the way, (m, joints)."""
    found = []
    n, h = len(q), SHIFT_S * arm.max_speed
    shifts = np.concatenate([np.diag(h), -np.diag(h)])
    for step in range(1, CLIMB_STEPS + 1):
        tried = keep_ranges(arm, q[:, None] + shifts)
        free = least_distance(arm, tried.reshape(-1, arm.n), obstacles).reshape(n, 2, arm.n)
        slope = free[:, 0] - free[:, 1]  # each joint measured by its speed: the least time
        size = np.abs(slope).max(axis=1, keepdims=True)
        q = keep_ranges(arm, q + CLIMB_S * arm.max_speed * slope / np.maximum(size, 1e-9))
        if step % CLIMB_KEPT == 0:
            found.append(q)
    return np.concatenate(found)


def _raise(arm: Arm, q: Array, lift: float) -> Array:
    """Raise the nozzle of postures (n, joints) by a small lift [m] with its direction kept, within limits.

    The least effort, each joint measured by its speed. So the whole arm rises, not the lance alone.
    """
    J = arm.jacobian(q)[:, 2:]
    WJt = arm.max_speed[:, None] ** 2 * np.swapaxes(J, 1, 2)
    wanted = np.array([lift, 0.0, 0.0, 0.0])[:, None]
    step = WJt @ np.linalg.solve(J @ WJt + DAMPING * np.eye(4), np.broadcast_to(wanted, (len(q), 4, 1)))
    return keep_ranges(arm, q + step[..., 0])
