"""bench control: the thesis's tables of chapters 5 and 6 beside ours, from the rig's truth."""

from ascrcp.app import load_control
from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.bench_joint import measure_joints, measure_separation
from ascrcp.cli.bench_round import measure_rigs, measure_rounds, measure_trouble
from ascrcp.kinematics.arm import load_arm


def measure_control(machine: str, seed: int, say: Say) -> list[Figure]:
    """Measure single joints under every controller, figure 10 of the second paper, and whole rounds."""
    arm = load_arm(machine)
    control = load_control(arm)
    figures = measure_joints(arm, control, seed, say)
    figures += measure_separation(control.joints[3])
    return figures + measure_rounds(seed, say)


def measure_many(seed: int, say: Say) -> list[Figure]:
    """Measure rigs drawn at random, tuned and surveyed, and the shipped rig in trouble."""
    return measure_rigs(seed, say) + measure_trouble(seed, say)
