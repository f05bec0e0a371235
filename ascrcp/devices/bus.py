"""The CAN bus as the control cycle sees it: drain what came, send what must go, never raise, never wait.

No filter in python-can, no periodic sender (it would keep a dead loop alive), no use of a frame's
own timestamp (it follows the wall clock). A failure of the adapter becomes a flag (faults F30, F33);
the bus stays failed until it is opened anew, so that no stale command leaves after a recovery.
"""

from typing import Annotated, Literal, Protocol

import can
import msgspec

from ascrcp.core.config import Struct
from ascrcp.core.errors import DeviceError

# linux/can/error.h: error frames carry their class in the identifier
ERROR_BUS_OFF = 0x40

MAX_ID = 0x7FF


class ChannelConfig(Struct):
    """Which bus to open.

    Attributes:
        interface: "virtual" (in this process, for the simulated rig) or "socketcan" (in the cab).
        channel: Name of the channel; for socketcan the network interface.
        drain_cap: Most frames taken off the bus in one cycle.
    """

    interface: Literal["virtual", "socketcan"]
    channel: Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
    drain_cap: Annotated[int, msgspec.Meta(ge=50, le=5000)] = 500


class FrameBus(Protocol):
    """Where frames come from and go to: an open bus, or a recorded one."""

    ok: bool

    def drain(self) -> list[tuple[int, bytes]]:
        """Take every waiting frame: (identifier, data), oldest first."""
        ...

    def send(self, can_id: int, data: bytes | bytearray) -> bool:
        """Send one frame without waiting; return whether it was taken."""
        ...


class Bus:
    """One open CAN bus.

    Attributes:
        ok: False after an error of the adapter or bus-off, until reopen().
        error: What went wrong, for messages; empty while ok.
        dropped: Frames refused so far by reason: "extended", "remote", "fd", "error".
        cap_hits: Consecutive cycles in which the drain cap was reached (fault F31).
    """

    def __init__(self, config: ChannelConfig, channel: str | None = None) -> None:
        """Open the bus.

        Args:
            config: Interface and channel.
            channel: Another channel name, so that two virtual rigs in one process do not meet.

        Raises:
            DeviceError: The interface cannot be opened.
        """
        self._config = config
        self._channel = channel or config.channel
        self.dropped = {"extended": 0, "remote": 0, "fd": 0, "error": 0}
        self.cap_hits = 0
        self._open()

    def _open(self) -> None:
        try:
            self._bus: can.BusABC = can.Bus(
                interface=self._config.interface,
                channel=self._channel,
                receive_own_messages=False,
                ignore_config=True,
            )
        except (can.CanError, OSError, ImportError) as error:
            raise DeviceError(
                f"CAN bus {self._config.interface}:{self._channel} cannot be opened ({error})"
            ) from None
        self.ok = True
        self.error = ""

    def drain(self) -> list[tuple[int, bytes]]:
        """Take everything off the receive queue, at most drain_cap frames.

        The caller stamps the frames with its own monotonic instant: this call is the receipt.

        Returns:
            (identifier, data) of every classic 11-bit data frame, oldest first.
        """
        frames: list[tuple[int, bytes]] = []
        if not self.ok:
            return frames
        receive = self._bus.recv
        try:
            for _ in range(self._config.drain_cap):
                message = receive(0)
                if message is None:
                    self.cap_hits = 0
                    return frames
                if self._accept(message):
                    frames.append((message.arbitration_id, bytes(message.data)))
        except (can.CanError, OSError) as error:
            self._fail(error)
            return frames
        self.cap_hits += 1
        return frames

    def _accept(self, message: can.Message) -> bool:
        if message.is_error_frame:
            self.dropped["error"] += 1
            if message.arbitration_id & ERROR_BUS_OFF:
                self._fail("bus-off")
            return False
        if message.is_extended_id or message.arbitration_id > MAX_ID:
            self.dropped["extended"] += 1
            return False
        if message.is_remote_frame:
            self.dropped["remote"] += 1
            return False
        if message.is_fd:
            self.dropped["fd"] += 1
            return False
        return True

    def send(self, can_id: int, data: bytes | bytearray) -> bool:
        """Send one frame without waiting.

        Returns:
            Whether the adapter took it; if not, the bus counts as failed.
        """
        if not self.ok:
            return False
        try:
            self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False), timeout=0)
        except (can.CanError, OSError) as error:
            self._fail(error)
            return False
        return True

    def _fail(self, error: object) -> None:
        if self.ok:
            self.ok = False
            self.error = f"CAN bus {self._config.interface}:{self._channel}: {error}"

    def reopen(self) -> None:
        """Close and open again, with empty queues; only on the operator's reset.

        Raises:
            DeviceError: The interface cannot be opened.
        """
        self.close()
        self._open()

    def close(self) -> None:
        """Release the adapter; a second call does nothing."""
        self.ok = False
        self._bus.shutdown()
