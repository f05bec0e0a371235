"""What the screen may ask of the job: the session as the view sees it, nothing more."""

from typing import Literal, Protocol

from ascrcp.devices.joystick import StickState
from ascrcp.kinematics import Arm
from ascrcp.session.snapshot import Scene, Snapshot
from ascrcp.session.state import Mode, Refusal, Step
from ascrcp.simulation.rig import FaultKind


class Site(Protocol):
    """The rig's faults (design.md section 7); not there on a machine."""

    def plant_fault(self, kind: FaultKind, frame: str, value: float) -> None:
        """Plant a fault in a frame."""

    def clear_faults(self) -> None:
        """Take all planted faults away and release the emergency stop."""

    def press_estop(self) -> None:
        """Press the hard-wired emergency stop."""

    def release_estop(self) -> None:
        """Release it."""


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

    @property
    def site(self) -> Site | None:
        """The simulated rig's faults, None on a machine."""

    def jog_refusal(self) -> Refusal | None:
        """Return why the arm may not be jogged now, None if it may."""

    def start_jog(self, kind: Literal["nozzle", "joint"], joint: int = 0) -> None:
        """Give the arm to the stick for set-up; raises core.errors.RefusedError if it may not have it."""

    def finish_steering(self) -> None:
        """End what the stick does."""

    def leave_area(self) -> None:
        """Let the next start in semi-automatic mode lie in another area of the plan."""

    def put_stick(self, state: StickState) -> None:
        """Set the stick on the screen."""
