"""Run log and journal: frames and orders come back bit by bit; a killed writer loses little."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import ChunkIndex

from ascrcp.core.errors import InputError
from ascrcp.core.flow import JointSequence
from ascrcp.session.journal import Journal
from ascrcp.session.order import decode_order, encode_order
from ascrcp.session.recorder import CAN_TOPIC, FLUSH_NS, Recorder, decode_frames, encode_frames

FRAME = st.tuples(st.integers(0, 2**29 - 1), st.binary(max_size=8))


@given(st.lists(FRAME, max_size=20), st.lists(FRAME, max_size=6))
def test_frames_come_back(received: list[tuple[int, bytes]], sent: list[tuple[int, bytes]]) -> None:
    assert decode_frames(encode_frames(received, sent)) == (received, sent)


def test_follow_order_comes_back_bit_by_bit() -> None:
    rng = np.random.default_rng(2)
    sequence = JointSequence(
        t=np.arange(4.0),
        q=rng.normal(size=(4, 8)),
        position=rng.normal(size=(4, 3)),
        direction=rng.normal(size=(4, 3)),
        point=np.array([0, -1, -1, 1]),
        spraying=np.array([True, True, False, False]),
        flow=np.array([0.5, 0.25, 0.0, 0.0]),
    )
    kind, (back, from_s) = decode_order(encode_order("follow", (sequence, 1.25)))
    assert (kind, from_s) == ("follow", 1.25)
    for name in JointSequence.SHAPES:
        assert getattr(back, name).tobytes() == getattr(sequence, name).tobytes()
    for order in (("stop", None), ("reset", None), ("hold", None), ("pan", 0.3)):
        assert decode_order(encode_order(*order)) == order


def test_log_and_journal_hold_what_was_put(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    for i in range(500):
        recorder.put(CAN_TOPIC, i, encode_frames([(0x181, bytes(8))], []))
        recorder.put(
            "/joints", i, {"q": (0.0,) * 8, "q_ref": (float("nan"),) * 8, "drive": (), "reaction": 0}
        )
    recorder.put_event(7, "step", "zero", "started")
    recorder.close()
    with (tmp_path / "run.mcap").open("rb") as file:
        times = [m.log_time for _, c, m in NonSeekingReader(file).iter_messages() if c.topic == CAN_TOPIC]
    assert times == list(range(500))
    journal = Journal(tmp_path / "events.sqlite")
    assert [(e.kind, e.code, e.detail) for e in journal.entries()] == [("step", "zero", "started")]
    journal.close()


def test_finished_log_has_its_index_though_memory_held_none_of_it(tmp_path: Path) -> None:
    """Other programs seek by the index; a list of it would grow by 13 MB an hour."""
    recorder = Recorder(tmp_path)
    held = []
    for chunks in (100, 1600):
        for i in range(chunks):
            recorder.put(CAN_TOPIC, i * FLUSH_NS, bytes(30))
        while recorder._queue.qsize():
            threading.Event().wait(0.001)
        gc.collect()
        held.append(sum(isinstance(kept, ChunkIndex) for kept in gc.get_objects()))
    recorder.close()
    assert max(held) <= 1  # the one being written
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 1500
        late = list(reader.iter_messages(starting_at=1595 * FLUSH_NS))
    assert [message.log_time // FLUSH_NS for _, _, message in late] == [*range(1595, 1600)]


def test_log_that_cannot_be_opened_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").mkdir()
    with pytest.raises(InputError, match=r"run\.mcap"):
        Recorder(tmp_path)


_FULL = """
import resource, sys
from pathlib import Path
from ascrcp.session.recorder import Recorder
r = Recorder(Path(sys.argv[1]))
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
for i in range(20000):
    joints = {"q": [i * 0.12] * 8, "q_ref": [i * 1.1] * 8, "drive": [], "reaction": 0}
    r.put("/joints", i * 20_000_000, joints)
r.close()
print(r.failed, r._queue.qsize())
"""


def test_f38_full_disk_is_told_and_keeps_what_was_written(tmp_path: Path) -> None:
    """A limit on the file's size stands for the full disk: the same error from the same call."""
    done = subprocess.run(
        [sys.executable, "-c", _FULL, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("run log: ") and done.stdout.endswith(" 0\n"), "nothing piles up"
    assert "Traceback" not in done.stderr
    count = 0
    with (tmp_path / "run.mcap").open("rb") as file, contextlib.suppress(McapError, ValueError):
        for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            count += 1
    assert count > 100


_WRITER = """
import sys, time
from pathlib import Path
from ascrcp.session.recorder import Recorder
r = Recorder(Path(sys.argv[1]))
r.put_event(0, "note", "begin", "")
for i in range(100000):
    joints = {"q": [i * 1e-3] * 8, "q_ref": [0.1] * 8, "drive": [0.0] * 8, "reaction": 0}
    r.put("/joints", i * 20_000_000, joints)
    if i % 50 == 49:
        print(i, flush=True)
        time.sleep(0.02)
"""


def test_killed_writer_loses_less_than_half_a_second_of_cycles_and_no_event(tmp_path: Path) -> None:
    """G9 in small: kill -9 the writer, read what is left."""
    with subprocess.Popen(
        [sys.executable, "-c", _WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None
        announced = 0
        while announced < 1500:
            announced = int(writer.stdout.readline())
        time.sleep(0.05)
        os.kill(writer.pid, signal.SIGKILL)
        rest = writer.stdout.read().split()
    announced = int(rest[-1]) if rest else announced
    count = 0
    with (tmp_path / "run.mcap").open("rb") as file:
        try:
            for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                count += 1
        except (McapError, ValueError) as error:  # the cut end of the file
            assert count > 0, error
    journal = Journal(tmp_path / "events.sqlite")
    assert [e.code for e in journal.entries()] == ["begin"]
    journal.close()
    assert announced - count < 150, "a chunk of 16 KiB holds about 100 cycles of this message"


def test_a_disk_that_is_too_slow_loses_records_and_says_so(tmp_path: Path, monkeypatch) -> None:
    """F38: the queue is bounded, the control thread never waits, the loss is told."""
    monkeypatch.setattr("ascrcp.session.recorder.KEPT_MESSAGES", 10)
    slow = threading.Event()
    recorder = Recorder(tmp_path)
    write = recorder._write

    def wait_and_write(message: object) -> None:
        slow.wait(10.0)
        write(message)

    monkeypatch.setattr(recorder, "_write", wait_and_write)
    for k in range(40):
        recorder.put_event(k, "note", str(k))
    assert recorder.lost >= 28
    assert recorder.failed is not None and "too slow" in recorder.failed
    slow.set()
    recorder.close()
