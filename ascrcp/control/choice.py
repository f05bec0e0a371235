"""Which controller a joint has: JointConfig -> JointControl."""

from collections.abc import Callable

from ascrcp.control.config import JointConfig
from ascrcp.control.identified import IdentifiedControl
from ascrcp.control.joint import JointControl
from ascrcp.control.segmented import SegmentedControl
from ascrcp.control.stick_slip import StickSlipControl

CONTROLLERS: dict[str, Callable[[JointConfig], JointControl]] = {
    "identified": IdentifiedControl,
    "stick_slip": StickSlipControl,
    "segmented": SegmentedControl,
}


def make_controller(config: JointConfig) -> JointControl:
    """Build the controller a joint's configuration names."""
    return CONTROLLERS[config.controller](config)
