"""Record the run: a thread with a queue writes MCAP and the journal; the control loop never touches a disk.

Small chunks, handed to the system five times a second of job time, so that a killed process loses at
most the last (faults, trap 8: MCAP's defaults lose everything).
"""

import contextlib
import itertools
import logging
import queue
import threading
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.writer import CompressionType, Writer

from ascrcp.core.errors import InputError
from ascrcp.session.cycle import CycleOutput
from ascrcp.session.journal import Entry, Journal
from ascrcp.session.log_index import ChunkIndexFile, keep_index_in
from ascrcp.session.order import encode_order
from ascrcp.session.store import encode_json

CHUNK_BYTES = 16 * 1024  # faults, trap 8
KEPT_MESSAGES = 20_000  # waiting for the disk: two minutes of the run, 20 MB (placeholder)
LOCKSTEP_DISK_S = 30.0  # what a busy disk may take while time stands still
FLUSH_NS = 200_000_000  # at most this much of the run is lost to a killed process (faults G9: 0.5 s)

Frames = list[tuple[int, bytes]]

_log = logging.getLogger(__name__)

_NUMBERS = {"type": "array", "items": {"type": "number"}}
_SCHEMAS: dict[str, dict[str, Any]] = {
    "/joints": {"q": _NUMBERS, "q_ref": _NUMBERS, "drive": _NUMBERS, "reaction": {"type": "integer"}},
    "/nozzle": {
        "measured": _NUMBERS,
        "reference": _NUMBERS,
        "truth": _NUMBERS,
        "point": {"type": "integer"},
        "spraying": {"type": "boolean"},
    },
    "/event": {"kind": {"type": "string"}, "code": {"type": "string"}, "detail": {"type": "string"}},
}
CAN_TOPIC = "/can"
"""One message a cycle: see `encode_frames`."""
ORDER_TOPIC = "/order"
"""Orders taken in the cycle whose frames follow: see order.py."""


class Message(NamedTuple):
    """One record on its way to the file: topic, instant [ns], content."""

    topic: str
    t_ns: int
    content: Any


def encode_frames(received: Frames, sent: Frames) -> bytes:
    """Pack one cycle's CAN frames: count received, then per frame id (2), length (1), data; then sent."""
    parts = [len(received).to_bytes(2, "little")]
    for number, data in (*received, *sent):
        parts += (number.to_bytes(4, "little"), len(data).to_bytes(1, "little"), data)
    return b"".join(parts)


def decode_frames(blob: bytes) -> tuple[Frames, Frames]:
    """Unpack what `encode_frames` packed: (received, sent)."""
    count = int.from_bytes(blob[:2], "little")
    frames, at = [], 2
    while at < len(blob):
        size = blob[at + 4]
        frames.append((int.from_bytes(blob[at : at + 4], "little"), blob[at + 5 : at + 5 + size]))
        at += 5 + size
    return frames[:count], frames[count:]


