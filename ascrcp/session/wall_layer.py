"""Layers on the unrolled wall for the screen: what the round's plan will lay."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ascrcp.session.round import Round
from ascrcp.session.snapshot import WallLayer
from ascrcp.session.store import read_archive


def read_predicted(folder: Path, progress: Callable[[float], None] = lambda done: None) -> WallLayer | None:
    """plan.npz -> the predicted layer, None without a plan; for the compute process.

    Raises:
        InputError: A damaged file.
    """
    place = Round(folder).plan
    if not place.exists():
        return None
    _, arrays = read_archive(place, "plan", ("station", "along", "growth"))
    progress(1.0)
    return WallLayer(arrays["station"], arrays["along"], arrays["growth"].astype(np.float32))
