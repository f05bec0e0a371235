"""Pictures of a tuning: what every joint did under steps of its drive, and the line through its speeds."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ascrcp.control.config import JointConfig
from ascrcp.control.identification import Trial, find_speed
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder
from ascrcp.session.tuning import Tuned


def draw_steps(found: Tuned, folder: Path) -> list[Path]:
    """Draw one picture per joint into a folder.

    Args:
        found: Outcome of the tuning, with its trials.
        folder: Where to; made if it does not exist.

    Returns:
        The pictures written.
    """
    make_folder(folder)
    written = []
    for number, joint in enumerate(found.control.joints, start=1):
        figure = Figure(figsize=(11.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        _draw_responses(left, joint, found.trials[number])
        _draw_line(right, joint, found.trials[number])
        figure.suptitle(f"joint {number}, {joint.name}; oil {found.oil_c:.0f} deg C")
        place = folder / f"joint{number}.png"
        figure.savefig(place, dpi=110)
        written.append(place)
    return written


def _draw_responses(axes: Axes, joint: JointConfig, trials: list[Trial]) -> None:
    """Readings against time, from where the joint stood."""
    colours = mpl.colormaps["viridis"]
    for trial in trials:
        t = CYCLE_S * np.arange(len(trial.reading))
        moved = (np.array(trial.reading) - trial.reading[0]) / joint.si
        axes.plot(t, moved, color=colours(min(1.0, abs(trial.level))), lw=1.2, label=f"{trial.level:+.2f}")
    axes.set_xlabel("time from the step [s]")
    axes.set_ylabel(f"reading from rest [{joint.unit}]")
    axes.legend(title="drive", fontsize=7, ncols=2)
    axes.grid(alpha=0.3)


def _draw_line(axes: Axes, joint: JointConfig, trials: list[Trial]) -> None:
    """Steady speeds against drive, and what was fitted."""
    for trial in trials:
        try:
            speed = find_speed(trial) / joint.si
        except InputError:
            continue  # a piece of motion is too short to have a steady speed
        axes.plot(trial.level, speed, "o", color="tab:blue")
    most = max(abs(trial.level) for trial in trials)
    for sign, full, dead in (
        (1.0, joint.full_speed[0], joint.dead_band[0]),
        (-1.0, joint.full_speed[1], joint.dead_band[1]),
    ):
        u = np.linspace(0.0, most, 50)
        v = np.maximum(0.0, u - dead) / (1.0 - dead) * full
        axes.plot(sign * u, sign * v, color="tab:orange", lw=1.2)
    axes.set_xlabel("drive")
    axes.set_ylabel(f"speed [{joint.unit}/s]")
    axes.grid(alpha=0.3)
