"""Parts of the 3-D view as plain arrays: colours of labels, path lines with arrows, the arm as a line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Label
from ascrcp.core.geometry import Array
from ascrcp.hmi.camera import NEAR, Camera
from ascrcp.hmi.theme import SceneColours, rgb
from ascrcp.session.snapshot import Scene

SPRAY_LENGTH = 1.0
"""Length of the line drawn out of the nozzle [m]: the thesis's stand-off."""
ARROW_EVERY = 20
"""Planned points from one arrow to the next."""
ARROW_PX, ARROW_DEG = 7.0, 28.0
"""Length of an arrow's wings and their angle off the line."""


@dataclass(frozen=True)
class ArmLine:
    """The arm as the view draws it.

    Attributes:
        chain: Base, joints and nozzle from base to tip [m], shape (k, 3).
        spray: Nozzle and the point one stand-off before it [m], shape (2, 3).
        spraying: Whether concrete flows.
    """

    chain: Array
    spray: Array
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


def project_lines(lines: Array, camera: Camera, width: int, height: int) -> Array:
    """Bring lines onto the picture, those wholly before the eye; (k, 2, 3) -> (j, 2, 2) pixels."""
    if not len(lines):
        return np.zeros((0, 2, 2))
    pixels, depth = camera.project(lines.reshape(-1, 3), width, height)
    seen = (depth.reshape(-1, 2) > NEAR).all(axis=1)
    return pixels.reshape(-1, 2, 2)[seen]


def arrow_wings(lines: Array) -> Array:
    """Return two wings at the middle of every so many lines; (k, 2, 2) -> (j, 2, 2) pixels."""
    chosen = lines[ARROW_EVERY // 2 :: ARROW_EVERY]
    along = chosen[:, 1] - chosen[:, 0]
    length = np.linalg.norm(along, axis=1)
    chosen, along = chosen[length > 1.0], along[length > 1.0] / length[length > 1.0, None]
    tip = chosen.mean(axis=1) + 0.5 * ARROW_PX * along
    wings = []
    for side in (-1.0, 1.0):
        a = np.radians(180.0 + side * ARROW_DEG)
        turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        wings.append(np.stack([tip, tip + ARROW_PX * along @ turn.T], axis=1))
    return np.concatenate(wings)


def wall_hits(scene: Scene) -> Array:
    """Return where jets meet the wall, a stand-off before each planned nozzle, shape (m, 3) or (0, 3)."""
    if len(scene.path_direction) != len(scene.path):
        return np.zeros((0, 3))
    return scene.path + SPRAY_LENGTH * scene.path_direction
