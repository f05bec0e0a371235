"""What the screen may ask of the job: the session as the view sees it, nothing more."""

from typing import Protocol

from ascrcp.kinematics import Arm
from ascrcp.session.snapshot import Scene, Snapshot
from ascrcp.session.state import Mode, Refusal, Step


class Session(Protocol):
    """The job. Every call returns at once; work goes on in the session's own threads."""

    @property
    def arm(self) -> Arm:
        """The arm's kinematics."""

    def snapshot(self) -> Snapshot:
        """Return the newest picture of the job."""

    def scene(self) -> Scene:
        """Return what the 3-D view draws besides the arm."""

    def refusal(self, step: Step) -> Refusal | None:
        """Return why a step may not start now, None if it may."""

    def start(self, step: Step) -> None:
        """Begin a step; raises core.errors.RefusedError if it may not start now."""

    def stop(self) -> None:
        """Stop everything from any state; latched until reset."""

    def reset(self) -> None:
        """Ask the gate to leave the stopped state."""

    def cancel(self) -> None:
        """Give up the step under way."""

    def choose_mode(self, mode: Mode) -> None:
        """Change the mode at rest."""

    def close(self) -> None:
        """End every thread; the machine is neutral afterwards."""
