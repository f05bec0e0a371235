"""Route of a joint move: two postures -> postures to pass through, clear of everything on the way.

Straight first. Where that comes too near to something, a small graph is searched: both ends, their mean
and the zero pose, drawn in and raised in steps, and climbs to where there is more room, joined by straight
legs. Legs are looked at only when the cheapest route uses them (lazy shortest path: Dellin and
Srinivasa, ICAPS 2016). Where that finds nothing, an end stands in a pocket that only its own stroke leads
out of: the strokes' postures join the graph, each to its neighbours on the stroke and to the middles.
"""

from collections.abc import Sequence

import numpy as np

from ascrcp.core.errors import InputError, UnreachableError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.capsule import make_body
from ascrcp.kinematics.clearance import clearance, least_distance
from ascrcp.kinematics.description import ClearanceModel
from ascrcp.kinematics.kernel_call import kernel
from ascrcp.kinematics.kernel_table import LegRule, freeze
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

FEW = np.array([0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875, 0.0, 1.0])
"""Shares of a leg at which it is looked at before it is looked at closely: most bad legs are seen through
at the first."""

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

MOST_ROUNDS = 1000
"""A search gives up after so many rounds; those that find a way need a few dozen, and most that find none end
before, with no leg left."""

MORE_ROUNDS = 4000
"""The same with the postures of strokes, which are many; placeholder."""

TRAIL_S = 0.7
"""A trail's postures begin so far apart [s] and lie further apart with every one; placeholder."""

TRAIL_GROWTH = 1.08
"""Factor from one such distance to the next: pockets are near the ends of a move; placeholder."""

TRAIL_REACH = 3
"""A trail's posture is joined to so many of the next ones on it."""

SLACK = 1e-6
"""Rounding allowed on a clearance [m]."""


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
    kept, nearest = scout.look_along(np.stack([start, *first, end]), least)
    if kept.min() >= enough:
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
    met = clearance(arm, nearest[kept.argmin()], obstacles).describe(arm, 0)
    raise UnreachableError(f"no clear way found; straight, {met}, at least {model.least:g} m is kept")


class _Scout:
    """Looks at straight legs and searches the graph of them."""

    def __init__(self, arm: Arm, obstacles: Obstacles, model: ClearanceModel) -> None:
        self._speed, self._scene = arm.max_speed, obstacles.around(make_body(arm))
        speed = arm.max_speed.copy()
        self._rule = freeze(LegRule(FEW, speed, ROW_M, model.wanted, model.least, NEAR_PRICE, STOP_S))

    def look_along(self, stops: Array, floor: float) -> tuple[Array, Array]:
        """Look closely at legs from stop to stop: what each keeps [m], and the posture that has it."""
        kept, nearest, _ = kernel("route").look_along(self._scene, self._rule, stops, floor)
        return kept, nearest

    def search(self, nodes: Array, floor: float, trails: Sequence[Array] = ()) -> list[Array] | None:
        """Find the cheapest route from the first node to the second; None if none is found."""
        hubs, most = len(nodes), MORE_ROUNDS if trails else MOST_ROUNDS
        nodes = np.concatenate([nodes, *trails])
        price = (np.abs(nodes[:, None] - nodes) / self._speed).max(axis=-1) + STOP_S
        along = np.arange(len(nodes))
        trail = np.repeat(np.arange(len(trails) + 1), [hubs, *map(len, trails)])
        apart = (np.minimum.outer(along, along) >= hubs) & (
            np.abs(np.subtract.outer(along, along)) > TRAIL_REACH
        )
        price[apart & np.equal.outer(trail, trail)] = np.inf
        route = kernel("route").search(self._scene, self._rule, nodes, price, floor, most)
        return [nodes[i] for i in route.tolist()] or None


def thin_trail(arm: Arm, trail: Array) -> Array:
    """Thin a trail's postures (m, joints): close together where it begins, further apart further on."""
    way = np.abs(np.diff(trail, axis=0, prepend=trail[:1])) / arm.max_speed
    along, kept, step = np.cumsum(way.max(axis=1)), [0], TRAIL_S
    for i in range(1, len(trail)):
        if along[i] - along[kept[-1]] >= step or i == len(trail) - 1:
            kept.append(i)
            step *= TRAIL_GROWTH
    return trail[kept]


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
    return keep_ranges(arm, kernel("task").raise_tool(arm.table, q, arm.max_speed**2, lift, DAMPING))
