"""What the arm may hit: Surface -> distance field of heading and carrier.

Wall (as the scan unrolled it), arches, floor, face, bodies and the carrier are put on a grid over the
tunnel frame, which holds the signed distance to the nearest of them, negative inside. One look-up costs
the same whatever the scan's size. `room.py` makes the heading's surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.body import find_bodies
from ascrcp.kinematics.capsule import Body
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel
from ascrcp.kinematics.kernel_table import FieldTable, Scene, freeze
from ascrcp.kinematics.room import Room

BEHIND = -4.0
"""Station at which the field begins [m]: behind joint 1. Further back the tunnel goes on the same."""

BEYOND = 0.6
"""How far the field reaches into the rock [m]."""

CARRIER_REACH = 1.5
"""How far round the carrier its distance is entered [m]: beyond, nothing asks for it."""

HALF_DIAGONAL = 0.87
"""Most by which the distance at the nearest node is wrong, over a cell: the field's slope is one."""

OUTLINE = 400
"""Points of the design line that give the field's extent."""


class Obstacle(IntEnum):
    """What a link is nearest to."""

    WALL = 0
    ARCH = 1
    FLOOR = 2
    FACE = 3
    BODY = 4
    CARRIER = 5
    ARM = 6


@dataclass(frozen=True)
class Obstacles:
    """The surroundings of the arm.

    Attributes:
        T_tunnel_base: Into the field's frame, shape (4, 4).
        low: Its first node (s, y, z) [m], shape (3,).
        cell: Its spacing [m].
        field: Signed distance at the nodes [m], shape (ns, ny, nz).
        kind: `Obstacle` nearest to each node, shape (ns, ny, nz).
    """

    T_tunnel_base: Array
    low: Array
    cell: float
    field: NDArray[np.float32]
    kind: NDArray[np.uint8]

    @classmethod
    def from_surface(
        cls, surface: Surface, arm: Arm, scan_q: ArrayLike | None = None, bodies: bool = True
    ) -> "Obstacles":
        """Build the field of a recognised heading.

        Wall that was not seen takes the nearest that was; behind the scanned part the arch line stands
        for the sprayed lining, which covers the arches.

        Args:
            surface: The heading.
            arm: For its carrier and the spacing of the field.
            scan_q: Joints at which it was scanned, whose own points are left out; the zero pose if None.
            bodies: Whether vehicles, people and muck count too; without, they are taken to have left.

        Raises:
            InputError: A wall without any value, or an arm without a clearance model.
        """
        model = arm.description.clearance
        if model is None:
            raise InputError(f"machine {arm.name} has no clearance model")
        outline = surface.profile.point(np.linspace(0.0, surface.profile.length, OUTLINE))
        deep = float(np.nanmax(surface.offset, initial=0.0)) + BEYOND
        low = np.array([BEHIND, *(outline.min(axis=0) - deep)])
        high = np.array([surface.unsprayed[1] + BEYOND, *(outline.max(axis=0) + deep)])
        counts = (np.ceil((high - low) / model.cell).astype(int) + 1).tolist()
        axes = [first + model.cell * np.arange(count) for first, count in zip(low, counts, strict=True)]
        room = Room(surface, axes[0], axes[1], axes[2])
        found = find_bodies(surface, room, arm, arm.zero_pose if scan_q is None else scan_q)
        parts = [(room.wall_points(), Obstacle.WALL), (room.arch_points(), Obstacle.ARCH)]
        parts += [(room.floor_points(), Obstacle.FLOOR), (room.face_points(), Obstacle.FACE)]
        parts.append((found if bodies else found[:0], Obstacle.BODY))
        points = np.concatenate([part for part, _ in parts])
        kinds = np.repeat(np.array([k for _, k in parts], np.uint8), [len(part) for part, _ in parts])
        field, kind = _spread(points, kinds, low, tuple(counts), model.cell)
        field[room.is_solid()] *= -1.0
        T_base_tunnel = surface.axis.T_base_tunnel
        for box in arm.description.carrier:
            _put_box(field, kind, axes, T_base_tunnel, np.array([box.low, box.high]))
        return cls(inverse_transform(T_base_tunnel), low, model.cell, field, kind)

    @cached_property
    def table(self) -> FieldTable:
        """The field for the machine code."""
        rotation, offset = self.T_tunnel_base[:3, :3], self.T_tunnel_base[:3, 3] - self.low
        to_nodes = np.column_stack([rotation, offset]) / self.cell
        values = np.ascontiguousarray(self.field).view()
        return freeze(FieldTable(to_nodes, values, HALF_DIAGONAL * self.cell))

    def around(self, body: Body) -> Scene:
        """Return the field with the shapes of an arm in it, for the machine code."""
        return Scene(body.chain, body.shape, self.table)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the table behind: it would carry the field a second time."""
        return {name: value for name, value in vars(self).items() if name != "table"}

    def distance(self, points: Array) -> Array:
        """Read the distance of base-frame points (..., 3) to the heading, linear between nodes; (...)."""
        return kernel("field").read_field(self.table, as_rows(points)).reshape(points.shape[:-1])

    def kind_at(self, points: Array) -> NDArray[np.uint8]:
        """Tell what points (m, 3) of the base frame are nearest to."""
        to_nodes, most = self.table.to_nodes, np.array(self.field.shape) - 1
        index = np.clip(np.rint(points @ to_nodes[:, :3].T + to_nodes[:, 3]), 0, most).astype(np.int64)
        return np.asarray(self.kind[tuple(index.T)])

    def direction(self, points: Array) -> Array:
        """Return the unit direction away from what points (m, 3) are nearest to, base frame."""
        found: Array = kernel("field").find_away(self.table, as_rows(points))
        return found


def box_distance(box: Array, points: Array) -> Array:
    """Signed distances of points (..., 3) to a box given by two corners (2, 3) [m], shape (...)."""
    over = np.abs(points - box.mean(axis=0)) - (box[1] - box[0]) / 2
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(over.max(axis=-1), 0.0))


def _put_box(
    field: NDArray[np.float32],
    kind: NDArray[np.uint8],
    axes: Sequence[Array],
    T_base_tunnel: Array,
    box: Array,
) -> None:
    """Lay a box of the carrier over the field in place, as far round it as matters."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    local = apply_transform(inverse_transform(T_base_tunnel), corners)
    first = [
        int(np.searchsorted(axis, c - CARRIER_REACH)) for axis, c in zip(axes, local.min(0), strict=True)
    ]
    last = [int(np.searchsorted(axis, c + CARRIER_REACH)) for axis, c in zip(axes, local.max(0), strict=True)]
    cut = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    nodes = np.stack(np.meshgrid(*(axis[c] for axis, c in zip(axes, cut, strict=True)), indexing="ij"), -1)
    distance = box_distance(box, apply_transform(T_base_tunnel, nodes.reshape(-1, 3))).reshape(
        nodes.shape[:3]
    )
    nearer = distance < field[cut]
    field[cut] = np.where(nearer, distance, field[cut])
    kind[cut] = np.where(nearer, np.uint8(Obstacle.CARRIER), kind[cut])


