"""Build what the 3-D view draws: results of the stages -> Scene."""

from dataclasses import replace

import numpy as np

from ascrcp.core.flow import JointSequence, SprayPath, Surface
from ascrcp.core.geometry import Array
from ascrcp.session.snapshot import Scene, WallLayer

SCENE_POINTS = 100_000  # of the thinned cloud; the surface holds them all


def change_scene(
    scene: Scene,
    surface: Surface | None = None,
    path: SprayPath | None = None,
    solved: object = None,
    clearance: Array | None = None,
    sequence: JointSequence | None = None,
    predicted: WallLayer | None = None,
    achieved: WallLayer | None = None,
) -> Scene:
    """Return a scene with parts replaced.

    A new path takes the sequence back, being another plan's; a surface alone the layer achieved, being
    another heading's.
    """
    scene = replace(scene, version=scene.version + 1)
    if surface is not None and achieved is None:
        scene = replace(scene, achieved=None, predicted=None)
    if surface is not None:
        stride = max(1, -(-len(surface.points) // SCENE_POINTS))
        scene = replace(
            scene, surface=surface, points=surface.points[::stride], labels=surface.labels[::stride]
        )
    if path is not None:
        scene = replace(
            scene,
            path=path.position,
            path_pass=path.pass_index,
            path_direction=path.direction,
            clearance=np.zeros(0),
            sequence=None,
            predicted=None,
        )
    if solved is not None:
        scene = replace(scene, solved=np.asarray(solved))
    if clearance is not None:
        scene = replace(scene, clearance=clearance)
    if sequence is not None:
        scene = replace(scene, sequence=sequence)
    if predicted is not None:
        scene = replace(scene, predicted=predicted)
    if achieved is not None:
        scene = replace(scene, achieved=achieved)
    return scene
