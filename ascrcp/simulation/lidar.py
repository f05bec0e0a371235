"""The simulated lidar seen from the rig: starts its process, tells it pose and spray, knows its port."""

import contextlib
import multiprocessing
import threading
from typing import Any

import numpy as np

from ascrcp.core.errors import DeviceError, InputError
from ascrcp.core.geometry import Array
from ascrcp.simulation.growth import SprayTruth
from ascrcp.simulation.heading import Heading
from ascrcp.simulation.lidar_model import LidarConfig
from ascrcp.simulation.lidar_pose import PoseBoard
from ascrcp.simulation.lidar_process import FAULTS, HOST, serve

START_LIMIT_S = 60.0  # loading Open3D takes 2 s; a loaded machine may need much longer
STOP_LIMIT_S = 2.0
ANSWER_LIMIT_S = 30.0  # batches still to be laid come first; placeholder


class LidarServer:
    """A scanner on loopback that speaks the same telegrams as the real one.

    Deterministic: same configuration, heading and seed, and the same sequence of poses and polls,
    give the same bytes.

    Args:
        config: The scanner.
        heading: What it looks at.
        seed: Seed of its noise, 0 or above.
        spray: How the wall it sees takes up concrete; None: not at all.

    Raises:
        InputError: A negative seed.
    """

    host = HOST

    def __init__(
        self, config: LidarConfig, heading: Heading, seed: int, spray: SprayTruth | None = None
    ) -> None:
        if not seed >= 0:
            raise InputError(f"seed {seed}, allowed 0 or above")
        context = multiprocessing.get_context("spawn")
        self._poses = PoseBoard(context)
        self._pipe, theirs = context.Pipe()
        self._port: int | None = None
        self._lock = threading.Lock()  # the rig sprays while another thread plants faults or asks
        self._asking = threading.Lock()  # of its own: the rig must not wait for an answer
        self._process = context.Process(
            target=serve, args=(config, int(seed), self._poses, theirs), name="lidar", daemon=True
        )
        self._process.start()
        theirs.close()
        # not among the arguments: starting a process that dies at once would wait for ever to hand them over
        with contextlib.suppress(OSError):  # `port` says that it has ended
            self._pipe.send((heading, spray))

    @property
    def port(self) -> int:
        """TCP port on loopback; the first call waits until the process is ready.

        Raises:
            DeviceError: The process could not start.
        """
        if self._port is None:
            try:
                ready = self._pipe.poll(START_LIMIT_S)
                answer = self._pipe.recv() if ready else f"not ready after {START_LIMIT_S:g} s"
            except (EOFError, OSError):
                answer = "its process ended before it was ready"
            if not isinstance(answer, int):
                self.close()
                raise DeviceError(f"simulated lidar: {answer}")
            self._port = answer
        return self._port

    def set_pose(self, T_base_mount: Array, pan: float) -> None:
        """Move the lidar: mount in the base frame, shape (4, 4), true pan head angle [rad].

        Raises:
            DeviceError: A pose that is not finite.
        """
        if not (np.isfinite(T_base_mount).all() and abs(pan) < np.inf):
            raise DeviceError("simulated lidar: pose and pan must be finite")
        self._poses.write(T_base_mount, pan)

    def inject(self, fault: str, telegrams: int = 1) -> None:
        """Spoil the next telegrams (fault F35).

        Args:
            fault: "silent", "corrupt", "truncate", "freeze" (scan counter) or "status".
            telegrams: How many.
        """
        if fault not in FAULTS:
            raise DeviceError(f"simulated lidar: unknown fault {fault!r}, allowed {', '.join(FAULTS)}")
        with self._lock:
            self._pipe.send(("fault", (fault, int(telegrams))))

    def lay(self, batch: Array) -> None:
        """Let the wall grow by a full batch of a `NozzleRecord`; a process that has died sees no wall."""
        with self._lock, contextlib.suppress(OSError):
            self._pipe.send(("lay", batch))

    def concrete(self) -> dict[str, Any]:
        """Return what became of the concrete laid so far [m3], the rig's truth.

        Raises:
            DeviceError: The process does not answer.
        """
        _ = self.port  # the first thing it says
        with self._asking:
            try:
                with self._lock:
                    self._pipe.send(("concrete", None))
                if not self._pipe.poll(ANSWER_LIMIT_S):
                    raise TimeoutError(f"no answer in {ANSWER_LIMIT_S:g} s")
                found: dict[str, Any] = self._pipe.recv()
            except (EOFError, OSError) as error:  # a timeout is one of these
                raise DeviceError("simulated lidar: its process does not answer") from error
        return found

    def close(self) -> None:
        """Stop the process; closing twice is allowed."""
        self._pipe.close()
        self._process.join(STOP_LIMIT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
