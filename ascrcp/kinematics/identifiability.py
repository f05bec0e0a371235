"""What data leave open: weak directions of a fit, the parameters in them, and the joints that would help."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.observation import Observations
from ascrcp.kinematics.parameter import Parameter

Design = Callable[[Observations, Sequence[Parameter]], Array]
"""Derivative of the tip in sigmas by each parameter in units of its expected error, (n, 3, k)."""

SHARE = 0.3
"""Component of a weak direction from which a parameter is named."""

IDLE = 0.5
"""Share of its range from which a joint counts as exercised; placeholder."""

HOPELESS = 2.0
"""Sigma of a direction, in units of the errors expected, that is refused whatever moved; placeholder."""

ROWS = 60
"""Observations that a what-if is tried on."""

FULL_HOSE_KG = 181.0
"""Payload a survey could have (thesis 6.2.3)."""


@dataclass(frozen=True)
class Determination:
    """Judges whether observations determine parameters.

    Attributes:
        arm: The arm.
        seen: Observations.
        design: Derivative of the tip by the parameters.
        allowed: Largest sigma of a direction, as a share of the errors expected.
    """

    arm: Arm
    seen: Observations
    design: Design
    allowed: float

    def find_weak(
        self,
        parameters: Sequence[Parameter],
        extra: Sequence[Observations] = (),
        allowed: float | None = None,
    ) -> Array:
        """Find the directions of parameter space that stay unsure, shape (m, k).

        By singular values of the design: their inverses are the sigmas of the right singular
        vectors, in units of the expected errors. The sag's exponent may stay unsure and is taken out
        beforehand (Schur complement, its expected error known): over the reaches of a survey another
        exponent looks much like errors of the pitch zeros.

        Args:
            parameters: k parameters.
            extra: Further observations, as a what-if.
            allowed: Largest sigma, in place of the object's own.
        """
        k = len(parameters)
        known = np.array([p.key == "exponent" for p in parameters])
        designs = [self.design(part, parameters).reshape(-1, k) for part in (self.seen, *extra)]
        information = sum((A.T @ A for A in designs), np.diag(known.astype(float)))
        between = information[np.ix_(~known, known)]
        left = information[np.ix_(~known, ~known)]
        left = left - between @ np.linalg.solve(information[np.ix_(known, known)], between.T)
        square, inside = np.linalg.eigh(left)
        directions = np.zeros((len(square), k))
        directions[:, ~known] = inside.T
        return directions[square * (self.allowed if allowed is None else allowed) ** 2 < 1.0]

    def find_idle(self, parameters: Sequence[Parameter]) -> list[str]:
        """Find which idle joints, or payload, would have to move for the data to suffice.

        Each is tried: observations are added in which it alone is sent through its range. The one
        that moved least comes first, and counts if it makes a weak direction strong.
        """
        helped: list[str] = []
        extra: list[Observations] = []
        left = len(self.find_weak(parameters))
        for share, what, rows in sorted(self._what_ifs(), key=lambda entry: entry[0]):
            if share > IDLE or not left:
                break
            now = len(self.find_weak(parameters, [*extra, rows]))
            if now < left:
                helped.append(what)
                extra.append(rows)
                left = now
        return helped

    def _what_ifs(self) -> list[tuple[float, str, Observations]]:
        """Share of its range that each joint and the payload used, in words, and what it could do."""
        seen = self.seen.pick(np.arange(len(self.seen)) % max(1, len(self.seen) // ROWS) == 0)
        g = self.seen.q @ self.arm.limit_matrix.T
        found = []
        for i, joint in enumerate(self.arm.joints):
            unit, name = (1.0, "m") if joint.prismatic else (180.0 / np.pi, "deg")
            low, high = float(g[:, i].min()) * unit, float(g[:, i].max()) * unit
            lower, upper = joint.lower * unit, joint.upper * unit
            what = (
                f"joint {joint.number} {joint.name} moved only {low:.2f}..{high:.2f} of "
                f"{lower:g}..{upper:g} {name}"
            )
            parts = [_send(self.arm, seen, i, end) for end in (joint.lower, joint.upper)]
            found.append(((high - low) / (upper - lower), what, _join(parts)))
        low, high = float(self.seen.payload_kg.min()), float(self.seen.payload_kg.max())
        loads = [
            Observations(seen.q, np.full(len(seen), load), seen.position, seen.line)
            for load in (0.0, FULL_HOSE_KG)
        ]
        what = f"payload_kg was only {low:g}..{high:g} kg"
        return [*found, ((high - low) / FULL_HOSE_KG, what, _join(loads))]


def check_determined(judge: Determination, parameters: Sequence[Parameter]) -> None:
    """Refuse observations that leave a parameter open because something was not exercised.

    What stays unsure though every joint moved is no fault of the survey: its sigma says so.

    Raises:
        InputError: Names the parameters and what was not exercised.
    """
    weak = judge.find_weak(parameters)
    idle = judge.find_idle(parameters) if len(weak) else []
    if not idle:
        weak = judge.find_weak(parameters, allowed=HOPELESS)
        idle = ["the poses are too much alike, or too few"]
    if not len(weak):
        return
    involved = np.abs(weak).max(axis=0)
    names = [parameters[i].name for i in np.argsort(-involved) if involved[i] > SHARE]
    raise InputError(
        f"{judge.seen.source}: the data do not determine {'; '.join(names)}: {'; '.join(idle)} "
        f'(survey such poses, or leave a parameter as it is with --hold "{names[0]}")'
    )


def _send(arm: Arm, seen: Observations, i: int, value: float) -> Observations:
    """Move one limited quantity of every observation to a value."""
    g = seen.q @ arm.limit_matrix.T
    g[:, i] = value
    q = g @ np.linalg.inv(arm.limit_matrix).T
    return Observations(q, seen.payload_kg, seen.position, seen.line)


def _join(parts: Sequence[Observations]) -> Observations:
    return Observations(
        np.concatenate([p.q for p in parts]),
        np.concatenate([p.payload_kg for p in parts]),
        np.concatenate([p.position for p in parts]),
        np.concatenate([p.line for p in parts]),
    )
