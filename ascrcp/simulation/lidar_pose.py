"""The newest pose of the simulated lidar, shared between the rig's process and the lidar's."""

from multiprocessing.context import SpawnContext

import numpy as np

from ascrcp.core.geometry import Array

_ROW = 13  # rotation (9), position (3), pan


class PoseBoard:
    """Two rows of shared memory: the writer fills the row that is not published, then publishes it.

    Writing costs microseconds and wakes nobody; a reader sees whole poses only. One writer.
    """

    def __init__(self, context: SpawnContext) -> None:
        self._rows = context.RawArray("d", 2 * _ROW)
        self._published = context.RawValue("L", 0)
        self.write(np.eye(4), 0.0)

    def write(self, T_base_mount: Array, pan: float) -> None:
        """Publish a pose: the mount in the base frame (4, 4) and the pan angle [rad]."""
        count = self._published.value + 1
        row = np.frombuffer(self._rows)[(count & 1) * _ROW :][:_ROW]
        row[:9] = T_base_mount[:3, :3].ravel()
        row[9:12] = T_base_mount[:3, 3]
        row[12] = pan
        self._published.value = count

    def read(self) -> tuple[Array, float]:
        """Return the newest pose, (4, 4), and pan angle [rad]."""
        while True:
            count = self._published.value
            row = np.frombuffer(self._rows)[(count & 1) * _ROW :][:_ROW].copy()
            if self._published.value == count:  # else the writer may be filling this row again
                break
        T = np.eye(4)
        T[:3, :3] = row[:9].reshape(3, 3)
        T[:3, 3] = row[9:12]
        return T, float(row[12])
