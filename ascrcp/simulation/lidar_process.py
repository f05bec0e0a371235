"""The simulated lidar's own process: CoLa-B over TCP on loopback, answered from the ray-cast heading.

Apart because Open3D holds the interpreter's lock while it casts (design, section 2).
"""

import selectors
import signal
import socket
import struct
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ascrcp.core.errors import DeviceError
from ascrcp.core.geometry import Array
from ascrcp.core.priority import be_ordinary
from ascrcp.devices import lidar_telegram as cola
from ascrcp.simulation.growth import GrowingWall, SprayTruth
from ascrcp.simulation.heading import Heading
from ascrcp.simulation.lidar_model import LidarConfig, LidarModel
from ascrcp.simulation.lidar_pose import PoseBoard

HOST = "127.0.0.1"
MAX_REQUEST = 1024  # a longer request is not ours [bytes]
UNKNOWN_COMMAND = b"sFA" + struct.pack(">H", 2)  # SOPAS: method or variable unknown
FAULTS = ("silent", "corrupt", "truncate", "freeze", "status")
IDLE_S = 0.5  # the wall is looked at anew when nothing has been laid for so long: no scan waits for it


class LidarNode:
    """Answers requests: the protocol without the wire.

    Args:
        config: The scanner.
        model: What it sees.
        poses: Where it is.
        seed: Seed of its noise; every scan draws from (seed, scan counter) alone.
        wall: What it looks at, where it grows; None where it does not.
    """

    def __init__(
        self,
        config: LidarConfig,
        model: LidarModel,
        poses: PoseBoard,
        seed: int,
        wall: GrowingWall | None = None,
    ) -> None:
        self._config = config
        self._model = model
        self._wall = wall
        self.has_grown = False
        self._poses = poses
        self._seed = seed
        self._scans = 0
        self._faults = dict.fromkeys(FAULTS, 0)

    def inject(self, fault: str, telegrams: int) -> None:
        """Spoil the next telegrams in one of the ways of FAULTS."""
        self._faults[fault] = telegrams

    def lay(self, batch: Array) -> None:
        """Let the wall grow; it is looked at anew before the next scan."""
        if self._wall is not None:
            self._wall.lay(batch)
            self.has_grown = True

    def concrete(self) -> dict[str, Any]:
        """Return what became of the concrete [m3], empty where no wall grows."""
        return {} if self._wall is None else self._wall.summary()

    def look_anew(self) -> None:
        """Take the wall as it has grown."""
        if self.has_grown and self._wall is not None:
            self._model = LidarModel(self._config, self._wall.heading())
            self.has_grown = False

    def answer(self, payload: bytes) -> bytes:
        """Return the frame that answers one request, empty if the scanner stays silent."""
        if self._take("silent"):
            return b""
        if payload == cola.READ:
            frame = cola.encode_frame(self._scan())
        elif payload == cola.IDENT_READ:
            frame = cola.encode_frame(cola.encode_ident(self._config.name, "V1.00"))
        else:
            frame = cola.encode_frame(UNKNOWN_COMMAND)
        if self._take("corrupt"):
            frame = frame[:-2] + bytes([frame[-2] ^ 0x10]) + frame[-1:]
        if self._take("truncate"):
            frame = frame[: len(frame) // 2]
        return frame

    def _scan(self) -> bytes:
        config = self._config
        if not self._take("freeze"):
            self._scans += 1
        self.look_anew()
        T_base_mount, pan = self._poses.read()
        rng = np.random.default_rng([self._seed, self._scans])
        metres = self._model.measure(T_base_mount, pan, rng)
        codes = np.where(np.isfinite(metres), np.rint(metres * 1e3), 0.0)
        codes = np.where(codes >= cola.FIRST_VALID_CODE, np.minimum(codes, 65535.0), 0.0)
        telegram = cola.Telegram(
            codes=codes.astype(np.uint16),
            start=round(config.beam_start_deg * 1e4),
            step=round(config.beam_step_deg * 1e4),
            status=1 if self._take("status") else 0,
            telegram_counter=self._scans,
            scan_counter=self._scans,
            time_us=round(self._scans * 1e6 / config.lines_per_s),
        )
        return cola.encode_scan(telegram, serial=self._seed & 0xFFFFFFFF, scan_hz=config.lines_per_s)

    def _take(self, fault: str) -> bool:
        if self._faults[fault] <= 0:
            return False
        self._faults[fault] -= 1
        return True


def serve(config: LidarConfig, seed: int, poses: PoseBoard, pipe: Connection) -> None:
    """Run the scanner until the parent closes its end of the pipe or is gone.

    The first message that comes is the heading and how it takes up concrete; the first message back is
    the port, or the reason why there is none.
    """
    be_ordinary()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent; closing its pipe ends us
    try:
        heading, spray = _receive(pipe)
        wall = None if spray is None else GrowingWall(heading, spray, seed)
        node = LidarNode(config, LidarModel(config, heading), poses, seed, wall)
        listener = socket.create_server((HOST, 0))
    except EOFError:  # the parent is gone already
        return
    except (DeviceError, OSError) as error:
        pipe.send(str(error))
        return
    with selectors.DefaultSelector() as selector, listener:
        selector.register(pipe, selectors.EVENT_READ, None)
        selector.register(listener, selectors.EVENT_READ, lambda: _accept(listener, selector, node))
        pipe.send(listener.getsockname()[1])
        while _follow_parent(pipe, node):
            ready = selector.select(IDLE_S if node.has_grown else None)
            if not ready:
                node.look_anew()
            for key, _ in ready:
                if key.data is not None and _follow_parent(pipe, node):
                    key.data()
        for key in list(selector.get_map().values()):
            if isinstance(key.fileobj, socket.socket):
                key.fileobj.close()


def _receive(pipe: Connection) -> tuple[Heading, SprayTruth | None]:
    first: tuple[Heading, SprayTruth | None] = pipe.recv()
    return first


def _follow_parent(pipe: Connection, node: LidarNode) -> bool:
    """Take what the parent says before anything else; False when it is gone."""
    try:
        while pipe.poll():
            kind, value = pipe.recv()
            if kind == "fault":
                node.inject(*value)
            elif kind == "lay":
                node.lay(value)
            else:
                pipe.send(node.concrete())
    except (EOFError, OSError):
        return False
    return True


def _accept(listener: socket.socket, selector: selectors.BaseSelector, node: LidarNode) -> None:
    client, _ = listener.accept()
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    buffer = bytearray()
    selector.register(client, selectors.EVENT_READ, _reader(client, buffer, selector, node))


def _reader(
    client: socket.socket, buffer: bytearray, selector: selectors.BaseSelector, node: LidarNode
) -> Callable[[], None]:
    def read() -> None:
        try:
            chunk = client.recv(MAX_REQUEST)
            buffer.extend(chunk)
            for payload in _requests(buffer):
                client.sendall(node.answer(payload))
        except (OSError, DeviceError):  # gone, or not speaking CoLa-B: hang up, as the scanner does
            chunk = b""
        if not chunk:
            selector.unregister(client)
            client.close()

    return read


def _requests(buffer: bytearray) -> list[bytes]:
    """Take the complete requests out of a receive buffer."""
    found = []
    while len(buffer) >= cola.HEADER_BYTES:
        length = cola.decode_length(bytes(buffer[: cola.HEADER_BYTES]))
        if length > MAX_REQUEST:
            raise DeviceError(f"request of {length} bytes, allowed {MAX_REQUEST}")
        end = cola.HEADER_BYTES + length + 1
        if len(buffer) < end:
            break
        payload = bytes(buffer[cola.HEADER_BYTES : end - 1])
        cola.check_payload(payload, buffer[end - 1])
        found.append(payload)
        del buffer[:end]
    return found
