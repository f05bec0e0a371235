"""Machine code of clearance: joint vectors -> what links keep from the field and from each other.

Capsules are placed, lowered by the sag and looked up in the distance field posture by posture, with no array
between. Callers use `clearance.py`, `barrier.py` and `capsule.py`. Every posture is computed by itself:
results hang neither on how many are given at once nor on threads.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.kernel_chain import CHAIN, make_room, walk
from ascrcp.kinematics.kernel_compiler import array_of, part, table_of, whole
from ascrcp.kinematics.kernel_field import FIELD, LINES, lead_away, read, read_nearest
from ascrcp.kinematics.kernel_table import SAG_STEP, SLIDE, ChainTable, Scene, ShapeTable

TINY = 1e-12
"""Squared lengths [m^2] below this are those of points, such determinants [m^4] those of parallels."""

SHAPE = table_of(
    ShapeTable,
    array_of(int64, 1),
    array_of(float64, 3),
    array_of(float64, 1),
    array_of(int64, 1),
    array_of(float64, 1),
    array_of(int64, 2),
    array_of(float64, 1),
)
SCENE = table_of(Scene, CHAIN, SHAPE, FIELD)


class Desk(NamedTuple):
    """Room for what is worked out for one posture.

    Attributes:
        frames, joints: See `walk`.
        ends: Both ends of every capsule [m], shape (c, 2, 3).
        points: Samples, sagged [m], shape (m, 3).
        free: Their distances less the radius [m], shape (m,).
        on, trial: Nearest points of the axes of the nearest pair and of one pair [m], shape (2, 3).
    """

    frames: Array
    joints: Array
    ends: Array
    points: Array
    free: Array
    on: Array
    trial: Array


@part
def make_desk(scene: Scene, q: Array) -> Desk:
    """Make room for postures (n, joints)."""
    (frames, joints), shape = make_room(q), scene.shape
    ends, count = np.empty((len(shape.joint), 2, 3)), len(shape.share)
    points, free = np.empty((count, 3)), np.empty(count)
    return Desk(frames, joints, ends, points, free, np.zeros((2, 3)), np.empty((2, 3)))


@part
def _place(chain: ChainTable, shape: ShapeTable, q: Array, frames: Array, joints: Array, ends: Array) -> None:
    """Place both ends of every capsule at a joint vector, without sag, into ends (c, 2, 3)."""
    walk(chain, q, frames, joints)
    for c in range(len(shape.joint)):
        if shape.joint[c] == 0:
            ends[c] = shape.ends[c]
            continue
        frame = frames[shape.joint[c] - 1]
        for e in range(2):
            for i in range(3):
                place = frame[3, i]
                for k in range(3):
                    place += shape.ends[c, e, k] * frame[k, i]
                ends[c, e, i] = place


@part
def _drop(shape: ShapeTable, x: float, y: float) -> float:
    """Read the sag at a point's own reach [m]."""
    reach = math.sqrt(x * x + y * y) / SAG_STEP
    i = min(int(reach), len(shape.sag) - 2)
    return shape.sag[i] + (reach - i) * (shape.sag[i + 1] - shape.sag[i])


@part
def _put(ends: Array, share: float, point: Array) -> None:
    """Put a point (3,) at a share of the way between two ends (2, 3)."""
    for i in range(3):
        point[i] = ends[0, i] + share * (ends[1, i] - ends[0, i])


@part
def _sample(scene: Scene, q: Array, desk: Desk) -> float:
    """Place the samples of all capsules that move and read the field at the nodes nearest to them.

    Args:
        scene: Arm and surroundings.
        q: One joint vector, shape (joints,).
        desk: Takes ends, points and free.

    Returns:
        The least distance less the radius [m].
    """
    shape, ends, points, free = scene.shape, desk.ends, desk.points, desk.free
    _place(scene.chain, shape, q, desk.frames, desk.joints, ends)
    least = np.inf
    for c in range(len(shape.joint)):
        for m in range(shape.first[c], shape.first[c + 1]):
            _put(ends[c], shape.share[m], points[m])
            if shape.joint[c] <= 1:  # the slew only turns it on the carrier
                free[m] = np.inf
                continue
            points[m, 2] -= _drop(shape, points[m, 0], points[m, 1])
            free[m] = read_nearest(scene.field, points[m]) - shape.radius[c]
            least = min(least, free[m])
    return least


