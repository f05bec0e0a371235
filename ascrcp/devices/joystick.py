"""The operator's joystick: one small interface, whatever the stick is connected by -> StickState.

A stick that is silent, unplugged or contradicts itself is `lost` (faults F22, F24); its deflections then
read zero. Judging age here, with the cycle's own instant, keeps a recorded run repeatable.
"""

import threading
from typing import Annotated, Literal, NamedTuple, Protocol

from msgspec import Meta

from ascrcp.core.config import Struct

_MS = 1_000_000


class StickState(NamedTuple):
    """What the operator's hands say in one cycle.

    Attributes:
        along: Deflection along the pass, -1..1, positive to rising section angles (left).
        across: Deflection across the passes, -1..1, positive into the tunnel.
        lift: Third deflection of the free jog, -1..1, positive up.
        lever: Spray lever, 0..1.
        deadman: Whether the enable key is held.
        lost: Whether the stick is silent, unplugged or contradicts itself.
        reason: Why, in words; empty while all is well.
    """

    along: float = 0.0
    across: float = 0.0
    lift: float = 0.0
    lever: float = 0.0
    deadman: bool = False
    lost: bool = True
    reason: str = "no joystick"

    @property
    def is_neutral(self) -> bool:
        """Whether nothing is deflected by more than a fifth."""
        return all(abs(v) <= NEUTRAL for v in (self.along, self.across, self.lift))


NEUTRAL = 0.2
"""Deflection up to which a stick counts as centred when it is enabled (fault F24); placeholder."""

LOST = StickState()

REST = StickState(lost=False, reason="")
"""A sound stick that nobody holds."""


class Joystick(Protocol):
    """Any stick."""

    name: str

    @property
    def is_present(self) -> bool:
        """Whether the last state read or set was sound; from any thread."""
        ...

    def read(self, now_ns: int) -> StickState:
        """Return the newest state; never waits, never raises.

        Args:
            now_ns: Instant of the control cycle [ns].
        """
        ...

    def close(self) -> None:
        """Release the device; a second call does nothing."""
        ...


class StaleLimits(Struct):
    """Age at which a source counts as lost [ms].

    The screen's counts from the cycle that saw it, up to one cycle after it was set, and is judged once a
    cycle: below three cycles of 20 ms the wire is zero 80 ms after the screen hung.
    """

    screen: Annotated[int, Meta(ge=20, le=59)]
    usb: Annotated[int, Meta(ge=20, le=500)]
    can: Annotated[int, Meta(ge=20, le=500)]


class AxisConfig(Struct):
    """One axis of a USB stick: its number and the sign that makes it ours."""

    axis: Annotated[int, Meta(ge=0, le=31)]
    sign: Annotated[float, Meta(ge=-1.0, le=1.0)] = 1.0


class UsbConfig(Struct):
    """A USB stick."""

    index: Annotated[int, Meta(ge=0, le=15)]
    along: AxisConfig
    across: AxisConfig
    lever: AxisConfig
    deadman: Annotated[int, Meta(ge=0, le=31)]


class CanStickConfig(Struct):
    """A CAN stick that sends J1939 BJM1 on a bus of its own."""

    interface: Literal["virtual", "socketcan"]
    channel: Annotated[str, Meta(min_length=1, max_length=64)]
    source_address: Annotated[int, Meta(ge=0, le=253)]
    along_sign: Annotated[float, Meta(ge=-1.0, le=1.0)]
    across_sign: Annotated[float, Meta(ge=-1.0, le=1.0)]
    deadman: Annotated[int, Meta(ge=1, le=12)]
    pump_up: Annotated[int, Meta(ge=1, le=12)]
    pump_down: Annotated[int, Meta(ge=1, le=12)]
    pump_rate: Annotated[float, Meta(gt=0.0, le=10.0)]


class JoystickConfig(Struct):
    """Everything in config/devices/joystick.yaml."""

    source: Literal["screen", "usb", "can"]
    stale_ms: StaleLimits
    usb: UsbConfig
    can: CanStickConfig


class SetStick:
    """A stick that somebody sets: the one on the screen, or a test's.

    Whoever sets it must go on setting it: a screen that hangs loses the stick (fault F29).
    """

    def __init__(self, stale_ms: int, name: str = "screen") -> None:
        self.name = name
        self._stale_ns = stale_ms * _MS
        self._lock = threading.Lock()
        self._state = LOST
        self._is_new = False
        self._since_ns = -1

    def put(self, state: StickState) -> None:
        """Set the state; from any thread."""
        with self._lock:
            self._state, self._is_new = state, True

    @property
    def is_present(self) -> bool:
        """Whether somebody sets it."""
        return not self._state.lost

    def unplug(self) -> None:
        """Take the stick away."""
        self.put(StickState(reason="the joystick was unplugged"))

    def read(self, now_ns: int) -> StickState:
        """Return the newest state; its age counts from the first cycle that saw it."""
        with self._lock:
            state, is_new, self._is_new = self._state, self._is_new, False
        if is_new:
            self._since_ns = now_ns
        if state.lost or self._since_ns < 0:
            return state if state.lost else LOST
        age = now_ns - self._since_ns
        if not age <= self._stale_ns:
            return StickState(reason=f"the {self.name} joystick is silent for {age / _MS:.0f} ms")
        return checked(state)

    def close(self) -> None:
        """Nothing is open."""


def checked(state: StickState) -> StickState:
    """Return a state whose numbers are in range, else a lost stick that says which is not (fault F24)."""
    for name in ("along", "across", "lift", "lever"):
        value = getattr(state, name)
        low = 0.0 if name == "lever" else -1.0
        if not low - 1e-6 <= value <= 1.0 + 1e-6:
            return StickState(reason=f"the joystick's {name} axis is out of range")
    return state
