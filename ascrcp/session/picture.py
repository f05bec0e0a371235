"""Pictures of a round for the report, drawn with matplotlib in the compute process."""

import io
from collections.abc import Callable
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import apply_transform, inverse_transform
from ascrcp.perception.writer import COLOURS
from ascrcp.session.evaluation import (
    RULE_DEG,
    RULE_MM,
    RunTrace,
    angle_error_deg,
    cross_track_mm,
    position_error_mm,
)

_REFERENCE = "#2e7d32"
_ACTUAL = "#c62828"


def draw(size: tuple[float, float], fill: Callable[[Any], None], **axes: object) -> bytes:
    """Draw one figure and return it as PNG bytes."""
    figure, ax = plt.subplots(figsize=size, layout="constrained", subplot_kw=axes or None)
    fill(ax)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    return buffer.getvalue()


def unrolled_wall(surface: Surface, path: SprayPath | None) -> bytes:
    """Draw the wall rolled flat: offset from the design line, arches, overbreak, planned path."""

    def fill(ax: Any) -> None:
        angle = np.degrees(surface.profile.angle(surface.along))
        mesh = ax.pcolormesh(
            surface.station,
            angle,
            1e3 * surface.offset.T,
            cmap="RdYlBu_r",
            vmin=-400,
            vmax=600,
            shading="nearest",
        )
        ax.figure.colorbar(mesh, ax=ax, label="offset from design line [mm], outward positive")
        for number, arch in enumerate(surface.arches, start=1):
            lean = np.tan(np.radians(arch.lean_deg))
            z = surface.profile.point(surface.along)[:, 1]
            z = z - z.max()  # an arch's station is that of its crown
            span = (angle >= arch.span_deg[0]) & (angle <= arch.span_deg[1])
            for side in (-0.5, 0.5):
                ax.plot((arch.station + side * arch.width + lean * z)[span], angle[span], "k-", lw=1.5)
            top = (arch.station, float(angle.max()) + 2)
            ax.annotate(f"arch {number}", top, ha="center", va="bottom", annotation_clip=False)
        for i, region in enumerate(surface.overbreak):
            (s0, s1), (a0, a1) = region.station, region.angle_deg
            ax.plot([s0, s1, s1, s0, s0], [a0, a0, a1, a1, a0], color="#6a1b9a", lw=2)
            ax.annotate(
                str(i + 1), ((s0 + s1) / 2, (a0 + a1) / 2), color="w", weight="bold", ha="center", va="center"
            )
        if path is not None:
            for number in np.unique(path.pass_index):
                rows = path.pass_index == number
                ax.plot(path.station[rows], np.degrees(path.angle[rows]), ".-", ms=2, lw=0.6, color="#1b5e20")
        ax.set_xlabel("station along the axis [m]")
        ax.set_ylabel("section angle [deg]: 0 right, 90 crown, 180 left")

    return draw((10, 6.5), fill)


def sections(surface: Surface, count: int = 3) -> bytes:
    """Draw sections of the unsprayed part with the design, arch and overbreak lines."""
    s0, s1 = surface.unsprayed
    stations = s0 + (np.arange(count) + 0.5) * (s1 - s0) / count
    figure, axes = plt.subplots(1, count, figsize=(4.2 * count, 4.4), layout="constrained", sharey=True)
    along = np.linspace(0, surface.profile.length, 400)
    T_tunnel_base = inverse_transform(surface.axis.T_base_tunnel)
    local = apply_transform(T_tunnel_base, surface.points.astype(float))
    for ax, station in zip(np.atleast_1d(axes), stations, strict=True):
        near = np.abs(local[:, 0] - station) < 0.03
        ax.plot(-local[near, 1], local[near, 2], ".", ms=1, color="#8d6e63", label="scanned")
        for offset, style, label in (
            (0.0, "k-", "design"),
            (surface.profile.arch_line, "b--", "arch line"),
            (surface.profile.overbreak_line, "r--", "overbreak line"),
        ):
            p = surface.profile.point(along, offset)
            ax.plot(-p[:, 0], p[:, 1], style, lw=0.9, label=label)
        ax.set_title(f"station {station:.2f} m")
        ax.set_aspect("equal")
        ax.set_xlabel("right of the axis [m]")
    np.atleast_1d(axes)[0].set_ylabel("above the axis [m]")
    np.atleast_1d(axes)[0].legend(loc="lower center", fontsize=8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    return buffer.getvalue()


def cloud_and_path(surface: Surface, path: SprayPath | None, trace: RunTrace | None) -> bytes:
    """Draw the labelled cloud with the planned path and the way the nozzle really went (fig. 6-10)."""

    def fill(ax: Any) -> None:
        s = apply_transform(inverse_transform(surface.axis.T_base_tunnel), surface.points.astype(float))[:, 0]
        inside = np.flatnonzero((s > surface.unsprayed[0] - 2.0) & (s < surface.unsprayed[1] + 0.5))
        keep = np.random.default_rng(0).permutation(inside)[:12_000]
        for label, colour in COLOURS.items():
            p = surface.points[keep][surface.labels[keep] == label]
            if len(p):
                ax.scatter(
                    p[:, 0],
                    p[:, 1],
                    p[:, 2],
                    s=0.8,
                    color=np.array(colour) / 255,
                    label=label.name.lower(),
                    alpha=0.5,
                )
        if path is not None:
            ax.plot(*path.position.T, color=_REFERENCE, lw=0.9, label="planned")
        if trace is not None:
            ax.plot(*trace.nozzle[trace.spraying.astype(bool), :3].T, color=_ACTUAL, lw=0.8, label="nozzle")
        near = (surface.unsprayed[0] - 2.0, surface.unsprayed[1] + 0.7)
        low, high = surface.points.min(0), surface.points.max(0)
        ax.set(xlim=near, ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        ax.view_init(elev=14, azim=-155)
        ax.set_xlabel("X [m]")
        ax.set_ylabel("Y [m]")
        ax.set_zlabel("Z [m]")
        ax.set_aspect("equal")
        ax.legend(markerscale=6, fontsize=8, loc="upper left")

    return draw((9, 7), fill, projection="3d")


def nozzle_error(trace: RunTrace) -> bytes:
    """Draw the nozzle's position and direction error against time (fig. 6-11 to 6-13)."""
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(10, 5.5), layout="constrained", sharex=True)
    spraying = trace.spraying.astype(bool)
    t = np.where(spraying, trace.t - trace.t[0], np.nan)
    at = trace.point >= 0
    mm, deg = position_error_mm(trace), angle_error_deg(trace)
    top.plot(t, mm, color=_ACTUAL, lw=0.7, label="same instant")
    top.plot(t, cross_track_mm(trace), color="#1565c0", lw=0.7, label="across the path")
    top.plot(trace.t[at] - trace.t[0], mm[at], "k.", ms=3, label="at planned points")
    top.axhline(RULE_MM, color="k", ls="--", lw=0.8)
    top.set_ylabel("nozzle position error [mm]")
    top.legend(loc="upper right", fontsize=8)
    bottom.plot(t, deg, color=_ACTUAL, lw=0.7)
    bottom.plot(trace.t[at] - trace.t[0], deg[at], "k.", ms=3)
    bottom.axhline(RULE_DEG, color="k", ls="--", lw=0.8)
    bottom.set_ylabel("spray direction error [deg]")
    bottom.set_xlabel("time since start of the run [s] (gaps: not spraying)")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    plt.close(figure)
    return buffer.getvalue()