def _spread(
    points: Array, kinds: NDArray[np.uint8], low: Array, shape: tuple[int, ...], cell: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Compute each node's distance to the nearest point, and that point's kind.

    The nearest occupied node is found by an exact distance transform; the distance is then taken to the
    point that stands for it, so that the grid's rounding does not enter.
    """
    u = np.rint((points - low) / cell).astype(np.int64)
    inside = ((u >= 0) & (u < np.array(shape))).all(axis=1)
    points, kinds, u = points[inside], kinds[inside], u[inside]
    node = (u[:, 0] * shape[1] + u[:, 1]) * shape[2] + u[:, 2]
    off = ((points - low) / cell - u) ** 2
    order = np.lexsort((off.sum(axis=1), node))
    node, first = np.unique(node[order], return_index=True)
    chosen = order[first]
    owner = np.full(shape, -1, dtype=np.int32)
    owner.reshape(-1)[node] = chosen
    code, field = kernel("nearest"), np.empty(shape, dtype=np.float32)
    across, who = by_halves(code.spread_across, owner, many=2)
    who = by_halves(
        lambda planes: code.spread_along(planes, across, who, points, low, cell, field),
        np.arange(shape[1]),
        many=2,
    )
    return field, np.ascontiguousarray(np.moveaxis(kinds[who], 0, 1))
