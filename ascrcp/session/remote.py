"""Name the functions that run in the compute process, for callers that must not load them.

The stages bring SciPy and matplotlib with them: seconds of start and the interpreter's lock. The
application knows them by name alone; the compute process loads them before their first use.
"""

from collections.abc import Callable
from enum import Enum
from importlib import import_module
from typing import Any


class Remote(Enum):
    """A function of the compute process, as module and name."""

    RECOGNISE = "ascrcp.session.stages:recognise"
    PLAN = "ascrcp.session.stages:plan"
    SOLVE = "ascrcp.session.stages:solve"
    LOAD = "ascrcp.session.stages:load"
    APPROACH = "ascrcp.session.stages:approach"
    PREDICTED_LAYER = "ascrcp.session.wall_layer:read_predicted"
    OBSTACLES = "ascrcp.session.steer_stage:prepare_obstacles"
    STEER_PLAN = "ascrcp.session.steer_stage:prepare_plan"
    LOOK_POSE = "ascrcp.session.again:look_pose"
    MEASURE = "ascrcp.session.again:measure"
    PLAN_AGAIN = "ascrcp.session.again:plan_again"
    REPORT = "ascrcp.session.report:build_report"

    @property
    def function(self) -> Callable[..., Any]:
        """The function itself; loads its module."""
        module, _, name = self.value.partition(":")
        found: Callable[..., Any] = getattr(import_module(module), name)
        return found


def load_stages() -> None:
    """Load every stage with all it needs, machine code too, ahead of the first use."""
    for remote in Remote:
        import_module(remote.value.partition(":")[0])
    import_module("ascrcp.kinematics.kernel_call").load_kernels()
