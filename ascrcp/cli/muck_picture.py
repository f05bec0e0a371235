"""Picture of the muck job: the ways of the bucket's lip and the arm at its poses (muck paper fig. 11)."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from ascrcp.kinematics.arm import Arm
from ascrcp.planning.muck import MuckParameters
from ascrcp.planning.muck_path import Scoop

LINKS = (0, 1, 4, 6)
"""Frames whose origins are shoulder, elbow, wrist and lip."""


def draw_muck(arm: Arm, parameters: MuckParameters, scoops: Sequence[Scoop]) -> bytes:
    """Draw the section with every way of the lip, one scoop's postures from the front and from the side."""
    figure, axes = plt.subplots(1, 3, figsize=(17, 6), layout="constrained")
    _draw_section(axes[0], parameters)
    for scoop in scoops:
        rows = np.vstack([leg.q for leg in scoop.legs[:2]])
        lip = arm.forward(rows)[:, :3, 3]
        axes[0].plot(lip[:, 1], lip[:, 2], lw=0.9)
    axes[0].set_title(f"{len(scoops)} scoops: the lip from the start pose to tipping")
    outermost = max(scoops, key=lambda scoop: scoop.postures.angle)
    for ax, across in ((axes[1], 1), (axes[2], 0)):
        if across == 1:
            _draw_section(ax, parameters)
        _draw_postures(ax, arm, outermost, across)
    for ax, name in zip(axes, ("y", "y", "x"), strict=True):
        ax.set(xlabel=f"{name} [m]", ylabel="z [m], down")
        ax.set_aspect("equal", adjustable="datalim")
        ax.invert_yaxis()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    plt.close(figure)
    return buffer.getvalue()


def _draw_section(ax: Any, parameters: MuckParameters) -> None:
    """Draw tunnel, muck and main beam in the plane across the tunnel."""
    p = parameters
    angle = np.linspace(-np.pi, np.pi, 361)
    y, z = p.tunnel_radius_m * np.sin(angle), p.base_above_axis_m + p.tunnel_radius_m * np.cos(angle)
    ax.plot(y, z, "k-", lw=1.5)
    top = p.base_above_axis_m + p.tunnel_radius_m - p.muck_depth_m
    ax.fill_between(y, z, top, where=z >= top, color="#a1887f", alpha=0.6)
    beam = p.beam
    width, height = 2 * beam.half_width_m, beam.bottom_z_m - beam.top_z_m
    ax.add_patch(Rectangle((-beam.half_width_m, beam.top_z_m), width, height, color="#90a4ae"))


def _draw_postures(ax: Any, arm: Arm, scoop: Scoop, across: int) -> None:
    """Draw the arm at each pose of a scoop, from the front (across y) or from the side (across x)."""
    line = arm.frames(scoop.postures.q)[..., :3, 3][:, LINKS]
    colours = plt.get_cmap("viridis")(np.linspace(0.0, 1.0, len(line)))
    for name, points, colour in zip(scoop.postures.names, line, colours, strict=True):
        ax.plot(points[:, across], points[:, 2], "o-", ms=3, lw=1.5, color=colour, label=name)
    kept = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(kept.values(), kept.keys(), fontsize=8)
    ax.set_title(f"postures of the scoop at {np.degrees(scoop.postures.angle):+.0f} deg")
