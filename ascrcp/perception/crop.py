"""Crop: drop what cannot be the tunnel around the machine (pass-through filter, thesis eq. 3-1 to 3-3)."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import CropParameters


def crop(points: NDArray[np.float32], profile: Profile, parameters: CropParameters) -> NDArray[np.float32]:
    """Keep the finite points inside a box around the base origin.

    The box follows the profile's size, so that a larger tunnel needs no new settings; the axis may
    pass the base at any place within `aside`.

    Args:
        points: Points in the base frame [m], shape (n, 3).
        profile: Design profile.
        parameters: Box beyond the profile's size.

    Returns:
        The points kept, shape (m, 3).
    """
    line = profile.point(np.linspace(0.0, profile.length, 200), profile.overbreak_line)
    half = float(np.abs(line).max()) + parameters.aside
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    # comparisons with NaN are False, so that points that are not finite fall out here too
    keep = (x > -parameters.behind) & (x < parameters.ahead) & (np.abs(y) < half) & (np.abs(z) < half)
    return points if keep.all() else points[keep]
