"""The SICK driver against a peer that speaks the bytes of a bad day."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np
import pytest

from ascrcp.core.config import convert
from ascrcp.core.errors import ConfigError, DeviceError
from ascrcp.devices import lidar_telegram as cola
from ascrcp.devices.lidar import LidarDeviceConfig, SickLidar

IDENT = cola.encode_frame(cola.encode_ident("LMS511", "V2.30"))


def scan(counter: int, codes: list[int] | None = None) -> bytes:
    values = np.array(codes or [5900] * 10, np.uint16)
    return cola.encode_frame(cola.encode_scan(cola.Telegram(codes=values, scan_counter=counter)))


@contextmanager
def peer(answers: tuple[bytes, ...], pieces: list[bytes], hang_up: bool) -> Iterator[int]:
    """Answer the first request with a DeviceIdent, each further one with the next of the answers.

    After the last one send the pieces, then hang up or stay until the driver does.
    """
    listener = socket.create_server(("127.0.0.1", 0))

    def talk() -> None:
        client, _ = listener.accept()
        with client:
            for answer in (IDENT, *answers):
                if not client.recv(1024):
                    return
                client.sendall(answer)
            for piece in pieces:
                client.sendall(piece)
            if not hang_up:
                with suppress(ConnectionResetError):  # the driver may hang up on unread bytes
                    client.recv(1024)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        thread.join(10.0)
        listener.close()


@contextmanager
def opened(
    *answers: bytes, timeout: float = 5.0, pieces: list[bytes] | None = None, hang_up: bool = False
) -> Iterator[SickLidar]:
    with peer(answers, pieces or [], hang_up) as port:
        driver = SickLidar("127.0.0.1", port, timeout)
        driver.open()
        try:
            yield driver
        finally:
            driver.close()


def test_reads_lines_and_counts_missed_scans() -> None:
    with opened(scan(65534), scan(65535), scan(1, [3, 16, 1000])) as driver:
        assert driver.ident == "LMS511 V2.30"
        assert [driver.read_line().missed for _ in range(2)] == [0, 0]
        line = driver.read_line()
    assert line.missed == 1 and line.scan_counter == 1
    np.testing.assert_allclose(line.ranges, [np.nan, 0.016, 1.0], rtol=1e-6)


def test_asks_again_until_the_scan_is_new() -> None:
    with opened(scan(7), scan(7), scan(7), scan(8)) as driver:
        assert [driver.read_line().scan_counter for _ in range(2)] == [7, 8]


def test_telegram_in_pieces_is_put_together() -> None:
    # the piece that follows answers a request that is not asked before the first telegram is whole
    frame = scan(1)
    with opened(frame[:5], pieces=[frame[5:9], frame[9:100], frame[100:]]) as driver:
        assert driver.read_line().scan_counter == 1


def test_peer_that_hangs_up_midway_is_one_line() -> None:
    with (
        opened(scan(1)[:30], hang_up=True) as driver,
        pytest.raises(DeviceError, match="closed the connection"),
    ):
        driver.read_line()


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (scan(1)[:-1] + bytes([scan(1)[-1] ^ 1]), "checksum"),
        (b"\x02sRA LMDscandata 1 1\x03", "starts with"),
        (cola.STX + b"\x7f\xff\xff\xff" + bytes(100), "allowed 3..65536"),
        (cola.encode_frame(b"sFA\x00\x08"), "SOPAS error 8"),
        (cola.encode_frame(b"sRA SCdevicestate \x00"), "expected LMDscandata"),
        (cola.encode_frame(cola.ANSWERS[0] + bytes(20)), "ends before"),
    ],
    ids=["checksum", "ascii dialect", "absurd length", "refusal", "other answer", "short"],
)
def test_broken_answer_is_one_line_and_closes(answer: bytes, says: str) -> None:
    with opened(answer) as driver:
        with pytest.raises(DeviceError, match=says) as caught:
            driver.read_line()
        assert str(caught.value).startswith("lidar 127.0.0.1:") and "\n" not in str(caught.value)
        with pytest.raises(DeviceError, match="not open"):
            driver.read_line()


def test_counter_running_backwards_is_refused() -> None:
    with opened(scan(100), scan(90)) as driver:
        driver.read_line()
        with pytest.raises(DeviceError, match="backwards"):
            driver.read_line()


def test_silence_ends_at_the_timeout() -> None:
    with opened(b"", timeout=0.2) as driver, pytest.raises(DeviceError, match="no new scan within"):
        driver.read_line()


def test_nobody_there_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(DeviceError, match="cannot connect"):
        SickLidar("127.0.0.1", port, 1.0).open()


@pytest.mark.parametrize("timeout", [0.0, -1.0, float("nan"), float("inf")])
def test_timeout_must_be_positive(timeout: float) -> None:
    with pytest.raises(DeviceError, match="timeout"):
        SickLidar("127.0.0.1", 1, timeout)


def test_sweep_that_runs_backwards_is_refused() -> None:
    sweep = {"start_deg": 10.0, "stop_deg": -10.0, "step_deg": 1.0, "lines_per_s": 25.0}
    with pytest.raises(ConfigError, match="start_deg"):
        convert({"host": "x", "port": 1, "timeout_s": 1.0, "sweep": sweep}, LidarDeviceConfig, "lidar.yaml")
