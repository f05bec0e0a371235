"""Picture of a planned spraying for the report: concrete wanted, predicted layer, predicted finish."""

import io
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.planning.spray_plan import Layout
from ascrcp.planning.target import LEFT_TEXT, Left

THICK_MM = 200.0  # end of the colour scale of layers
FINISH_MM = 40.0  # and of the finish: twice the tolerance that is usual


def spray_plan(layout: Layout, growth: Array, finish: Array) -> bytes:
    """Draw the wall rolled flat: wanted concrete, predicted layer, predicted finish and what is left out.

    Args:
        layout: The plan's points and wall.
        growth: Predicted layer [m], shape (ns, na).
        finish: Predicted distance from the wanted surface by patches [m], NaN where not judged.

    Returns:
        PNG bytes.
    """
    target = layout.target
    angle = np.degrees(target.profile.angle(target.along))
    part = target.left != Left.OUTSIDE
    rows = part.any(axis=1)
    figure, axes = plt.subplots(3, 1, figsize=(11, 9), layout="constrained", sharex=True)
    panels: tuple[tuple[str, Array, str, tuple[float, float]], ...] = (
        ("concrete wanted [mm]", np.where(part, target.thickness, np.nan), "viridis", (0.0, THICK_MM)),
        ("layer predicted [mm]", np.where(part, growth, np.nan), "viridis", (0.0, THICK_MM)),
        ("too thin (red) or too thick (blue), patches [mm]", finish, "RdYlBu_r", (-FINISH_MM, FINISH_MM)),
    )
    for ax, (title, grid, colours, (low, high)) in zip(axes, panels, strict=True):
        draw_grid(ax, (angle, target.station[rows]), grid[rows], colours, (low, high))
        ax.set_title(title, fontsize=10)
        ax.set_ylabel("station [m]")
        for lid in target.arches:
            for side in (-lid.half, lid.half):
                ax.plot(angle, lid.station + side, "k-", lw=0.6)
        ax.set_ylim(target.station[rows][0], target.station[rows][-1])
    _show_left(axes[2], layout, angle)
    axes[2].set_xlabel("section angle [deg]: 0 right, 90 crown, 180 left")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    plt.close(figure)
    return buffer.getvalue()


def draw_grid(
    ax: Any, place: tuple[Array, Array], grid: Array, colours: str, span_mm: tuple[float, float]
) -> None:
    """Draw values [m], shape (ns, na), over section angles [deg] and stations [m], with their scale in mm."""
    low, high = span_mm
    mesh = ax.pcolormesh(*place, 1e3 * grid, cmap=colours, vmin=low, vmax=high, shading="nearest")
    ax.figure.colorbar(mesh, ax=ax)


def _show_left(ax: Any, layout: Layout, angle: Array) -> None:
    """Hatch what is left out, and name the reasons."""
    target = layout.target
    for reason, hatch in (
        (Left.UNSEEN, "...."),
        (Left.FLOOR, "////"),
        (Left.ARM, "xxxx"),
        (Left.SHADOW, "\\\\\\\\"),
        (Left.BEFORE, "++++"),
        (Left.STEEP, "oooo"),
        (Left.EDGE, "----"),
    ):
        mine = (target.left == reason).astype(float)
        if mine.any():
            ax.contourf(angle, target.station, mine, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            ax.plot([], [], "k-", lw=0, label=f"{hatch[0]} {LEFT_TEXT[reason.code]}")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=8, handlelength=0)
