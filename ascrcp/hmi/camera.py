"""Where the 3-D view is seen from, and how points come onto the screen: the same for both views."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.hmi.theme import View

NEAR = 0.1
"""Points nearer to the eye than this are not drawn [m]."""
MAX_ELEVATION_DEG = 89.0
MIN_DISTANCE, MAX_DISTANCE = 2.0, 60.0


@dataclass(frozen=True)
class Camera:
    """An eye on a sphere around a point, looking at that point, z up.

    Attributes:
        centre: Point looked at [m], base frame.
        azimuth_deg: Direction from the centre to the eye around z, 0 along +x.
        elevation_deg: Direction above the horizon.
        distance: From the centre to the eye [m].
        fov_deg: Horizontal field of view.
    """

    centre: tuple[float, float, float]
    azimuth_deg: float
    elevation_deg: float
    distance: float
    fov_deg: float

    def turn(self, azimuth_deg: float) -> "Camera":
        """Walk around the centre."""
        return replace(self, azimuth_deg=(self.azimuth_deg + azimuth_deg) % 360.0)

    def approach(self, factor: float) -> "Camera":
        """Go nearer by a factor (below 1: farther)."""
        return replace(self, distance=max(MIN_DISTANCE, min(MAX_DISTANCE, self.distance / factor)))

    @property
    def axes(self) -> tuple[Array, Array]:
        """Eye [m], shape (3,), and the axes right, up, forward as rows, shape (3, 3)."""
        azimuth = math.radians(self.azimuth_deg)
        elevation = math.radians(max(-MAX_ELEVATION_DEG, min(MAX_ELEVATION_DEG, self.elevation_deg)))
        outward = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        eye = np.asarray(self.centre) + self.distance * outward
        right = np.cross(-outward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return eye, np.stack([right, np.cross(right, -outward), -outward])

    def project(self, points: Array, width: int, height: int) -> tuple[Array, Array]:
        """Bring points onto the picture.

        Args:
            points: Base frame [m], shape (n, 3).
            width: Of the picture [px].
            height: Of the picture [px].

        Returns:
            Pixels (x right, y down), shape (n, 2), and depths [m], shape (n,). Where the depth is
            below NEAR the point lies behind the eye and its pixel means nothing.
        """
        eye, axes = self.axes
        seen = (np.asarray(points, dtype=np.float64) - eye) @ axes.T
        depth = seen[:, 2]
        scale = 0.5 * width / math.tan(math.radians(self.fov_deg) / 2) / np.maximum(depth, NEAR)
        return np.stack([0.5 * width + scale * seen[:, 0], 0.5 * height - scale * seen[:, 1]], -1), depth


def is_inside(pixels: Array, depth: Array, width: int, height: int) -> NDArray[np.bool_]:
    """Return which projected points lie in the picture, shape (n,)."""
    on_picture = (pixels > -1.0).all(1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    return np.asarray(on_picture & (depth > NEAR))


def first_camera(view: View) -> Camera:
    """Return the configured camera."""
    return Camera(view.centre, view.azimuth_deg, view.elevation_deg, view.distance, view.fov_deg)


def named_cameras(view: View) -> dict[str, Camera]:
    """Return the cameras the view button walks through: behind, side, top."""
    first = first_camera(view)
    return {
        "view_behind": first,
        "view_side": replace(first, azimuth_deg=270.0, elevation_deg=5.0),
        "view_top": replace(first, azimuth_deg=180.0, elevation_deg=80.0),
    }
