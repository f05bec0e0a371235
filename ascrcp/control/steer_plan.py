"""The surface the joystick moves on: SprayPath + solved JointSequence -> SteerPlan.

The planned passes become the rows of a mesh, uniform in the section angle. Each node carries the pose
between the two planned points around it and joints that reach it exactly; it is steerable where the
points beside it are solved on one branch, within the joints' ranges and clear of the surroundings.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.steer_pose import find_joints
from ascrcp.control.steer_relax import relax_joints
from ascrcp.core.errors import InputError
from ascrcp.core.flow import JointSequence, SprayPath
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm

Clear = Callable[[Array], NDArray[np.bool_]]
"""Tells which joint vectors (n, joints) keep clear of the surroundings."""

CONVERGED_M = 1e-3
"""A node whose joints miss its pose by more is left out [m], and [rad]."""


SAME_M = 0.06
"""Passes this near in station are layers of one, or its parts either side of the seam [m]."""

SEAM_RAD = 0.02
"""By so much the two parts may overlap [rad]."""

BETWEEN = (0.25, 0.5, 0.75)
"""Where between two rows the way across is tried."""


@dataclass(frozen=True)
class SteerPlan:
    """A mesh of rows (passes) and columns (section angles).

    Attributes:
        angle: Section angle of the columns [rad], uniform step, shape (a,).
        q: Joints [rad, m], NaN where not steerable, shape (r, a, joints).
        position: Nozzle [m], base frame, NaN where nothing is planned, shape (r, a, 3).
        direction: Unit spray direction, shape (r, a, 3).
        node: Steerable nodes, shape (r, a).
        cross: Whether the nozzle may cross from row i to i + 1 in this column, shape (r - 1, a).
        point: Nearest planned point of each node, -1 if none, shape (r, a).
        area: Number of the connected area each node lies in, -1 outside, shape (r, a): from one to
            another the stick does not get.
    """

    angle: Array
    q: Array
    position: Array
    direction: Array
    node: NDArray[np.bool_]
    cross: NDArray[np.bool_]
    point: NDArray[np.int64]
    area: NDArray[np.int64]

    def nearest(self, position: Array, left: frozenset[int] = frozenset()) -> tuple[int, int]:
        """Return row and column of the steerable node nearest to a nozzle position [m].

        Args:
            position: Of the nozzle, base frame, shape (3,).
            left: Areas the operator has left for another; all count again once all have been left.

        Raises:
            InputError: No node is steerable.
        """
        if not self.node.any():
            raise InputError("no part of the plan can be steered: no two neighbouring points are solved")
        distance = np.linalg.norm(self.position - position, axis=-1)
        distance[~self.node] = np.inf
        others = self.node & ~np.isin(self.area, list(left))
        if others.any():
            distance[~others] = np.inf
        row, column = np.unravel_index(int(distance.argmin()), distance.shape)
        return int(row), int(column)


def build_steer_plan(
    arm: Arm,
    path: SprayPath,
    sequence: JointSequence,
    config: SteerConfig,
    payload_kg: float = 0.0,
    clear: Clear | None = None,
) -> SteerPlan:
    """Mesh the planned points that have joints.

    Args:
        arm: The arm.
        path: Planned points; which pass each belongs to.
        sequence: Solved joints; its rows at planned points hold the pose as driven.
        config: Mesh and limits.
        payload_kg: Concrete in the hose [kg], for the sag.
        clear: Tells which poses keep clear; None if nothing is known of the surroundings.

    Raises:
        InputError: Path and sequence do not belong together, or nothing is solved.
    """
    at = np.flatnonzero(sequence.point >= 0)
    index = sequence.point[at]
    if not len(index) or int(index.max()) >= len(path):
        raise InputError(f"the joint sequence does not belong to this path of {len(path)} points")
    rows = _find_rows(path, index)
    step = config.step_m / max(float(np.median(_arc_radius(path, index))), 0.1)
    low, high = float(path.angle[index].min()), float(path.angle[index].max())
    angle = low + step * np.arange(int((high - low) / step) + 1, dtype=np.float64)
    mesh = _Mesh(arm, config, payload_kg, len(rows), angle, [bool(path.overbreak[row[0]]) for row in rows])
    for r, members in enumerate(rows):
        mesh.lay_row(r, sequence, path, at[np.isin(index, members)])
    mesh.settle(None)
    mesh.relax()
    mesh.settle(clear)
    mesh.tear(clear)
    cross = mesh.bridge(clear)
    area = find_areas(mesh.node, cross)
    return SteerPlan(angle, mesh.q, mesh.position, mesh.direction, mesh.node, cross, mesh.point, area)


def find_areas(node: NDArray[np.bool_], cross: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number the connected areas of a mesh, the largest 0; -1 outside, shape (r, a)."""
    from scipy.sparse import coo_matrix  # not where a plan is only followed: the application starts sooner
    from scipy.sparse.csgraph import connected_components

    number = np.arange(node.size).reshape(node.shape)
    along = node[:, :-1] & node[:, 1:]
    a = np.concatenate([number[:, :-1][along], number[:-1][cross]])
    b = np.concatenate([number[:, 1:][along], number[1:][cross]])
    links = coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(node.size, node.size))
    label = connected_components(links, directed=False)[1].reshape(node.shape)
    found, counts = np.unique(label[node], return_counts=True)
    area = np.full(node.shape, -1, np.int64)
    for rank, name in enumerate(found[np.argsort(-counts, kind="stable")]):
        area[node & (label == name)] = rank
    return area


