"""Arms from machine files: forward, Jacobian, closed-form inverse, choice, whole paths, sag."""

from ascrcp.kinematics.arm import Arm, JointInfo, load_arm
from ascrcp.kinematics.choice import choose_solution
from ascrcp.kinematics.description import list_machines
from ascrcp.kinematics.path import PathSolution, solve_path
from ascrcp.kinematics.sag import compensate, sagged_forward
from ascrcp.kinematics.solution import Solutions
from ascrcp.kinematics.task import spray_pose

__all__ = [
    "Arm",
    "JointInfo",
    "PathSolution",
    "Solutions",
    "choose_solution",
    "compensate",
    "list_machines",
    "load_arm",
    "sagged_forward",
    "solve_path",
    "spray_pose",
]
