"""The 2-D lidar over TCP: driver -> LidarLine. SICK LMS1xx, LMS5xx and TiM in their binary dialect."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from ascrcp.core.config import Struct
from ascrcp.core.errors import DeviceError
from ascrcp.core.geometry import Array
from ascrcp.devices import lidar_telegram as cola


class SweepConfig(Struct):
    """How the pan head carries the scan plane over the heading (thesis 3.1).

    Attributes:
        start_deg: Pan angle of the first line [deg].
        stop_deg: Pan angle of the last line [deg].
        step_deg: Pan angle between lines [deg].
        lines_per_s: Lines taken per second [1/s], the lidar's scan frequency.
    """

    start_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    stop_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    step_deg: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)]
    lines_per_s: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]

    def __post_init__(self) -> None:
        if not self.start_deg < self.stop_deg:
            raise ValueError(f"sweep start_deg {self.start_deg} must lie below stop_deg {self.stop_deg}")

    @property
    def pan(self) -> Array:
        """Pan angle of every line [rad], shape (lines,)."""
        count = int((self.stop_deg - self.start_deg) / self.step_deg + 0.5) + 1
        return np.radians(np.linspace(self.start_deg, self.stop_deg, count))


class LidarDeviceConfig(Struct):
    """Where the lidar answers and how it is swept: config/devices/lidar.yaml.

    Attributes:
        host: Its address; keep it on a network of its own.
        port: TCP port that speaks CoLa-B.
        timeout_s: Longest wait for one telegram [s].
        sweep: Pan motion of one scan.
    """

    host: str
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)]
    timeout_s: Annotated[float, msgspec.Meta(ge=0.02, le=30.0)]
    sweep: SweepConfig


@dataclass(frozen=True)
class LidarLine:
    """One turn of the mirror.

    Attributes:
        ranges: Distances [m], NaN where nothing valid came back, shape (beams,).
        beam: Beam angles in the scan plane [rad], shape (beams,).
        scan_counter: The device's own count of scans, 16 bit: a gap means missed lines (fault F35).
        status: Device status, 0 is healthy (fault F35).
        missed: Scans the device made between the line before and this one.
    """

    ranges: NDArray[np.float32]
    beam: Array
    scan_counter: int
    status: int
    missed: int = 0


class Lidar(Protocol):
    """Any line scanner. Every method raises DeviceError with one line when it cannot."""

    def open(self) -> None:
        """Connect and identify the device."""
        ...

    def read_line(self) -> LidarLine:
        """Return the next line that was not returned before."""
        ...

    def close(self) -> None:
        """Disconnect; closing twice is allowed."""
        ...


class SickLidar:
    """Driver of a SICK scanner set to CoLa-B. After any DeviceError it is closed: open it again.

    Args:
        host: Address of the scanner.
        port: TCP port that speaks CoLa-B (2112 on LMS1xx and LMS5xx as delivered).
        timeout: Longest wait for one new line [s].
    """

    def __init__(self, host: str, port: int, timeout: float) -> None:
        if not 0.0 < timeout < float("inf"):
            raise DeviceError(f"lidar timeout {timeout} s, allowed above 0")
        self._where = f"lidar {host}:{port}"
        self._address = (host, port)
        self._timeout = timeout
        self._socket: socket.socket | None = None
        self._last_scan: int | None = None
        self.ident = ""

    def open(self) -> None:
        """Connect and ask the device who it is.

        Raises:
            DeviceError: Nobody answers there, or not in CoLa-B.
        """
        self.close()
        try:
            self._socket = socket.create_connection(self._address, self._timeout)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            self.close()
            raise DeviceError(f"{self._where}: cannot connect: {error}") from None
        self._last_scan = None
        with self._closed_on_error():
            self.ident = cola.decode_ident(self._ask(cola.IDENT_READ, self._deadline()))

    def read_line(self) -> LidarLine:
        """Poll until the device has a scan that was not returned before.

        Raises:
            DeviceError: Not open, silent, gone, a broken telegram, or a scan counter that stands
                still or runs backwards.
        """
        with self._closed_on_error():
            deadline = self._deadline()
            while True:
                scan = cola.decode_scan(self._ask(cola.READ, deadline))
                if scan.scan_counter != self._last_scan:
                    return self._line(scan)

    def close(self) -> None:
        """Disconnect; closing twice is allowed."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @contextmanager
    def _closed_on_error(self) -> Iterator[None]:
        # what follows a broken telegram cannot be trusted to start at a telegram's start
        try:
            yield
        except DeviceError as error:
            self.close()
            raise DeviceError(f"{self._where}: {error}") from None

    def _line(self, scan: cola.Telegram) -> LidarLine:
        step = 1 if self._last_scan is None else (scan.scan_counter - self._last_scan) & 0xFFFF
        if step > 0x7FFF:
            raise DeviceError(f"scan counter runs backwards, from {self._last_scan} to {scan.scan_counter}")
        self._last_scan = scan.scan_counter
        return LidarLine(scan.ranges, scan.beam, scan.scan_counter, scan.status, step - 1)

    def _deadline(self) -> float:
        return time.monotonic() + self._timeout

    def _ask(self, payload: bytes, deadline: float) -> bytes:
        if self._socket is None:
            raise DeviceError("not open")
        try:
            self._socket.settimeout(self._left(deadline))
            self._socket.sendall(cola.encode_frame(payload))
        except OSError as error:
            raise DeviceError(f"connection lost: {error}") from None
        length = cola.decode_length(self._receive(cola.HEADER_BYTES, deadline))
        answer = self._receive(length + 1, deadline)
        cola.check_payload(answer[:-1], answer[-1])
        return answer[:-1]

    def _receive(self, size: int, deadline: float) -> bytes:
        assert self._socket is not None
        buffer = bytearray(size)
        view, got = memoryview(buffer), 0
        while got < size:
            self._socket.settimeout(self._left(deadline))
            try:
                count = self._socket.recv_into(view[got:])
            except TimeoutError:
                continue  # the deadline decides
            except OSError as error:
                raise DeviceError(f"connection lost: {error}") from None
            if count == 0:
                raise DeviceError(f"closed the connection after {got} of {size} bytes")
            got += count
        return bytes(buffer)

    def _left(self, deadline: float) -> float:
        left = deadline - time.monotonic()
        if not left > 0.0:
            raise DeviceError(f"no new scan within {self._timeout:g} s")
        return left
