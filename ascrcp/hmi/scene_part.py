"""What both 3-D views share: colours of labels, the path as line segments, the arm as a line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Label
from ascrcp.core.geometry import Array
from ascrcp.hmi.theme import SceneColours
from ascrcp.session.snapshot import Scene

FADE = 0.4
"""Share of its brightness the farthest point loses, so that depth can be seen."""

LEAST_DEPTH = 0.1
"""Depth of a picture is taken to be at least this [m]."""

SPRAY_LENGTH = 1.0
"""Length of the line drawn out of the nozzle [m]: the thesis's stand-off."""


@dataclass(frozen=True)
class ArmLine:
    """The arm as the view draws it.

    Attributes:
        chain: Base, joints and nozzle from base to tip [m], shape (k, 3).
        spray: Nozzle and the point one stand-off before it [m], shape (2, 3), None if unknown.
        spraying: Whether concrete flows.
    """

    chain: Array
    spray: Array | None
    spraying: bool


def arm_line(frames: Array, spraying: bool) -> ArmLine:
    """Return the arm from its joint frames.

    Args:
        frames: T_base_joint of each joint and the nozzle, shape (n + 1, 4, 4).
        spraying: Whether concrete flows.
    """
    chain = np.vstack([np.zeros((1, 3)), frames[:, :3, 3]])
    tip = frames[-1]
    spray = np.stack([tip[:3, 3], tip[:3, 3] + SPRAY_LENGTH * tip[:3, 0]])  # spray direction: tool +x
    return ArmLine(chain, spray, spraying)


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green, blue of "#rrggbb", 0..255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def brightness(depth: NDArray, seen: NDArray[np.bool_]) -> NDArray:
    """Return how bright points are, from 1 for the nearest seen to 1 - FADE for the farthest.

    Args:
        depth: Before the eye [m], shape (n,).
        seen: Which of them are in the picture, shape (n,).

    Returns:
        Shares, shape (n,); points out of the picture get those of its nearest or farthest.
    """
    if not seen.any():
        return np.ones(len(depth))
    nearest, farthest = float(depth[seen].min()), float(depth[seen].max())
    share = (depth - nearest) / max(farthest - nearest, LEAST_DEPTH)
    return np.asarray(1.0 - FADE * np.clip(share, 0.0, 1.0))


def label_table(colours: SceneColours) -> NDArray[np.uint8]:
    """Return red, green, blue by label, shape (256, 3): unknown labels look like OTHER."""
    table = np.empty((256, 3), np.uint8)
    table[:] = rgb(colours.other)
    for label in Label:
        table[label] = rgb(getattr(colours, label.name.lower()))
    return table


def unsolved_points(scene: Scene) -> Array:
    """Return the planned points without joints, shape (k, 3); none while nothing is solved yet."""
    if len(scene.solved) != len(scene.path):
        return np.zeros((0, 3))
    return scene.path[~scene.solved]


def path_segments(scene: Scene) -> NDArray[np.int64]:
    """Return the pairs of planned points joined by a line: neighbours within one pass, shape (k, 2)."""
    if len(scene.path) < 2:
        return np.zeros((0, 2), np.int64)
    first = np.flatnonzero(scene.path_pass[1:] == scene.path_pass[:-1])
    return np.stack([first, first + 1], -1)
