"""Make a scene ready to be drawn, beside the Qt thread: Scene -> shuffled cloud, sorted section points.

NumPy lets the interpreter go while it works on long arrays, so the control thread is not kept waiting.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.session.snapshot import Scene

SLICE = 20_000
"""Points worked on at once where a step would otherwise keep the interpreter."""


@dataclass(frozen=True)
class Prepared:
    """What the views draw of a scene.

    Attributes:
        scene: It.
        points: The cloud in an order in which any first part is an even sample [m], shape (n, 3).
        labels: `core.flow.Label` of each of them, shape (n,).
        station: Stations of the cloud, rising [m], shape (k,); empty without a surface.
        section: Section coordinates y, z of those [m], shape (k, 2).
        section_labels: Their labels, shape (k,).
    """

    scene: Scene
    points: NDArray[np.float32]
    labels: NDArray[np.uint8]
    station: NDArray[np.float32]
    section: NDArray[np.float32]
    section_labels: NDArray[np.uint8]


def prepare(scene: Scene, most: int) -> Prepared:
    """Shuffle the cloud for the 3-D view and sort it by station for the section.

    Args:
        scene: Of the session; its surface holds the whole cloud.
        most: Points kept for the 3-D view.
    """
    surface = scene.surface
    points = scene.points if surface is None else surface.points
    labels = scene.labels if surface is None else surface.labels
    order = np.random.default_rng(0).permutation(len(points))[:most]
    shuffled = np.take(points, order, axis=0)
    if surface is None:
        none = np.zeros(0, np.float32)
        return Prepared(
            scene, shuffled, labels[order], none, np.zeros((0, 2), np.float32), none.astype(np.uint8)
        )
    T_tunnel_base = inverse_transform(surface.axis.T_base_tunnel)
    local = np.concatenate(
        [
            apply_transform(T_tunnel_base, points[i : i + SLICE].astype(float)).astype(np.float32)
            for i in range(0, len(points), SLICE)
        ]
        or [np.zeros((0, 3), np.float32)]
    )
    rising = np.argsort(local[:, 0])
    return Prepared(
        scene,
        shuffled,
        np.take(labels, order),
        np.take(local[:, 0], rising),
        np.take(local[:, 1:], rising, axis=0),
        np.take(labels, rising),
    )


class Preparation:
    """Prepares the newest scene in a thread of its own; asked at every refresh."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._thread = ThreadPoolExecutor(1, "ascrcp-scene")
        self._version = 0
        self._work: Future[Prepared] | None = None

    def poll(self, scene: Scene) -> Prepared | None:
        """Begin with a scene not seen before; return one that has become ready, once."""
        if scene.version != self._version and self._work is None:
            self._version = scene.version
            self._work = self._thread.submit(prepare, scene, self._most)
        if self._work is not None and self._work.done():
            ready, self._work = self._work.result(), None
            return ready
        return None

    def wait(self, scene: Scene) -> Prepared | None:
        """Prepare a scene here and now; None if it has been handed out."""
        if scene.version == self._version and self._work is None:
            return None
        self._version = scene.version
        ready = self._work.result() if self._work is not None else None
        self._work = None
        return ready if ready is not None and ready.scene is scene else prepare(scene, self._most)

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=True, cancel_futures=True)


def cut(prepared: Prepared, station: float, half: float) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return section coordinates (k, 2) and labels (k,) of the points within `half` of a station [m]."""
    low, high = np.searchsorted(prepared.station, [station - half, station + half])
    return prepared.section[low:high], prepared.section_labels[low:high]


def wall_offset(prepared: Prepared, station: float) -> Array | None:
    """Return the wall's offset along the design line at a station [m], None off the wall."""
    surface = prepared.scene.surface
    if surface is None or not len(surface.station):
        return None
    row = int(np.argmin(np.abs(surface.station - station)))
    if not abs(surface.station[row] - station) <= 0.5:
        return None
    return np.asarray(surface.offset[row], dtype=float)
