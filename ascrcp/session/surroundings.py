"""What the arm may hit in a round: surface and scan of the folder -> obstacles."""

from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.session.round import Round
from ascrcp.session.store import read_scan, read_surface


def find_obstacles(round_: Round, arm: Arm, config: PlanningParameters) -> Obstacles | None:
    """Build what the arm may hit from the round's newest surface; None without one or shapes of links."""
    if not round_.surface.exists() or arm.description.clearance is None:
        return None
    if round_.now.exists():
        return Obstacles.from_surface(read_surface(round_.now), arm, bodies=config.solve.bodies)
    scan_q = read_scan(round_.scan).q if round_.scan.exists() else None
    return Obstacles.from_surface(read_surface(round_.surface), arm, scan_q, bodies=config.solve.bodies)