def _arc_radius(path: SprayPath, index: NDArray[np.int64]) -> Array:
    """Distance moved per section angle between neighbouring points of a pass [m/rad]."""
    a, b = index[:-1], index[1:]
    joined = (path.pass_index[a] == path.pass_index[b]) & (np.abs(path.angle[b] - path.angle[a]) > 1e-6)
    a, b = a[joined], b[joined]
    if not len(a):
        raise InputError("no pass of the plan has two solved points side by side")
    gap = np.linalg.norm(path.position[b] - path.position[a], axis=1)
    return np.asarray(gap / np.abs(path.angle[b] - path.angle[a]))


def _find_rows(path: SprayPath, index: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Group planned points into rows: one pass, or its two parts either side of the seam.

    Where several layers are planned one over the other, the longest pass stands for all. Overbreak
    passes come after those of the bays; within each the stations rise.
    """
    passes = []
    for number in np.unique(path.pass_index[index]):
        members = np.flatnonzero(path.pass_index == number)
        passes.append((bool(path.overbreak[members[0]]), float(path.station[members].mean()), members))
    rows: list[tuple[bool, float, NDArray[np.int64]]] = []
    for is_pocket, station, members in sorted(passes, key=lambda row: -len(row[2])):
        beside = [k for k, row in enumerate(rows) if row[0] == is_pocket and abs(row[1] - station) < SAME_M]
        if not beside:
            rows.append((is_pocket, station, members))
            continue
        taken = np.concatenate([path.angle[rows[k][2]] for k in beside])
        inside = path.angle[members]
        if taken.max() < inside.min() + SEAM_RAD or inside.max() - SEAM_RAD < taken.min():
            k = beside[0]
            rows[k] = (is_pocket, rows[k][1], np.concatenate([rows[k][2], members]))
    rows.sort(key=lambda row: (row[0], row[1]))
    return [members for _, _, members in rows]


class _Mesh:
    """The mesh while it is made; arrays as in SteerPlan."""

    def __init__(
        self, arm: Arm, config: SteerConfig, payload_kg: float, rows: int, angle: Array, pocket: list[bool]
    ) -> None:
        """Args: pocket: whether each row fills overbreak: no crossing between those and the bays'."""
        self._arm, self._config, self._payload = arm, config, payload_kg
        self._angle, self._pocket = angle, np.array(pocket)
        self._branch = np.where(arm.prismatic, config.branch_m, config.branch_rad)
        shape = (rows, len(angle))
        self.q = np.full((*shape, arm.n), np.nan)
        self.position, self.direction = np.full((*shape, 3), np.nan), np.full((*shape, 3), np.nan)
        self.point = np.full(shape, -1, np.int64)
        self.node: NDArray[np.bool_] = np.zeros(shape, np.bool_)

    def lay_row(self, r: int, sequence: JointSequence, path: SprayPath, at: NDArray[np.int64]) -> None:
        """Put poses and first joints onto a row's nodes, where both neighbours are solved on one branch."""
        order = at[np.argsort(path.angle[sequence.point[at]], kind="stable")]
        members = sequence.point[order]
        for a, b, i, j in zip(order[:-1], order[1:], members[:-1], members[1:], strict=True):
            same = path.pass_index[i] == path.pass_index[j] and abs(int(i) - int(j)) == 1
            if not same or not (np.abs(sequence.q[b] - sequence.q[a]) <= self._branch).all():
                continue
            begin, end = path.angle[i], path.angle[j]
            cut = np.flatnonzero((self._angle >= begin - 1e-9) & (self._angle <= end + 1e-9))
            share = ((self._angle[cut] - begin) / max(end - begin, 1e-9))[:, None]
            self.q[r, cut] = sequence.q[a] + share * (sequence.q[b] - sequence.q[a])
            way = sequence.position[b] - sequence.position[a]
            self.position[r, cut] = sequence.position[a] + share * way
            turned = sequence.direction[a] + share * (sequence.direction[b] - sequence.direction[a])
            self.direction[r, cut] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
            self.point[r, cut] = np.where(share[:, 0] < 0.5, i, j)
            self.node[r, cut] = True

    def settle(self, clear: Clear | None) -> None:
        """Bring the nodes' joints onto their poses; keep those that succeed, in range and clear."""
        node = self.node
        found, good = self._solve(self.q[node], self.position[node], self.direction[node], clear)
        self.q[node] = found
        node[node] = good
        self.q[~node] = np.nan

    def relax(self) -> None:
        """Smooth the joints along and across the rows."""
        node = self.node
        number = np.full(node.shape, -1, np.int64)
        number[node] = np.arange(int(node.sum()))
        with np.errstate(invalid="ignore"):
            same = (np.abs(self.q[:, 1:] - self.q[:, :-1]) <= self._branch).all(-1)
        along, across = node[:, :-1] & node[:, 1:] & same, self._neighbours()
        edges = np.concatenate(
            [
                np.stack([number[:, :-1][along], number[:, 1:][along]], 1),
                np.stack([number[:-1][across], number[1:][across]], 1),
            ]
        )
        self.q[node] = relax_joints(
            self._arm, self.q[node], self.position[node], self.direction[node], edges, self._payload
        )

    def tear(self, clear: Clear | None) -> None:
        """Take a node out of a row where the next is not reached from it: at the seam, on another branch."""
        with np.errstate(invalid="ignore"):
            same = (np.abs(self.q[:, 1:] - self.q[:, :-1]) <= self._branch).all(-1)
        joined = np.asarray(self.node[:, :-1] & self.node[:, 1:])
        tried = joined & same
        q, position, direction = (
            0.5 * (values[:, :-1] + values[:, 1:])[tried]
            for values in (self.q, self.position, self.direction)
        )
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        sound = np.zeros_like(joined)
        sound[tried] = self._solve(q, position, direction, clear)[1]
        self.node[:, 1:][joined & ~sound] = False
        self.q[~self.node] = np.nan

    def bridge(self, clear: Clear | None) -> NDArray[np.bool_]:
        """Tell where the nozzle may cross between neighbouring rows: one branch, all the way reachable."""
        cross = self._neighbours()
        for share in BETWEEN:
            a, b = 1.0 - share, share
            q, position, direction = (
                (a * values[:-1] + b * values[1:])[cross]
                for values in (self.q, self.position, self.direction)
            )
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            cross[cross] = self._solve(q, position, direction, clear)[1]
        return cross

    def _neighbours(self) -> NDArray[np.bool_]:
        """Tell which nodes of neighbouring rows lie near each other and on one branch, shape (r - 1, a)."""
        near: NDArray[np.bool_] = np.asarray(self.node[:-1] & self.node[1:])
        near[self._pocket[:-1] != self._pocket[1:]] = False
        with np.errstate(invalid="ignore"):
            same = (np.abs(self.q[1:] - self.q[:-1]) <= self._branch).all(-1)
            gap = np.linalg.norm(self.position[1:] - self.position[:-1], axis=-1)
            return np.asarray(near & same & (gap <= self._config.row_gap_m))

    def _solve(
        self, q: Array, position: Array, direction: Array, clear: Clear | None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Bring joints (n, joints) onto poses; tell which reach them, in range and clear."""
        found, miss = find_joints(self._arm, q, position, direction, self._payload)
        good: NDArray[np.bool_] = np.asarray((miss <= CONVERGED_M) & self._arm.within_limits(found))
        if clear is not None and good.any():
            good[good] = clear(found[good])
        return found, good
