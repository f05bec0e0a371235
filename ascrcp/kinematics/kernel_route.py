"""Machine code of routes: postures and what legs between them would take -> the cheapest clear way.

Callers use `route.py`. The graph is dense and small: some fifty postures, at most a few hundred.
"""

import numpy as np
from numba import float64, int64
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_chain import walk
from ascrcp.kinematics.kernel_clearance import SCENE, Desk, is_near, make_desk, measure
from ascrcp.kinematics.kernel_compiler import array_of, part, table_of, whole
from ascrcp.kinematics.kernel_field import LINES
from ascrcp.kinematics.kernel_table import LegRule, Scene

VECTOR = array_of(float64, 1)
RULE = table_of(LegRule, VECTOR, VECTOR, float64, float64, float64, float64, float64)


@part
def _between(a: Array, b: Array, share: float, q: Array) -> None:
    """Put a posture at a share of a leg into q."""
    for i in range(len(q)):
        q[i] = a[i] + share * (b[i] - a[i])


@part
def _travel(scene: Scene, rule: LegRule, a: Array, b: Array, q: Array, desk: Desk) -> float:
    """Measure how far the joint or nozzle that moves most moves on a leg [m]."""
    count = len(rule.shares)
    way, before = np.zeros(len(desk.frames)), np.empty((len(desk.frames), 3))
    for look in range(count):
        _between(a, b, look / (count - 1), q)
        walk(scene.chain, q, desk.frames, desk.joints)
        for k in range(len(way)):
            square = 0.0
            for i in range(3):
                square += (desk.frames[k, 3, i] - before[k, i]) ** 2 if look else 0.0
                before[k, i] = desk.frames[k, 3, i]
            way[k] += np.sqrt(square)
    return way.max()


@part
def _look(
    scene: Scene, rule: LegRule, a: Array, b: Array, floor: float, at: Array, desk: Desk
) -> tuple[float, float]:
    """Look at a leg closely; see `look_along`, of one leg. The posture that is nearest is put into at."""
    q = np.empty(len(a))
    count = max(int(np.ceil(_travel(scene, rule, a, b, q, desk) / rule.row)) + 1, len(rule.shares))
    least, short = np.inf, 0.0
    for look in range(count):
        _between(a, b, look / (count - 1), q)
        free = measure(scene, q, desk)
        short += max(rule.wanted - free, 0.0) / (rule.wanted - rule.least)
        if not free >= least:
            least = free
            at[:] = q
    time = 0.0
    for i in range(len(a)):
        time = max(time, abs(b[i] - a[i]) / rule.speed[i])
    price = time * (1.0 + rule.near_price * short / count) + rule.stop if least >= floor else np.inf
    return least, price


@part
def _is_barred(scene: Scene, rule: LegRule, a: Array, b: Array, floor: float, q: Array, desk: Desk) -> bool:
    """Tell whether any of a few postures of a leg is nearer to anything than the floor."""
    for share in rule.shares:
        _between(a, b, share, q)
        if is_near(scene, q, floor, desk):
            return True
    return False


@part
def _find_way(price: Array) -> NDArray[np.int64]:
    """Find the cheapest way from node 0 to node 1, backwards; empty if there is none (Dijkstra, dense)."""
    n = len(price)
    total, before, done = np.full(n, np.inf), np.full(n, -1, np.int64), np.zeros(n, np.bool_)
    total[0] = 0.0
    for _ in range(n):
        here = -1
        for i in range(n):
            if not done[i] and total[i] < np.inf and (here < 0 or total[i] < total[here]):
                here = i
        if here < 0 or here == 1:
            break
        done[here] = True
        for i in range(n):
            reached = total[here] + price[here, i]
            if reached < total[i]:
                total[i], before[i] = reached, here
    way, count, node = np.empty(n, np.int64), 0, 1
    if total[1] < np.inf:
        while node >= 0:
            way[count], count, node = node, count + 1, before[node]
    return way[:count]


@whole(SCENE, RULE, LINES, float64)
def look_along(scene: Scene, rule: LegRule, stops: Array, floor: float) -> tuple[Array, Array, Array]:
    """Look closely at the straight legs from stop to stop.

    Args:
        scene: Arm and surroundings.
        rule: How legs are looked at.
        stops: Joints [rad, m], shape (n, joints).
        floor: Least clearance [m].

    Returns:
        Of each leg the least clearance [m] (n - 1,), the posture that has it (n - 1, joints), the price [s],
        infinite below the floor (n - 1,).
    """
    n, desk = len(stops) - 1, make_desk(scene, stops)
    least, at, price = np.empty(n), np.empty((n, stops.shape[1])), np.empty(n)
    for k in range(n):
        least[k], price[k] = _look(scene, rule, stops[k], stops[k + 1], floor, at[k], desk)
    return least, at, price


@whole(SCENE, RULE, LINES, LINES, float64, int64)
def search(
    scene: Scene, rule: LegRule, nodes: Array, price: Array, floor: float, most: int
) -> NDArray[np.int64]:
    """Find the cheapest clear route from the first node to the second (lazy shortest path).

    A leg is looked at only when the cheapest route uses it, at a few postures and then closely.

    Args:
        scene: Arm and surroundings.
        rule: How legs are looked at.
        nodes: Postures [rad, m], shape (n, joints).
        price: What legs cost if they are clear [s], infinite for those that are not to be used, (n, n).
        floor: Least clearance of a leg [m].
        most: Routes looked at before it is given up.

    Returns:
        The nodes on the way, both ends included; none if no way is found.
    """
    n, desk = len(nodes), make_desk(scene, nodes)
    price, looked, q = price.copy(), np.zeros((n, n), np.bool_), np.empty(nodes.shape[1])
    for _ in range(most):
        way = _find_way(price)
        is_sure = True
        for k in range(len(way) - 1, 0, -1):
            a, b = way[k], way[k - 1]
            if looked[a, b]:
                continue
            is_sure = False
            looked[a, b] = looked[b, a] = True
            cost = np.inf
            if not _is_barred(scene, rule, nodes[a], nodes[b], floor, q, desk):
                cost = _look(scene, rule, nodes[a], nodes[b], floor, q, desk)[1]
            price[a, b] = price[b, a] = cost
            if cost == np.inf:
                break
        if is_sure:
            return way[::-1].copy()
    return np.empty(0, np.int64)
