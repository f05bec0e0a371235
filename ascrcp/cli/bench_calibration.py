"""Sag calibration on the simulated machine: how far the tip misses before and after, on poses not fitted."""

import numpy as np

from ascrcp.cli.bench import Figure, Say
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.calibration import calibrate, load_config
from ascrcp.kinematics.identifiability import FULL_HOSE_KG
from ascrcp.kinematics.sag import sagged_forward
from ascrcp.simulation.rig import load_rig_config
from ascrcp.simulation.survey import PRISM, draw_poses, survey_rig

MACHINES = 5
"""Simulated machines, each with zero errors of its own."""

FITTED, FRESH = 60, 60
"""Surveyed poses of each: fitted, as `ascrcp calibrate --simulate 60` draws them, and measured afterwards."""

SAG_MM = 205.0
"""Sag of the simulated boom, 72 where the machine file was surveyed: the tip misses by about 90 mm."""

AIM_MM = 10.0


def measure_calibration(machine: str, seed: int, say: Say) -> list[Figure]:
    """Survey and fit simulated machines; the worst of them counts.

    Args:
        machine: Name of the arm; only the rig's own can be surveyed.
        seed: Of the first machine.
        say: Takes progress.
    """
    arm, what = load_arm(machine), "tip error after sag calibration, poses not fitted"
    if arm.description.sag is None:
        return [Figure(what, None, "mm", AIM_MM, note=f"machine {machine} has no sag model")]
    say(f"bench: {MACHINES} machines surveyed in {FITTED + FRESH} poses each")
    rig = load_rig_config({"arm": {"flexure": {"sag_mm": SAG_MM}}})
    before: list[float] = []
    after: list[float] = []
    for number in range(seed, seed + MACHINES):
        rng = np.random.default_rng([number, 2])
        poses = draw_poses(arm, FITTED + FRESH, rng)
        payload_kg = np.round(rng.uniform(0.0, FULL_HOSE_KG, len(poses)))
        fitted, fresh = (
            survey_rig(rig, arm, poses[cut], payload_kg[cut], number, rng, prism)
            for cut, prism in ((slice(FITTED), PRISM), (slice(FITTED, None), 0.0))
        )
        found = calibrate(arm, fitted, load_config(), groups=["sag"])
        for kind, errors in ((arm, before), (Arm(found.description), after)):
            tip = sagged_forward(kind, fresh.q, fresh.payload_kg)[:, :3, 3]
            errors.append(1e3 * float(np.linalg.norm(fresh.position - tip, axis=1).mean()))
    spread = f"before {min(before):.0f} to {max(before):.0f} mm, after {min(after):.1f} to {max(after):.1f}"
    return [Figure(what, max(after), "mm", AIM_MM, note=f"worst mean of {MACHINES} machines; {spread}")]
