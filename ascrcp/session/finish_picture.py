"""Picture of what a spraying came to, for the report: predicted beside achieved, scan by scan."""

import io
from dataclasses import dataclass

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array
from ascrcp.session.plan_picture import FINISH_MM, THICK_MM, draw_grid

ROW_INCHES = 2.4


@dataclass(frozen=True)
class FinishMap:
    """One row of the picture: layer and finish [m] on a grid of the wall, NaN unknown, shape (ns, na)."""

    title: str
    station: Array
    along: Array
    layer: Array
    finish: Array


def finish_maps(surface: Surface, maps: list[FinishMap]) -> bytes:
    """Draw layer and finish of the prediction and of every further scan below one another.

    Args:
        surface: The heading: profile, arches, and the part shown.
        maps: From the first to the last.

    Returns:
        PNG bytes.
    """
    figure, axes = plt.subplots(
        len(maps),
        2,
        figsize=(11, 0.8 + ROW_INCHES * len(maps)),
        layout="constrained",
        sharex=True,
        squeeze=False,
    )
    for row, one in zip(axes, maps, strict=True):
        angle = np.degrees(surface.profile.angle(one.along))
        rows = (one.station >= surface.unsprayed[0]) & (one.station <= surface.unsprayed[1])
        for ax, grid, colours, span, what in (
            (row[0], one.layer, "viridis", (0.0, THICK_MM), "layer [mm]"),
            (row[1], one.finish, "RdYlBu_r", (-FINISH_MM, FINISH_MM), "too thin (red) or too thick [mm]"),
        ):
            draw_grid(ax, (angle, one.station[rows]), grid[rows], colours, span)
            ax.set_title(f"{one.title}: {what}", fontsize=9)
            for arch in surface.arches:
                height = surface.profile.point(one.along)[:, 1]
                middle = arch.station + np.tan(np.radians(arch.lean_deg)) * (height - height.max())
                for side in (-arch.width / 2.0, arch.width / 2.0):
                    ax.plot(angle, middle + side, "k-", lw=0.5)
            ax.set_ylim(*surface.unsprayed)
        row[0].set_ylabel("station [m]")
    for ax in axes[-1]:
        ax.set_xlabel("section angle [deg]: 0 right, 90 crown, 180 left")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90)
    plt.close(figure)
    return buffer.getvalue()
