"""Which controller a joint has: JointConfig -> JointControl."""

from collections.abc import Callable

from msgspec import to_builtins

from ascrcp.control.config import JointConfig
from ascrcp.control.fuzzy import FuzzyControl
from ascrcp.control.identified import IdentifiedControl
from ascrcp.control.joint import JointControl
from ascrcp.control.position import PositionControl
from ascrcp.control.segmented import SegmentedControl
from ascrcp.control.separated import SeparatedControl
from ascrcp.control.stick_slip import StickSlipControl
from ascrcp.core.config import convert


def _unpulsed(config: JointConfig) -> SegmentedControl:
    """Segmented PID all the way, as in thesis table 5-8."""
    tree = {**to_builtins(config), "controller": "segmented", "pulse": None}
    return SegmentedControl(convert(tree, JointConfig, config.name))


CONTROLLERS: dict[str, Callable[[JointConfig], JointControl]] = {
    "identified": IdentifiedControl,
    "stick_slip": StickSlipControl,
    "position": PositionControl,
    "fuzzy": FuzzyControl,
    "segmented": _unpulsed,
    "pulsed": SegmentedControl,
    "separated": SeparatedControl,
}


def make_controller(config: JointConfig) -> JointControl:
    """Build the controller a joint's configuration names."""
    return CONTROLLERS[config.controller](config)
