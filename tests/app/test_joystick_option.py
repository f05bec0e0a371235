"""The composition root with a joystick that is not there."""

from pathlib import Path

import pytest

from ascrcp import app
from ascrcp.core.errors import DeviceError
from ascrcp.devices.joystick import JoystickConfig
from ascrcp.devices.joystick_usb import INSTALL


def test_a_joystick_that_cannot_be_opened_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(config: JoystickConfig) -> None:
        raise DeviceError(INSTALL)

    monkeypatch.setattr(app, "open_joystick", refuse)
    with pytest.raises(DeviceError, match="pygame-ce"):
        app.open_session(app.Options(), None, tmp_path / "rounds")
    assert not (tmp_path / "rounds").exists()