class Recorder:
    """Queue and thread that write `run.mcap` and `events.sqlite` into a round folder.

    Attributes:
        failed: Why nothing more is written, None while all is well.
        lost: Records there was no room for.
    """

    def __init__(self, folder: Path, patience_s: float = 0.0) -> None:
        """Open both files; the log of an earlier session in this folder is kept as `run-N.mcap`.

        Args:
            folder: Round folder.
            patience_s: How long a record may wait for room: none in real time; in lockstep time stands
                still meanwhile.

        Raises:
            InputError: A file cannot be opened.
        """
        self._queue: queue.Queue[Message | None] = queue.Queue(KEPT_MESSAGES)
        self._patience_s = patience_s
        self.lost = 0
        self._journal = Journal(folder / "events.sqlite")
        try:
            self._file = _open_log(folder / "run.mcap")
            self._index = ChunkIndexFile(folder)
        except OSError as error:
            self._journal.close()
            raise InputError(f"{folder / 'run.mcap'}: {error.strerror or error}") from None
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="ascrcp")
        keep_index_in(self._index, self._writer)
        self._channels = {topic: self._register(topic, schema) for topic, schema in _SCHEMAS.items()}
        for topic, encoding in ((CAN_TOPIC, "x-ascrcp-can"), (ORDER_TOPIC, "x-ascrcp-order")):
            self._channels[topic] = self._writer.register_channel(topic, encoding, 0)
        self._thread = threading.Thread(target=self._work, name="ascrcp-recorder", daemon=True)
        self._flushed_ns = 0
        self.failed: str | None = None
        self._thread.start()

    def _register(self, topic: str, properties: dict[str, Any]) -> int:
        schema = {"type": "object", "properties": properties}
        number = self._writer.register_schema(f"ascrcp{topic}", "jsonschema", encode_json(schema))
        return self._writer.register_channel(topic, "json", number)

    def put(self, topic: str, t_ns: int, content: Any) -> None:
        """Queue one record; in real time at once: a slow disk loses records, and says so (F38)."""
        try:
            self._queue.put(Message(topic, t_ns, content), timeout=self._patience_s)
        except queue.Full:
            self.lost += 1
            self.failed = self.failed or f"run log: the disk is too slow, {KEPT_MESSAGES} records wait"

    def put_cycle(self, output: CycleOutput, received: Frames, sent: Frames) -> None:
        """Queue everything one control cycle saw and did."""
        track, t = output.track, output.t_ns
        for order in output.orders:
            self.put(ORDER_TOPIC, t, order)
        self.put(CAN_TOPIC, t, encode_frames(received, sent))
        joints = {
            "q": output.inputs.q,
            "q_ref": track.q_ref,
            "drive": output.verdict.command.drive,
            "reaction": int(output.verdict.reaction),
        }
        self.put("/joints", t, joints)
        if output.tip is not None and track.state == "follow":
            nozzle = {
                "measured": output.tip[:3, 3],
                "reference": track.position,
                "truth": output.truth[:3, 3] if output.truth is not None else (),
                "point": track.point,
                "spraying": track.spraying,
            }
            self.put("/nozzle", t, nozzle)

    def put_event(self, t_ns: int, kind: str, code: str, detail: str = "") -> None:
        """Queue one event for the journal and the log."""
        self.put("/event", t_ns, {"kind": kind, "code": code, "detail": detail})

    def _work(self) -> None:
        while (message := self._queue.get()) is not None:
            if self.failed is not None:
                continue  # keep draining: a full disk may neither fill the memory nor stop the motion (F38)
            try:
                self._write(message)
            except Exception as error:  # noqa: BLE001 - shown to the operator by the session
                self.failed = f"run log: {error}"
                _log.error("%s", self.failed)

    def _write(self, message: Message) -> None:
        topic, t_ns, content = message
        if topic == "/event":
            self._journal.append(Entry(t_ns / 1e9, content["kind"], content["code"], content["detail"]))
        if topic == ORDER_TOPIC:
            data = encode_order(*content)
        else:
            data = content if isinstance(content, bytes) else encode_json(content)
        self._writer.add_message(self._channels[topic], t_ns, data, t_ns)
        if t_ns - self._flushed_ns >= FLUSH_NS:
            self._writer.flush()
            self._flushed_ns = t_ns

    def close(self) -> None:
        """Write what is queued and finish the file."""
        if not self._thread.is_alive():
            return
        self._queue.put(None)
        self._thread.join()
        try:
            with (
                contextlib.closing(self._journal),
                contextlib.closing(self._file),
                contextlib.closing(self._index),
            ):
                self._writer.finish()
        except OSError as error:
            self.failed = self.failed or f"run log: {error}"


def _open_log(place: Path) -> BinaryIO:
    if place.is_file() and place.stat().st_size:
        kept = (place.with_name(f"run-{number}.mcap") for number in itertools.count(1))
        place.rename(next(name for name in kept if not name.exists()))
    return place.open("wb")
