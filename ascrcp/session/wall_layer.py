"""Layers on the unrolled wall for the screen: what the round's plan will lay."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ascrcp.session.round import Round
from ascrcp.session.snapshot import WallLayer
from ascrcp.session.store import read_archive, read_json


def read_predicted(folder: Path, progress: Callable[[float], None] = lambda done: None) -> WallLayer | None:
    """plan.npz and plan.json -> the predicted layer, None without a plan; for the compute process.

    Raises:
        InputError: A damaged file.
    """
    round_ = Round(folder)
    if not round_.plan.exists():
        return None
    _, arrays = read_archive(round_.plan, "plan", ("station", "along", "growth"))
    tree = read_json(round_.prediction) if round_.prediction.exists() else {}
    progress(1.0)
    return WallLayer(
        arrays["station"],
        arrays["along"],
        arrays["growth"].astype(np.float32),
        tree.get("driven", tree.get("planned", {})),
    )
