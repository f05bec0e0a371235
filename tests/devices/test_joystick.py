"""Joysticks: BJM1 frames both ways, what contradicts itself, silence, the stick on the screen, USB."""

import ctypes
import importlib.util
import math
from itertools import count
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.config import load
from ascrcp.core.errors import ConfigError, DeviceError
from ascrcp.core.paths import CONFIG
from ascrcp.devices.joystick import JoystickConfig, SetStick, StickState, checked
from ascrcp.devices.joystick_can import (
    FULL,
    CanJoystick,
    decode_axis,
    decode_button,
    encode_axis,
    encode_frame,
    frame_id,
)
from ascrcp.devices.joystick_usb import INSTALL, UsbJoystick

CONFIGURED = load(CONFIG / "devices" / "joystick.yaml", JoystickConfig)
MS = 1_000_000
_channel = count()


@given(st.floats(-1.0, 1.0))
def test_axis_there_and_back(value: float) -> None:
    assert abs(decode_axis(*encode_axis(value)) - value) <= 0.5 / FULL + 1e-9


@given(st.integers(0, 255), st.integers(0, 255))
def test_every_axis_word_is_read_or_refused(low: int, high: int) -> None:
    """F24: no pair of bytes becomes a deflection its statuses do not agree with."""
    try:
        value = decode_axis(low, high)
    except DeviceError:
        return
    position = high << 2 | low >> 6
    assert position <= 1000
    assert abs(value) <= 1.0
    assert value >= 0.0 or low >> 2 & 3 == 1
    assert value <= 0.0 or low >> 4 & 3 == 1


@pytest.mark.parametrize("position, word", [(1022, "error"), (1023, "no value"), (1001, "1001")])
def test_1022_and_1023_are_no_deflection(position: int, word: str) -> None:
    with pytest.raises(DeviceError, match=word):
        decode_axis(1 << 4 | (position & 3) << 6, position >> 2)


@given(st.sets(st.integers(1, 12)))
def test_buttons(buttons: set[int]) -> None:
    data = encode_frame(0.0, 0.0, frozenset(buttons))
    assert {number for number in range(1, 13) if decode_button(data, number)} == buttons


class Cable:
    """A CAN stick and its cable."""

    def __init__(self) -> None:
        tree = {name: getattr(CONFIGURED.can, name) for name in CONFIGURED.can.__struct_fields__}
        self.config = type(CONFIGURED.can)(
            **{**tree, "interface": "virtual", "channel": f"stick-{next(_channel)}"}
        )
        self.stick = CanJoystick(self.config, 60)
        self.bus = can.Bus(interface="virtual", channel=self.config.channel)

    def send(self, data: bytes, source: int | None = None) -> None:
        number = frame_id(self.config.source_address if source is None else source)
        self.bus.send(can.Message(arbitration_id=number, data=data, is_extended_id=True))

    def close(self) -> None:
        self.stick.close()
        self.stick.close()
        self.bus.shutdown()


@pytest.fixture
def cable():
    cable = Cable()
    yield cable
    cable.close()


def test_can_stick_is_lost_until_it_is_heard_and_after_60_ms_of_silence(cable: Cable) -> None:
    assert cable.stick.read(0).lost and not cable.stick.is_present
    cable.send(encode_frame(-0.5, 0.25, frozenset({cable.config.deadman})))
    state = cable.stick.read(20 * MS)
    assert not state.lost and state.deadman and cable.stick.is_present
    assert state.along == pytest.approx(0.5) and state.across == pytest.approx(0.25)
    assert not cable.stick.read(80 * MS).lost
    silent = cable.stick.read(81 * MS)
    assert silent.lost and "silent" in silent.reason and silent.along == 0.0


def test_can_stick_of_another_address_or_in_error_moves_nothing(cable: Cable) -> None:
    cable.send(encode_frame(1.0, 0.0), source=cable.config.source_address + 1)
    assert cable.stick.read(20 * MS).lost
    broken = bytearray(encode_frame(0.0, 0.0))
    broken[0] |= 3  # neutral status absent
    cable.send(bytes(broken))
    state = cable.stick.read(40 * MS)
    assert state.lost and "status" in state.reason


