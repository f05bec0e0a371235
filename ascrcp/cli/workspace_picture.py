"""Pictures of the workspace: cloud in three views, reach map of the wall, parking places."""

import io

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ascrcp.cli.wall_cell import WallCells
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.reach import Parking, ReachMap
from ascrcp.kinematics.workspace import Extreme

VIEWS = (("side", 0, 2), ("top", 0, 1), ("front, looking along X", 1, 2))
AXES = ("X", "Y", "Z")
BINS = 90
BEST_MARGIN = 40.0
"""Margin drawn in the fullest colour [%]; 50 % is the middle of a range."""

WORST = -20.0
"""Excess drawn in the darkest red [%]."""


def draw_workspace(arm: Arm, cloud: Array, extremes: dict[str, Extreme], cells: WallCells | None) -> bytes:
    """Draw the Monte Carlo cloud from three sides with the exact extremes and the heading's wall."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 5.4), layout="constrained")
    for ax, (title, i, j) in zip(axes, VIEWS, strict=True):
        counts, x_edges, y_edges = np.histogram2d(cloud[:, i], cloud[:, j], bins=BINS)
        shown = np.ma.masked_equal(counts.T, 0)
        ax.pcolormesh(x_edges, y_edges, shown, cmap="Blues", vmin=-0.15 * counts.max())
        for name, end in extremes.items():
            axis = name.partition("_")[0]
            for at, line in ((i, ax.axvline), (j, ax.axhline)):
                if axis == AXES[at].lower():
                    line(end.value, color="#c62828", lw=0.9, ls="--")
        if cells is not None:
            wall = cells.point[cells.asked]
            ax.plot(wall[:, i], wall[:, j], ".", ms=1.5, color="#6d4c41", label="wall to spray")
            ax.legend(loc="lower left", fontsize=8)
        ax.plot(0, 0, "k+", ms=10)
        ax.set_title(title)
        ax.set_xlabel(f"{AXES[i]} [m]")
        ax.set_ylabel(f"{AXES[j]} [m]")
        ax.set_aspect("equal", adjustable="datalim")
    axes[2].invert_xaxis()  # looking along X, Y points left
    reach = extremes["radius_max"].value
    figure.suptitle(f"{arm.name}: tool positions, horizontal reach {reach:.3f} m; dashed: exact extremes")
    return _png(figure)


def draw_reach(arm: Arm, cells: WallCells, reach: ReachMap, blocked: NDArray[np.bool_] | None) -> bytes:
    """Draw the unrolled wall: margin or what is missing, what is blocked, and the joint nearest its end."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 7), layout="constrained", sharey=True)
    # the design line's angle: that of the wall itself does not rise evenly where it is rough
    station, angle = cells.station, np.degrees(cells.arc_angle)
    margin = np.where(cells.asked, 100 * reach.margin, np.nan).reshape(cells.shape).T
    good = np.ma.masked_where(~(margin >= 0.0), margin)
    bad = np.ma.masked_where(~(margin < 0.0), np.maximum(margin, -1e3))
    scale = {"cmap": "YlGn", "vmin": 0.0, "vmax": BEST_MARGIN}
    mesh = left.pcolormesh(station, angle, good, shading="nearest", **scale)
    figure.colorbar(mesh, ax=left, label="within reach: share of a range left [%]", shrink=0.7)
    if bad.count():
        scale = {"cmap": "Reds_r", "vmin": WORST, "vmax": 0.0}
        mesh = left.pcolormesh(station, angle, bad, shading="nearest", **scale)
        figure.colorbar(mesh, ax=left, label="out of reach: beyond a range by [% of it]", shrink=0.7)
    if blocked is not None:
        row, column = np.nonzero(blocked.reshape(cells.shape))
        left.plot(station[row], angle[column], "kx", markersize=4)
    _draw_limits(right, arm, cells, reach, station, angle)
    for ax in (left, right):
        ax.set_facecolor("#d0d0d0")
        ax.set_xlabel("station along the axis [m]")
    left.set_ylabel("section angle [deg]: 0 right, 90 crown, 180 left")
    asked, reached = int(cells.asked.sum()), int((cells.asked & reach.reachable).sum())
    about = "obstacles not known" if blocked is None else "crosses: would hit something, however it leans"
    left.set_title(f"{reached} of {asked} cells within reach ({reached / asked:.1%})")
    figure.suptitle(f"{arm.name}: nozzle square to the wall; {about}; grey: not asked")
    return _png(figure)


def _draw_limits(ax: Axes, arm: Arm, cells: WallCells, reach: ReachMap, station: Array, angle: Array) -> None:
    """Colour each cell by the joint whose range is nearest to its end."""
    shown = np.ma.masked_where(~(cells.asked & (reach.joint >= 0)), reach.joint).reshape(cells.shape).T
    colours = plt.get_cmap("tab10")
    ax.pcolormesh(station, angle, shown, cmap=colours, vmin=-0.5, vmax=9.5, shading="nearest")
    for i in np.unique(shown.compressed()).tolist():
        ax.plot([], [], "s", color=colours(i), label=f"{i + 1} {arm.joints[i].name}")
    ax.set_title("the joint nearest to the end of its range")
    if shown.count():
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=4, fontsize=8)


def draw_parking(parking: Parking) -> bytes:
    """Draw coverage and margin against the parking place."""
    figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
    ax.plot(parking.offset, 100 * parking.covered, "o-", color="#1565c0", label="wall within reach")
    ax.set_xlabel("machine forward of its present place [m]")
    ax.set_ylabel("wall within reach [%]", color="#1565c0")
    ax.set_ylim(0, 105)
    right = ax.twinx()
    right.plot(parking.offset, 100 * parking.margin, "s--", color="#2e7d32", ms=4)
    right.set_ylabel("mean margin [% of a range]", color="#2e7d32")
    right.set_ylim(bottom=0)
    best = float(parking.offset[parking.best])
    ax.axvline(best, color="#c62828", lw=1)
    ax.set_title(
        f"best: {best:+.2f} m, {parking.covered[parking.best]:.1%} of the wall; obstacles not considered"
    )
    return _png(figure)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    return buffer.getvalue()
