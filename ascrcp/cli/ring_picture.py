"""Pictures of a ring inside a duct as the duct paper shows them: figs. 8 to 11, 14 and 15 in one."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.kinematics.ring import RingPlan, Scene
from ascrcp.kinematics.ring_target import Ring
from ascrcp.kinematics.ring_verdict import Verdict

TOUCHES, CLEAR = "#c62828", "#2e7d32"
STATES = ("#9e9e9e", "#1565c0", "#2e7d32")


def draw_ring(scene: Scene, ring: Ring, plans: Sequence[tuple[RingPlan, Verdict]]) -> bytes:
    """Draw where a ring touched, the arm before and after, clearances and accelerations.

    Args:
        scene: Arm and duct.
        ring: The poses asked for.
        plans: States from the first to the last, three or, without the first, two.
    """
    names = ("gradient projection", "with feedback", "closed ring")[3 - len(plans) :]
    colours = STATES[3 - len(plans) :]
    figure, axes = plt.subplots(2, 3, figsize=(16, 9.5), layout="constrained")
    _draw_collisions(axes[0, 0], scene, ring, plans[0][1])
    for ax, state, name in ((axes[0, 1], plans[0], names[0]), (axes[0, 2], plans[-1], names[-1])):
        _draw_arm(ax, scene, *state)
        ax.set_title(f"joints, {name}: {state[1].colliding} of {len(state[1].clearance)} poses touch")
    for (_, verdict), name, colour in zip(plans, names, colours, strict=True):
        axes[1, 0].plot(1e3 * verdict.clearance, "o-", ms=3, color=colour, label=name)
    axes[1, 0].axhline(0.0, color=TOUCHES, lw=1)
    axes[1, 0].set(title="least distance to the wall", xlabel="pose", ylabel="[mm]")
    axes[1, 0].legend()
    top = max(float(np.abs(verdict.acceleration).max()) for _, verdict in plans)
    for ax, (_, verdict), name in ((axes[1, 1], plans[0], names[0]), (axes[1, 2], plans[-1], names[-1])):
        lines = ax.plot(np.arange(1, len(verdict.acceleration) + 1), verdict.acceleration, lw=1.2)
        ax.legend(lines, [f"q{joint.number}" for joint in scene.arm.joints], ncols=4, fontsize=8)
        ax.set(title=f"accelerations, {name}", xlabel="pose", ylabel="[rad/s2], q1 [m/s2]")
        ax.set_ylim(-1.1 * top, 1.1 * top)
    figure.suptitle(f"{scene.duct.name}: one ring of {len(ring.T)} poses")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    plt.close(figure)
    return buffer.getvalue()


def _draw_collisions(ax: Any, scene: Scene, ring: Ring, verdict: Verdict) -> None:
    """Draw the ring's poses in its section, coloured by whether the arm touches there (fig. 8)."""
    place = ring.T[:, :3, 3]
    centre, axis = place.mean(axis=0), ring.T[0, :3, 1]
    wide = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    wide /= np.linalg.norm(wide)
    plane = np.stack([wide, np.cross(axis, wide)])
    wall = place + ring.stand_off * ring.T[:, :3, 2]
    for points, colour in ((wall, "black"), (place, "#bdbdbd")):
        x, y = plane @ (np.vstack([points, points[:1]]) - centre).T
        ax.plot(x, y, "-", lw=1, color=colour)
    x, y = plane @ (place - centre).T
    touches = np.minimum(verdict.clearance[:-1], 0.0) < 0.0
    ax.scatter(x, y, c=np.where(touches, TOUCHES, CLEAR), s=30, zorder=3)
    for i in range(0, len(x), 3):
        ax.annotate(f"p{i + 1}", (x[i], y[i]), textcoords="offset points", xytext=(5, 5), fontsize=8)
    ax.set(title="poses of the ring, red: the arm touches the wall", xlabel="[m]", ylabel="[m]")
    ax.set_aspect("equal")


def _draw_arm(ax: Any, scene: Scene, plan: RingPlan, verdict: Verdict) -> None:
    """Draw every posture from the side the duct bends most, inside the duct's outline (figs. 9, 10)."""
    side = int(np.ptp(scene.duct.centre[:, :2], axis=0).argmax())
    outline: list[Array] = []
    for points, centre, normal in zip(scene.duct.contour, scene.duct.centre, scene.duct.normal, strict=True):
        across = np.eye(3)[side] - normal[side] * normal
        reach = (points - centre) @ (across / np.linalg.norm(across))
        outline.append(np.stack([points[reach.argmin()], points[reach.argmax()]]))
    edges = np.array(outline)
    for end in (0, 1):
        ax.plot(edges[:, end, 2], edges[:, end, side], "k-", lw=1.5)
    origins = scene.arm.frames(plan.q)[:, : scene.arm.n, :3, 3]
    for row, line in enumerate(origins):
        colour = TOUCHES if verdict.clearance[row] < 0.0 else CLEAR
        ax.plot(line[:, 2], line[:, side], "o-", ms=2, lw=0.8, color=colour, alpha=0.6)
    ax.set(xlabel="z [m]", ylabel=f"{'xy'[side]} [m]")
    ax.set_aspect("equal", adjustable="datalim")