@part
def gap(a: Array, b: Array, on: Array) -> float:
    """Find the distance of segments a and b, each (2, 3), and put the closest points into on (2, 3).

    Minimises the squared distance over both shares: the free minimum clamped, then each share once more
    for the other's value (Ericson, Real-Time Collision Detection, 5.1.9).
    """
    uu = uv = vv = uw = vw = 0.0
    for i in range(3):
        u, v, w = a[1, i] - a[0, i], b[1, i] - b[0, i], a[0, i] - b[0, i]
        uu, uv, vv, uw, vw = uu + u * u, uv + u * v, vv + v * v, uw + u * w, vw + v * w
    det = uu * vv - uv * uv
    s = min(max((uv * vw - vv * uw) / det, 0.0), 1.0) if det > TINY else 0.0
    t = min(max((uv * s + vw) / max(vv, TINY), 0.0), 1.0)
    s = min(max((uv * t - uw) / max(uu, TINY), 0.0), 1.0)
    square = 0.0
    for i in range(3):
        on[0, i] = a[0, i] + s * (a[1, i] - a[0, i])
        on[1, i] = b[0, i] + t * (b[1, i] - b[0, i])
        square += (on[1, i] - on[0, i]) ** 2
    return math.sqrt(square)


@part
def _lower(shape: ShapeTable, ends: Array) -> None:
    """Lower both ends of every capsule (c, 2, 3) by the sag."""
    for c in range(len(ends)):
        for e in range(2):
            ends[c, e, 2] -= _drop(shape, ends[c, e, 0], ends[c, e, 1])


@part
def _nearest_pair(shape: ShapeTable, desk: Desk) -> tuple[float, int]:
    """Find the nearest pair of capsules, placed without sag: distance [m] and number; fills the desk's on."""
    _lower(shape, desk.ends)
    least, nearest = np.inf, 0
    for k in range(len(shape.pairs)):
        i, j = shape.pairs[k, 0], shape.pairs[k, 1]
        distance = gap(desk.ends[i], desk.ends[j], desk.trial) - shape.radius[i] - shape.radius[j]
        if distance < least:
            least, nearest = distance, k
            desk.on[:] = desk.trial
    return least, nearest


@part
def measure(scene: Scene, q: Array, desk: Desk) -> float:
    """Measure the least distance of the arm at one joint vector to its surroundings and of its links [m].

    The field is read at the nearest node first, and between nodes only where that can matter.
    """
    shape, slack, least = scene.shape, scene.field.slack, np.inf
    limit = _sample(scene, q, desk) + 2.0 * slack
    for c in range(len(shape.joint)):
        for m in range(shape.first[c], shape.first[c + 1]):
            if desk.free[m] < limit:
                least = min(least, read(scene.field, desk.points[m]) - shape.radius[c])
                limit = min(limit, least + slack)
    return min(least, _nearest_pair(shape, desk)[0])


@part
def is_near(scene: Scene, q: Array, floor: float, desk: Desk) -> bool:
    """Tell whether the arm at one joint vector is nearer to anything than the floor [m]."""
    shape, point = scene.shape, desk.points[0]
    _place(scene.chain, shape, q, desk.frames, desk.joints, desk.ends)
    for c in range(len(shape.joint) - 1, -1, -1):  # the nozzle is near most often
        if shape.joint[c] <= 1:
            continue
        limit = floor + shape.radius[c]
        for m in range(shape.first[c + 1] - 1, shape.first[c] - 1, -1):
            _put(desk.ends[c], shape.share[m], point)
            point[2] -= _drop(shape, point[0], point[1])
            may_be = read_nearest(scene.field, point) < limit + scene.field.slack
            if may_be and not read(scene.field, point) >= limit:
                return True
    return not _nearest_pair(shape, desk)[0] >= floor


@whole(CHAIN, SHAPE, LINES)
def place_ends(chain: ChainTable, shape: ShapeTable, q: Array) -> Array:
    """Place both ends of every capsule, sagged, at joint vectors (n, joints); (n, c, 2, 3) [m]."""
    (frames, joints), ends = make_room(q), np.empty((len(q), len(shape.joint), 2, 3))
    for row in range(len(q)):
        _place(chain, shape, q[row], frames, joints, ends[row])
        _lower(shape, ends[row])
    return ends