def test_pump_buttons_dose_within_their_rate(cable: Cable) -> None:
    for k in range(1, 101):
        cable.send(encode_frame(0.0, 0.0, frozenset({cable.config.pump_up})))
        state = cable.stick.read(20 * MS * k)
    assert state.lever == pytest.approx(min(1.0, 99 * 0.02 * cable.config.pump_rate), abs=0.02)


def test_screen_stick_is_lost_when_nobody_sets_it_any_more() -> None:
    """F29: a screen that hangs loses the stick."""
    stick = SetStick(250)
    assert stick.read(0).lost
    held = StickState(along=0.3, deadman=True, lost=False, reason="")
    stick.put(held)
    assert stick.read(20 * MS) == held
    assert stick.read(270 * MS) == held
    assert stick.read(271 * MS).lost
    stick.put(held)
    assert stick.read(300 * MS) == held
    stick.unplug()
    assert "unplugged" in stick.read(320 * MS).reason


@pytest.mark.parametrize("field", ["along", "across", "lift", "lever"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.2, 1.2])
def test_what_is_out_of_range_is_a_lost_stick(field: str, value: float) -> None:
    assert checked(StickState(lost=False, reason="")._replace(**{field: value})).lost


def test_usb_stick_says_what_to_install() -> None:
    if importlib.util.find_spec("pygame") is not None:
        stick = UsbJoystick(CONFIGURED.usb, 100)
        assert stick.read(0).lost or stick.is_present
        stick.close()
        return
    with pytest.raises(DeviceError) as error:
        UsbJoystick(CONFIGURED.usb, 100)
    assert str(error.value) == INSTALL and "pygame-ce" in INSTALL


def test_configuration_refuses_an_unknown_source(tmp_path) -> None:
    text = (CONFIG / "devices" / "joystick.yaml").read_text(encoding="utf-8")
    place = tmp_path / "joystick.yaml"
    place.write_text(text.replace("source: screen", "source: telepathy"), encoding="utf-8")
    with pytest.raises(ConfigError, match="source"):
        load(place, JoystickConfig)


def test_usb_stick_is_read_plugged_and_unplugged() -> None:
    """With SDL's own virtual joystick, where pygame-ce is installed: axes, key, unplugging (F22)."""
    pygame = pytest.importorskip("pygame")
    libraries = list((Path(pygame.__file__).parent.parent / "pygame_ce.libs").glob("libSDL2-2*"))
    if not libraries:
        pytest.skip("this pygame-ce brings no SDL library of its own")
    stick = UsbJoystick(CONFIGURED.usb, 100)
    try:
        assert stick.read(0).lost and not stick.is_present
        sdl = ctypes.CDLL(str(libraries[0]))
        sdl.SDL_JoystickOpen.restype = ctypes.c_void_p
        index = sdl.SDL_JoystickAttachVirtual(1, 4, 4, 0)
        assert not stick.read(20 * MS).lost
        opened = ctypes.c_void_p(sdl.SDL_JoystickOpen(index))
        sdl.SDL_JoystickSetVirtualAxis(opened, 0, ctypes.c_int16(-16384))
        sdl.SDL_JoystickSetVirtualAxis(opened, 1, ctypes.c_int16(-32768))
        sdl.SDL_JoystickSetVirtualButton(opened, CONFIGURED.usb.deadman, 1)
        state = stick.read(40 * MS)
        assert state.along == pytest.approx(0.5, abs=1e-3) and state.across == pytest.approx(1.0)
        assert state.deadman and stick.is_present
        sdl.SDL_JoystickDetachVirtual(index)
        state = stick.read(60 * MS)
        assert state.lost and state.along == 0.0 and not stick.is_present
    finally:
        stick.close()
