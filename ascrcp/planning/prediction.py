"""What a plan will come to, finish, volume, time, rebound, what is left out: SprayPlan -> Prediction."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import Array
from ascrcp.planning.finish import Finish, judge_finish
from ascrcp.planning.process import ProcessParameters
from ascrcp.planning.pump import laid_amount
from ascrcp.planning.spray_plan import SprayPlan
from ascrcp.planning.target import Left, mean_patch


@dataclass(frozen=True)
class Prediction:
    """Predicted outcome; lengths in metres.

    Attributes:
        growth: Layer, shape (ns, na).
        finish: How near it comes to the wanted surface.
        wanted: Concrete wanted on the judged area [m3].
        laid: Concrete that sticks, wherever [m3].
        pumped: Concrete pumped [m3].
        layer: Thickest layer laid by one run of passes over a patch.
        duration: Of the spraying [s]; with its moves if the sequence is known.
        with_moves: Whether they are counted.
        left: Area left out by the code of its reason [m2].
    """

    growth: Array
    finish: Finish
    wanted: float
    laid: float
    pumped: float
    layer: float
    duration: float
    with_moves: bool
    left: dict[str, float]

    @property
    def rebound(self) -> float:
        """Share of the pumped concrete that does not stick."""
        return 1.0 - self.laid / self.pumped if self.pumped > 0.0 else 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for plan.json; millimetres where the key says so."""
        return {
            **self.finish.to_dict(),
            "wanted_m3": self.wanted,
            "laid_m3": self.laid,
            "pumped_m3": self.pumped,
            "rebound": self.rebound,
            "thickest_layer_mm": 1e3 * self.layer,
            "duration_s": self.duration,
            "with_moves": self.with_moves,
            "left_out_m2": self.left,
        }


def predict(plan: SprayPlan, process: ProcessParameters, sequence: JointSequence | None = None) -> Prediction:
    """Predict the finish of a plan, by its own doses or by those its timed rows pump.

    Args:
        plan: The plan.
        process: Patch, tolerance, corner, pump.
        sequence: Its path, timed, with the pump's flow; None before it is solved.
    """
    target, stretches = plan.target, plan.dose.stretches
    amount = plan.dose.amount
    speed = plan.path.speed[stretches.first]
    duration = float((stretches.length / np.maximum(speed, 1e-6)).sum())
    if sequence is not None:
        amount = laid_amount(sequence, stretches.first, stretches.length, len(plan.path), process.spray)
        duration = sequence.duration
    growth = plan.grown(amount)
    finish = judge_finish(target.offset - growth, target, plan.exposed, process.target)
    judged = np.isfinite(finish.value)
    return Prediction(
        growth=growth,
        finish=finish,
        wanted=float(target.volume(target.thickness)[judged].sum()),
        laid=float(target.volume(growth).sum()),
        pumped=float(amount @ stretches.length),
        layer=_thickest_layer(plan, amount, process),
        duration=duration,
        with_moves=sequence is not None,
        left={
            reason.code: float(target.area[target.left == reason].sum())
            for reason in Left
            if reason not in (Left.NOT, Left.OUTSIDE) and (target.left == reason).any()
        },
    )


def _thickest_layer(plan: SprayPlan, amount: Array, process: ProcessParameters) -> float:
    layer_of = plan.lines.layer[plan.dose.stretches.first]
    thickest = 0.0
    for layer in np.unique(layer_of).tolist():
        one = mean_patch(
            plan.grown(np.where(layer_of == layer, amount, 0.0)),
            plan.exposed,
            plan.target.cell,
            process.target.patch_m,
        )
        thickest = max(thickest, float(np.nanmax(one, initial=0.0)))
    return thickest
