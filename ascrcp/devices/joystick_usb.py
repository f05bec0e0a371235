"""A USB joystick through SDL (pygame-ce): events of plugging, axes and buttons -> StickState."""

import importlib
import os
from typing import Any

from ascrcp.core.errors import DeviceError
from ascrcp.devices.joystick import LOST, StickState, UsbConfig, checked

INSTALL = "the USB joystick needs pygame-ce: install it with `pip install pygame-ce`"
_MS = 1_000_000


class UsbJoystick:
    """The stick with the configured index; it may come and go.

    SDL's events are pumped in the control cycle: 20 microseconds without a window of its own.
    """

    def __init__(self, config: UsbConfig, stale_ms: int) -> None:
        """Start SDL's joystick part.

        Raises:
            DeviceError: pygame-ce is not installed.
        """
        self.name = "USB"
        self._config = config
        self._stale_ns = stale_ms * _MS
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        os.environ.setdefault("SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS", "1")
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            self._sdl: Any = importlib.import_module("pygame")
        except ImportError:
            raise DeviceError(INSTALL) from None
        self._sdl.display.init()
        self._sdl.joystick.init()
        self._stick: Any = None
        self._pumped_ns = -1
        self._shown = LOST
        self._find()

    def _find(self) -> None:
        """Open the stick, if it is there."""
        index = self._config.index
        self._stick = self._sdl.joystick.Joystick(index) if self._sdl.joystick.get_count() > index else None

    @property
    def is_present(self) -> bool:
        """Whether the last state was sound."""
        return not self._shown.lost

    def read(self, now_ns: int) -> StickState:
        """Pump SDL's events and read axes and buttons."""
        self._shown = self._read(now_ns)
        return self._shown

    def _read(self, now_ns: int) -> StickState:
        sdl = self._sdl
        gap = now_ns - self._pumped_ns if self._pumped_ns >= 0 else 0
        self._pumped_ns = now_ns
        for event in sdl.event.get():
            if event.type in (sdl.JOYDEVICEADDED, sdl.JOYDEVICEREMOVED):
                self._stick = None
                self._find()
        stick, config = self._stick, self._config
        if stick is None:
            return LOST._replace(reason="no USB joystick is plugged in")
        if not gap <= self._stale_ns:
            return LOST._replace(reason=f"the USB joystick was not asked for {gap / _MS:.0f} ms")
        wanted = max(config.along.axis, config.across.axis, config.lever.axis)
        if stick.get_numaxes() <= wanted or stick.get_numbuttons() <= config.deadman:
            return LOST._replace(reason=f"the USB joystick {stick.get_name()} has too few axes or buttons")
        along, across, lever = (
            axis.sign * stick.get_axis(axis.axis) for axis in (config.along, config.across, config.lever)
        )
        state = StickState(
            max(-1.0, min(1.0, along)) if along == along else along,
            max(-1.0, min(1.0, across)) if across == across else across,
            0.0,
            max(0.0, min(1.0, lever)) if lever == lever else lever,
            bool(stick.get_button(config.deadman)),
            lost=False,
            reason="",
        )
        return checked(state)

    def close(self) -> None:
        """Release the stick."""
        self._stick = None
        self._sdl.joystick.quit()
