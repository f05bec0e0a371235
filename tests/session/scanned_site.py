"""A small generated heading, scanned by the simulated lidar and recognised, with concrete laid on at will."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.config import load
from ascrcp.core.flow import Cloud, Scan, Surface
from ascrcp.core.geometry import Array
from ascrcp.core.paths import CONFIG
from ascrcp.kinematics import load_arm
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.perception.project import project
from ascrcp.perception.recognise import recognise
from ascrcp.perception.survey import load_survey
from ascrcp.planning.parameter import load_parameters
from ascrcp.session.achieved import Achieved, measure_achieved
from ascrcp.simulation.bare_wall import Bare, grow_heading, lay_bare
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.tunnel import TunnelConfig

ARM = load_arm("kc")
CONFIGURED = load_parameters()
OVERLAY = {
    "bodies": [],
    "length": {"rear": -3.0, "unsprayed_length": [1.6, 1.7]},
    "arches": {"count": 1, "first": [0.7, 0.8]},
    "pockets": {"count": 1, "angle_deg": [40.0, 140.0]},
    "bumps": {"count": 0},
}
PAN_STEP_DEG = 0.5  # a sixth of the machine's points would do; coarser leaves cells empty


@dataclass(frozen=True)
class Site:
    """A small heading, scanned and recognised."""

    heading: Heading
    bare: Bare
    surface: Surface

    def scan(self, rock: Array, flange: Array, number: int) -> np.ndarray:
        """Scan the heading with a layer on, with noise of its own; points in the base frame."""
        return look(grow_heading(self.heading, self.bare, rock, flange), number)

    def measure(self, points: np.ndarray) -> Achieved:
        return measure_achieved(points, self.surface, None, CONFIGURED, load_survey())


def look(heading: Heading, number: int) -> np.ndarray:
    config = load(CONFIG / "simulation" / "lidar.yaml", LidarConfig)
    lidar, rng = LidarModel(config, heading), np.random.default_rng([9, number])
    mount, pan = ARM.lidar(ARM.zero_pose), np.radians(np.arange(-90.0, 90.0, PAN_STEP_DEG))
    ranges = np.array([lidar.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
    return project(Scan(ranges, config.beam, pan, ARM.zero_pose), mount).points


def build_site(seed: int = 12, overlay: dict[str, object] = OVERLAY) -> Site:
    """Scan and recognise a heading."""
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, overlay)
    heading = build_heading(tunnel, np.random.default_rng(seed))
    points = look(heading, 0)
    surface = recognise(Cloud(points), heading.truth.profile, load_perception())
    return Site(heading, lay_bare(heading, 0.05, 0.15), surface)
