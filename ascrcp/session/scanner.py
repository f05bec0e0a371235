"""Sweep the pan head and collect lidar lines: the scan of thesis 3.1, one line per pan step.

Lines and pan angles carry the instant they were received; the pan angle of a line is interpolated
between the angles measured around it.
"""

import math
from collections import deque
from typing import Protocol

import numpy as np

from ascrcp.core.clock import NS
from ascrcp.core.errors import DeviceError
from ascrcp.core.flow import Scan
from ascrcp.core.machine_io import MachineInputs
from ascrcp.devices.lidar import Lidar, LidarLine, SweepConfig


class _Pan(Protocol):
    def point_pan(self, angle: float | None) -> None: ...


STALE_PAN_NS = 100_000_000  # fault F36: a pan angle older than five cycles is a stuck head
ARRIVED = 5e-4  # pan counts as arrived within this of its target [rad], twice its resolution
ARRIVE_NS = 40 * NS  # half a turn at the sweep speed, with margin: later is a stuck head (fault F36)
MISSED_SHARE = 0.02  # of the lines: more gaps than this are a lidar that loses data (fault F35, F37: 0.3 m)
MISSED_RUN = 3  # lines lost in a row: 0.12 s at 25 lines/s, 0.15 m of wall at 12 m (fault F35)
REST = 4e-3  # arm counts as moving when a joint's mean reading changes by more than this [rad or m] (F35)
REST_CYCLES = 10  # of that mean: with 0.1 deg steps a single reading jumps by 0.3 deg at rest


class Scanner:
    """State of one sweep; `on_cycle` is called after every control cycle until it is done."""

    def __init__(self, lidar: Lidar, config: SweepConfig, pan: _Pan) -> None:
        self._lidar = lidar
        self._config = config
        self._pan = pan
        self._start = np.radians(config.start_deg)
        self._end = np.radians(config.stop_deg)
        self._speed = np.radians(config.step_deg) * config.lines_per_s
        self._line_ns = round(NS / config.lines_per_s)
        self._lines: list[tuple[int, np.ndarray]] = []
        self._pans: list[tuple[int, float]] = []
        self._beam: np.ndarray | None = None
        self._q: tuple[float, ...] = ()
        self._recent: deque[tuple[float, ...]] = deque(maxlen=REST_CYCLES)
        self._rest: np.ndarray | None = None
        self._sweep_from_ns: int | None = None
        self._begun_ns: int | None = None
        self._next_line_ns = 0
        self._missed = 0
        self.done = False

    @property
    def progress(self) -> float:
        """Fraction of the lines received."""
        wanted = (self._end - self._start) / np.radians(self._config.step_deg)
        return min(1.0, len(self._lines) / wanted)

    def on_cycle(self, inputs: MachineInputs) -> None:
        """Take one cycle's view: steer the pan head and poll the lidar when a line is due.

        Raises:
            DeviceError: Stale or stuck pan head, moving arm, a joint sensor without a value, or a lidar that
                stopped answering, calls itself unwell or loses lines.
        """
        now = inputs.t_ns
        for number, q in enumerate(inputs.q[:6], start=1):
            if not math.isfinite(q):
                raise DeviceError(f"joint sensor {number} has no value while scanning")
        self._recent.append(inputs.q[:6])
        if self._begun_ns is None:
            self._begun_ns = now
            self._pan.point_pan(self._start)
        if inputs.pan_age_ns > STALE_PAN_NS and now - self._begun_ns > STALE_PAN_NS:
            raise DeviceError(f"pan head sends no angle for {inputs.pan_age_ns / 1e6:.0f} ms, allowed 100 ms")
        if self._sweep_from_ns is None:
            if abs(inputs.pan - self._start) <= ARRIVED:
                self._sweep_from_ns = self._next_line_ns = now
                self._q = inputs.q
            elif now - self._begun_ns > ARRIVE_NS:
                raise DeviceError(
                    f"pan head did not reach {self._config.start_deg:g} deg in {ARRIVE_NS / NS:g} s"
                )
            return
        self._sweep(now, inputs)

    def _sweep(self, now: int, inputs: MachineInputs) -> None:
        assert self._sweep_from_ns is not None
        self._check_rest()
        target = self._start + self._speed * (now - self._sweep_from_ns) / NS
        self._pan.point_pan(min(target, self._end))
        self._pans.append((now - inputs.pan_age_ns, inputs.pan))
        if now >= self._next_line_ns:
            line = self._lidar.read_line()
            self._judge(line)
            self._beam = line.beam
            self._lines.append((now, line.ranges))
            self._next_line_ns += self._line_ns
        if inputs.pan >= self._end - ARRIVED:
            self._pan.point_pan(None)
            self.done = True
        elif now - self._sweep_from_ns > 2 * ARRIVE_NS:
            raise DeviceError(f"pan head stuck at {np.degrees(inputs.pan):.2f} deg during the sweep")

    def _check_rest(self) -> None:
        """Refuse an arm that moves: mean of the last readings against that when the sweep began."""
        if len(self._recent) < REST_CYCLES:
            return
        mean = np.mean(self._recent, axis=0)
        if self._rest is None:
            self._rest = mean
        if not float(np.max(np.abs(mean - self._rest))) <= REST:
            raise DeviceError("the arm moved while scanning; it must stand still")

    def _judge(self, line: LidarLine) -> None:
        """Refuse a scanner that calls itself unwell or loses lines (fault F35); silently nothing is kept."""
        if line.status != 0:
            raise DeviceError(f"lidar reports status {line.status}, allowed 0")
        if not self._lines:
            return  # the scanner has turned since it was opened
        self._missed += line.missed
        wanted = (self._end - self._start) / np.radians(self._config.step_deg)
        if line.missed > MISSED_RUN or self._missed > MISSED_SHARE * wanted:
            raise DeviceError(
                f"lidar missed {self._missed} of {wanted:.0f} lines, allowed {MISSED_SHARE:.0%} and"
                f" {MISSED_RUN} in a row"
            )

    def scan(self) -> Scan:
        """Return the finished scan, each line with the pan angle measured around its instant."""
        times, pans = np.array([t for t, _ in self._pans]), np.array([p for _, p in self._pans])
        at = np.array([t for t, _ in self._lines])
        assert self._beam is not None
        return Scan(
            ranges=np.stack([ranges for _, ranges in self._lines]).astype(np.float32),
            beam=self._beam,
            pan=np.interp(at, times, pans),
            q=np.array(self._q),
            complete=self.done,
        )
