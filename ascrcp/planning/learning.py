"""Learn from a spraying how much rebounds: what it was to lay against what a scan found -> ReboundParameters.

The layer is nearly linear in the rebound on walls, overhead and by the angle, so the three are found by
least squares over patches, held near what was believed before, with less weight on patches that no rebound
explains.
"""

import numpy as np

from ascrcp.core.flow import JointSequence, Surface
from ascrcp.core.geometry import Array, apply_transform, inverse_transform
from ascrcp.planning.deposition import Jet
from ascrcp.planning.dose import Dose, find_stretches, renew_stretches
from ascrcp.planning.parameter import change
from ascrcp.planning.process import ProcessParameters, ReboundParameters
from ascrcp.planning.pump import laid_amount
from ascrcp.planning.spray_plan import Layout, walls_before
from ascrcp.planning.target import mean_patch

BELIEF = {"wall": 0.04, "crown": 0.06, "angle": 0.3}  # one sigma of what is learned; placeholder
NOISE_M = 0.015  # one sigma of a patch that rebound does not explain: aim, scan; placeholder
NOISE_SHARE = 0.1  # of the layer, the same: flanks, and concrete that fell, where layers are thick
OUTLIER = 1.5  # sigmas beyond which a patch weighs less
ROUNDS = 8  # of weighting; placeholder
STEP = 0.05  # of a parameter, to see what it does
MOST = 0.9  # of each: so much never rebounds
LEAST_M = 0.005  # patches that were to get less tell nothing
TAKEN_SHARE = 0.3  # patches that took less were hardly sprayed: a run that was stopped, concrete that fell


def learn_rebound(
    layout: Layout, surface: Surface, sequence: JointSequence, after: Array, process: ProcessParameters
) -> ReboundParameters:
    """Find the rebound with which the sequence would have laid what the scan found.

    Args:
        layout: Of the plan that was sprayed; holds the wall before and the rebound believed then.
        surface: Its heading.
        sequence: The rows that were driven, with the pump's flow.
        after: Offset of the wall found [m], NaN where not seen, shape (ns, na).
        process: Jet, pump, patch.

    Returns:
        The rebound as learned; as believed before if the scan shows too little.
    """
    target, lines = layout.target, layout.lines
    process = change(process, rebound=layout.rebound)
    rows = np.flatnonzero(sequence.point >= 0)
    points = sequence.point[rows]
    reached = np.zeros(len(lines.along), dtype=bool)
    reached[points] = True
    T = inverse_transform(surface.axis.T_base_tunnel)
    jet = Jet(lines.nozzle.copy(), lines.jet.direction.copy())
    jet.position[points] = apply_transform(T, sequence.position[rows])
    jet.direction[points] = sequence.direction[rows] @ T[:3, :3].T

    walls = walls_before(lines, target, layout.layers)

    def lay(rebound: ReboundParameters) -> Dose:
        bent = change(process, rebound=rebound)
        stretches = find_stretches(lines, jet, reached, target, walls, bent)
        amount = laid_amount(sequence, stretches.first, stretches.length, len(lines.along), process.spray)
        return Dose(renew_stretches(stretches, amount, lines, jet, target, walls, bent), amount)

    believed = layout.rebound
    seen = np.isfinite(after) & target.inside
    stride = max(1, round(process.target.patch_m / max(target.cell)))

    def patches(layer: Array) -> Array:
        mean = mean_patch(np.where(seen, layer, 0.0), seen, target.cell, process.target.patch_m)
        return mean[::stride, ::stride].ravel()

    expected = patches(lay(believed).layer(target))
    found = patches(np.where(seen, target.offset - after, 0.0))
    by_parameter = []
    for name in BELIEF:
        value = getattr(believed, name)
        step = STEP if value + STEP <= MOST else -STEP
        other = change(believed, **{name: value + step})
        by_parameter.append((patches(lay(other).layer(target)) - expected) / step)
    sigma = np.array(list(BELIEF.values()))
    with np.errstate(invalid="ignore"):
        counts = (expected > LEAST_M) & (found > TAKEN_SHARE * expected)
    A, miss = np.column_stack(by_parameter)[counts] * sigma, (found - expected)[counts]
    change_by = _fit(A, miss, np.hypot(NOISE_M, NOISE_SHARE * expected[counts])) * sigma
    learned = {
        name: float(np.clip(getattr(believed, name) + by, 0.0, MOST))
        for name, by in zip(BELIEF, change_by.tolist(), strict=True)
    }
    return change(believed, **learned)


def _fit(A: Array, miss: Array, noise: Array) -> Array:
    """Solve A x = miss [m], noise (n,) [m], by robust least squares with x of unit variance, shape (3,)."""
    A, miss = A / noise[:, None], miss / noise
    weight: Array = np.ones(len(miss))
    x: Array = np.zeros(A.shape[1])
    for _ in range(ROUNDS):
        normal = (A * weight[:, None]).T @ A + np.eye(A.shape[1])
        x = np.asarray(np.linalg.solve(normal, (A * weight[:, None]).T @ miss))
        weight = 1.0 / np.maximum(1.0, np.abs(miss - A @ x) / OUTLIER)
    return x
