"""Cases shared by the tests of the simulated tunnel and lidar."""

from typing import Any

import numpy as np

from ascrcp.core.paths import CONFIG
from ascrcp.core.profile import Arc, Profile

TUNNEL = CONFIG / "simulation" / "tunnel.yaml"
LIDAR = CONFIG / "simulation" / "lidar.yaml"
CIRCLE = Profile(name="circle", arcs=[Arc(centre=(0.0, 0.0), radius=5.9, start_deg=-28.0, end_deg=208.0)])
THREE_CENTRE = Profile(
    name="three-centre",
    arcs=[
        Arc(centre=(1.0, 0.0), radius=6.5, start_deg=-10.0, end_deg=40.0),
        Arc(
            centre=(1.0 - 1.5 * np.cos(np.radians(40.0)), 1.5 * np.sin(np.radians(40.0))),
            radius=5.0,
            start_deg=40.0,
            end_deg=140.0,
        ),
    ],
)
SMOOTH: dict[str, Any] = {
    "sprayed": {"roughness": [], "edge_ragged": 0.0},
    "rock": {"roughness": [], "look_out": 0.0},
    "floor": {"roughness": [], "muck_height": 0.0},
    "face": {"roughness": []},
    "arches": {"count": 0},
    "pockets": {"count": 0},
    "bumps": {"count": 0},
    "bodies": [],
    "air": {"dust_per_m": 0.0, "drips": 0},
}
