"""Lines and numbers derived from the design profile that several steps need."""

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile


def between(profile: Profile) -> float:
    """Offset that parts surfaces at the arch line from rock about the design line [m]."""
    if profile.arch_line < 0.0 < profile.overbreak_line:
        return profile.arch_line / 2.0
    return (profile.arch_line + profile.overbreak_line) / 2.0


def crown_height(profile: Profile) -> float:
    """Height of the design line's crown above the axis [m]."""
    return float(profile.point(np.linspace(0.0, profile.length, 1001))[:, 1].max())


def curvature(profile: Profile, along: Array) -> Array:
    """Return the design line's curvature at arc lengths (n,) [1/m]."""
    arc = np.clip(np.searchsorted(profile.arc_starts, along, side="right") - 1, 0, len(profile.arcs) - 1)
    return 1.0 / np.array([a.radius for a in profile.arcs])[arc]