@whole(SCENE, LINES)
def find_rough(scene: Scene, q: Array) -> Array:
    """Find the least value of the nodes nearest to the samples at joint vectors (n, joints); (n,) [m]."""
    found, desk = np.empty(len(q)), make_desk(scene, q)
    for row in range(len(q)):
        found[row] = _sample(scene, q[row], desk)
    return found


@whole(SCENE, LINES)
def find_least(scene: Scene, q: Array) -> Array:
    """Find the least distance of the arm to its surroundings and of its links to each other; (n,) [m]."""
    found, desk = np.empty(len(q)), make_desk(scene, q)
    for row in range(len(q)):
        found[row] = measure(scene, q[row], desk)
    return found


@whole(SCENE, LINES, float64)
def find_links(scene: Scene, q: Array, within: float) -> tuple[Array, Array, Array, NDArray[np.int64], Array]:
    """Find what every link keeps from the surroundings, and the nearest pair of links.

    Args:
        scene: Arm and surroundings.
        q: Joint vectors [rad, m], shape (n, joints).
        within: Distance below which every link's is exact [m], and nothing is said of pairs; negative: only
            the least of each row is. The others are wrong by up to a cell's half diagonal.

    Returns:
        Distances of the links [m], infinite for those that stay with the carrier, (n, c); the samples
        that have them [m], (n, c, 3); distance [m] and number of the nearest pair, (n,) each; the points
        of the two axes that are nearest [m], (n, 2, 3).
    """
    n, shape, desk = len(q), scene.shape, make_desk(scene, q)
    count, points, free = len(shape.joint), desk.points, desk.free
    distance, centre = np.empty((n, count)), np.empty((n, count, 3))
    own, pair, on = np.empty(n), np.empty(n, np.int64), np.empty((n, 2, 3))
    for row in range(n):
        limit = _sample(scene, q[row], desk) + 2.0 * scene.field.slack
        if within >= 0.0:
            limit = within + scene.field.slack
        for c in range(count):
            nearest = shape.first[c]
            for m in range(shape.first[c], shape.first[c + 1]):
                if free[m] < limit:
                    free[m] = read(scene.field, points[m]) - shape.radius[c]
                if free[m] < free[nearest]:
                    nearest = m
            distance[row, c] = free[nearest]
            centre[row, c] = points[nearest]
        own[row], pair[row] = np.inf, 0
        if within < 0.0:
            own[row], pair[row] = _nearest_pair(shape, desk)
        on[row] = desk.on
    return distance, centre, own, pair, on


@whole(SCENE, LINES, LINES, array_of(float64, 3), LINES, float64)
def find_push(
    scene: Scene, q: Array, distance: Array, centre: Array, stiffness: Array, soft: float
) -> tuple[Array, Array]:
    """Linearise the cost of links that are too near; see `Barrier.terms`.

    Args:
        scene: Arm and surroundings.
        q: Joint vectors [rad, m], shape (n, joints).
        distance: Of the links [m], shape (n, c).
        centre: Their samples that have it [m], shape (n, c, 3).
        stiffness: Cost of a squared metre of each, shape (n, c).
        soft: Distance below which a link pushes [m].

    Returns:
        Half the second derivative (n, joints, joints) and the gradient (n, joints).
    """
    (n, count), desk, motion = q.shape, make_desk(scene, q), scene.chain.motion
    blocks, slope = np.zeros((n, count, count)), np.zeros((n, count))
    away, rise, joints = np.empty(3), np.empty(count), desk.joints
    for row in range(n):
        if not (distance[row] < soft).any():
            continue
        walk(scene.chain, q[row], desk.frames, joints)
        for c in range(len(scene.shape.joint)):
            if not distance[row, c] < soft:
                continue
            point, depth = centre[row, c], soft - distance[row, c]
            lead_away(scene.field, point, away)
            rise[:] = 0.0
            for k in range(len(motion)):
                joint = motion[k, 2]
                if joint < 0 or joint >= scene.shape.joint[c]:  # only joints up to the link's own carry it
                    continue
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    step = joints[joint, 0, i]
                    if motion[k, 0] != SLIDE:
                        step = joints[joint, 0, j] * (point[m] - joints[joint, 1, m])
                        step -= joints[joint, 0, m] * (point[j] - joints[joint, 1, j])
                    rise[joint] += away[i] * step
            for i in range(count):
                slope[row, i] -= stiffness[row, c] * depth * rise[i]
                for j in range(count):
                    blocks[row, i, j] += stiffness[row, c] * rise[i] * rise[j]
    return blocks, slope
