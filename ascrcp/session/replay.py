"""Run a recorded round's inputs through a fresh control cycle and compare every command bit by bit."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from ascrcp.core.errors import InputError
from ascrcp.session.cycle import Cycle
from ascrcp.session.order import decode_order
from ascrcp.session.recorder import CAN_TOPIC, ORDER_TOPIC, decode_frames
from ascrcp.session.round import Round

Frames = list[tuple[int, bytes]]


class ReplayBus:
    """Stands where the CAN bus stood: gives the recorded frames, keeps what is sent."""

    def __init__(self) -> None:
        self.ok = True
        self._received: Frames = []
        self.sent: Frames = []

    def feed(self, received: Frames) -> None:
        """Put one cycle's frames on the bus."""
        self._received = received
        self.sent = []

    def drain(self) -> Frames:
        """Return the frames of this cycle once."""
        frames, self._received = self._received, []
        return frames

    def send(self, can_id: int, data: bytes | bytearray) -> bool:
        """Keep one command frame."""
        self.sent.append((can_id, bytes(data)))
        return True


@dataclass(frozen=True)
class Replay:
    """Outcome of a replay.

    Attributes:
        cycles: Control cycles run again.
        commands: Command frames compared.
        differing: How many differ.
        first_difference_s: Job time of the first, None if none.
    """

    cycles: int
    commands: int
    differing: int
    first_difference_s: float | None


def replay(folder: Path, build: Callable[[ReplayBus], Cycle]) -> Replay:
    """Replay a round.

    Args:
        folder: Round folder with a run log.
        build: Puts a fresh cycle together on a bus, with the round's configuration.

    Raises:
        InputError: No run log, or one that cannot be read.
    """
    bus = ReplayBus()
    cycle = build(bus)
    cycles = commands = differing = 0
    first: float | None = None
    for t_ns, orders, received, sent in _cycles(Round(folder).need("log", "run")):
        for kind, value in orders:
            cycle.order(kind, value)
        bus.feed(received)
        cycle.step(t_ns)
        cycles += 1
        commands += len(sent)
        wrong = sum(a != b for a, b in zip(bus.sent, sent, strict=False)) + abs(len(bus.sent) - len(sent))
        if wrong and first is None:
            first = t_ns * 1e-9
        differing += wrong
    return Replay(cycles, commands, differing, first)


def _cycles(log: Path) -> Iterator[tuple[int, list[tuple[str, object]], Frames, Frames]]:
    """Read the cycles in the order they were written, from a finished or a cut log."""
    orders: list[tuple[str, object]] = []
    try:
        with log.open("rb") as file:
            for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                if channel.topic == ORDER_TOPIC:
                    orders.append(decode_order(message.data))
                elif channel.topic == CAN_TOPIC:
                    received, sent = decode_frames(message.data)
                    yield message.log_time, orders, received, sent
                    orders = []
    except (McapError, OSError, ValueError) as error:
        raise InputError(f"{log}: not a readable run log: {error}") from None
