"""Headings of many kinds with exact truth, as clouds: what tests and benches judge recognition by."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.config import Struct, load, merge
from ascrcp.core.flow import Cloud, Scan
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics.arm import load_arm
from ascrcp.perception.project import project
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import Range, TunnelConfig, draw

_BEAMS_OVER_LINES = 1.5  # 270 deg of beams in a line, 180 deg of pan
_EDGE = 0.05  # of the sprayed part, left out on both sides where only one side is seen [m]


class Kind(Struct):
    """One kind of heading.

    Attributes:
        name: For people.
        points: Beams to cast [millions].
        see: Which part of the cloud is kept.
        tunnel: Overlay on config/simulation/tunnel.yaml.
    """

    name: str
    points: tuple[
        Annotated[float, msgspec.Meta(ge=0.01, le=20.0)], Annotated[float, msgspec.Meta(ge=0.01, le=20.0)]
    ]
    see: Literal["all", "sprayed", "unsprayed"] = "all"
    tunnel: dict[str, Any] = {}


class Variety(Struct):
    """config/simulation/variety.yaml: an overlay common to all, and the kinds."""

    common: dict[str, Any]
    kinds: list[Kind]


@dataclass(frozen=True)
class Sample:
    """One heading as the lidar saw it.

    Attributes:
        kind: Its kind.
        heading: What was built, with its truth.
        cloud: Points in the base frame.
        visible: Whether each of the heading's cells beyond the overbreak line was in sight, shape (c,).
    """

    kind: Kind
    heading: Heading
    cloud: Cloud
    visible: NDArray[np.bool_]


def load_variety(path: Path | None = None) -> Variety:
    """Read the kinds of headings.

    Raises:
        ConfigError: With the key and the rule it breaks.
    """
    return load(path or CONFIG / "simulation" / "variety.yaml", Variety)


def tunnel_of(variety: Variety, kind: Kind) -> TunnelConfig:
    """Lay the overlays of a kind over config/simulation/tunnel.yaml."""
    return load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, merge(variety.common, kind.tunnel))


def draw_sample(variety: Variety, kind: Kind, seed: int, points: Range | None = None) -> Sample:
    """Build and scan one heading; the lidar stands at the end of the shotcrete arm's zero pose.

    Args:
        variety: For what is common to all kinds.
        kind: Kind to draw.
        seed: Of everything.
        points: Beams to cast in place of the kind's own [millions].
    """
    rng = np.random.default_rng(seed)
    config = tunnel_of(variety, kind)
    heading = build_heading(config, rng)
    lidar = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)
    beams = 1e6 * draw(rng, points or kind.points)
    per_line = max(10, round(np.sqrt(_BEAMS_OVER_LINES * beams)))
    lines = max(10, round(beams / per_line))
    opening = lidar.beam_step_deg * (lidar.beams - 1)
    finer: Any = lidar  # msgspec declares replace for its own class only, not for those made from it
    lidar = msgspec.structs.replace(finer, beams=per_line, beam_step_deg=opening / (per_line - 1))
    arm = load_arm("kc")
    mount = arm.lidar(arm.zero_pose)
    pan = np.linspace(-np.pi / 2, np.pi / 2, lines, endpoint=False)
    model = LidarModel(lidar, heading)
    ranges = np.array([model.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
    cloud = project(Scan(ranges, lidar.beam, pan, arm.zero_pose), mount)
    visible = model.is_visible(mount[:3, 3])
    return Sample(kind, heading, Cloud(_kept(cloud.points, heading, kind), kind.name), visible)


def _kept(points: NDArray[np.float32], heading: Heading, kind: Kind) -> NDArray[np.float32]:
    if kind.see == "all":
        return points
    station = (points - heading.truth.axis.point) @ heading.truth.axis.direction
    edge = heading.truth.unsprayed[0]
    return points[station > edge + _EDGE if kind.see == "unsprayed" else station < edge - _EDGE]


def pocket_of(heading: Heading) -> Array:
    """Number of the pocket each cell beyond the overbreak line lies in, -1 for none, shape (c,)."""
    truth = heading.truth
    local = (heading.beyond - truth.axis.point) @ truth.axis.T_base_tunnel[:3, :3]
    along, _ = truth.profile.locate(local[:, 1:])
    owner = np.full(len(local), -1)
    for number, pocket in enumerate(truth.pockets):
        owner[pocket.radius(local[:, 0], along) <= 1.05] = number
    return owner
