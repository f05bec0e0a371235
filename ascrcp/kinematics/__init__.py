"""Arms from machine files: forward, Jacobian, closed-form inverse, choice, whole paths, sag."""

from ascrcp.kinematics.arm import Arm, JointInfo, load_arm
from ascrcp.kinematics.description import list_machines
from ascrcp.kinematics.solution import Solutions

__all__ = ["Arm", "JointInfo", "Solutions", "list_machines", "load_arm"]
