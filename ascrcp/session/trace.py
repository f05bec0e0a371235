"""Collect the run's errors cycle by cycle: CycleOutput -> RunTrace. Cheap enough for the control thread."""

import math
from array import array

import numpy as np

from ascrcp.core.clock import CYCLE_S
from ascrcp.session.cycle import CycleOutput
from ascrcp.session.evaluation import RunTrace


class TraceCollector:
    """Rows in one flat block of doubles, 230 bytes a cycle; nothing is converted when the run has ended.

    Attributes:
        pumped_s: Concrete flow summed, in seconds of the pump's largest.
    """

    def __init__(self, joints: int) -> None:
        self._joints = joints
        self._rows = array("d")
        self._from_truth = True
        self._judged = 0
        self._approached = 0
        self.pumped_s = 0.0

    def add(self, output: CycleOutput) -> None:
        """Add one cycle of a run."""
        flow = output.inputs.pump_flow
        self.pumped_s += (flow if math.isfinite(flow) else output.verdict.command.pump) * CYCLE_S
        if output.tip is None:
            return
        track, tip, truth = output.track, output.tip, output.truth
        if truth is None:
            self._from_truth = False
            truth = tip
        passed = self._passed(track.reached + track.skipped, track.point)
        self._rows.extend(
            (
                output.t_ns * 1e-9,
                *track.position,
                *track.direction,
                *truth[:3, 3].tolist(),
                *truth[:3, 0].tolist(),
                *tip[:3, 3].tolist(),
                *tip[:3, 0].tolist(),
                float(output.verdict.command.pump > 0.0),
                float(passed),
                *track.error_q,
            )
        )

    def begin(self) -> None:
        """A motion begins: the tracker counts its points from zero."""
        self._judged = 0

    def _passed(self, judged: int, approached: int) -> int:
        """Return the planned point that was judged in this cycle, -1 if none."""
        passed = self._approached if judged > self._judged else -1
        self._judged = judged
        if approached >= 0:
            self._approached = approached
        return passed

    def trace(self) -> RunTrace:
        """Return what was collected."""
        table = np.frombuffer(self._rows[:]).reshape(-1, 21 + self._joints)
        table = table[np.isfinite(table[:, :19]).all(1)] if len(table) else table
        return RunTrace(
            t=table[:, 0],
            reference=table[:, 1:7],
            nozzle=table[:, 7:13],
            measured=table[:, 13:19],
            spraying=table[:, 19],
            point=table[:, 20],
            q_error=table[:, 21:],
            from_truth=self._from_truth,
        )
