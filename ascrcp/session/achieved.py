"""What a spraying has come to, by a further scan: Cloud, Surface of the first scan -> Achieved.

The machine stands where it stood, but its sensors do not tell the same pose twice to the millimetre: the
scans are registered on what nobody sprayed. The layer is measured on the plan's grid, and the finish over
the same patches as the prediction, so that the two stand beside each other.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Label, Surface
from ascrcp.core.geometry import Array, apply_transform
from ascrcp.perception.registration import Registration, register
from ascrcp.perception.survey import SurveyParameters
from ascrcp.perception.thickness import measure_thickness, stable_points
from ascrcp.planning.finish import judge_finish
from ascrcp.planning.parameter import Parameters as PlanningParameters
from ascrcp.planning.rescan import find_after
from ascrcp.planning.spray_plan import Layout
from ascrcp.planning.target import Target, find_target
from ascrcp.planning.wall import fit_wall

SAME_M = 0.35  # a point so near one of the first scan is of the same kind: thicker is no layer; placeholder
DEEPER_M = 0.05  # beyond noise, registration and what falls off bare rock; placeholder
DEEPER_SHARE = 0.05  # of the wall that may lie so much deeper than in the first scan; placeholder
EVERY = 4  # of the first scan's points are asked for their kind


@dataclass(frozen=True)
class Achieved:
    """What a spraying has come to.

    Attributes:
        target: Grid, the wall before any spraying, the wanted surface.
        after: Offset of the wall found [m], NaN where not seen, shape (ns, na).
        layer: How much the wall came nearer [m], NaN where not seen, shape (ns, na).
        finish: Mean distance of each patch from the wanted surface [m], outward (too thin) positive, NaN
            where not judged, shape (ns, na).
        surface: The heading as it is now, in the frame and with the findings of the first scan.
        figures: For files and screens; millimetres where the key says so.
    """

    target: Target
    after: Array
    layer: Array
    finish: Array
    surface: Surface
    figures: dict[str, Any]


def measure_achieved(
    points: NDArray[np.float32],
    first: Surface,
    layout: Layout | None,
    config: PlanningParameters,
    survey: SurveyParameters,
    expected: Array | None = None,
    behind: NDArray[np.float32] | None = None,
) -> Achieved:
    """Lay a further scan over the first and measure what has been laid.

    Args:
        points: The further scan, base frame [m], shape (n, 3).
        first: The heading as recognised before any spraying.
        layout: Of the plan that was sprayed first: tells what it could cover; None without one.
        config: Grid, wanted surface, patch.
        survey: Registration, thickness.
        expected: Offset that was to be left by what was sprayed [m], on the plan's grid; None if not known.
        behind: More points of the same wall, from a pose that sees behind arches, base frame [m], (k, 3);
            the arm itself may be among them, so that they tell of the wall alone.

    Raises:
        RecognitionError: The scans do not show the same wall.
    """
    labels = carry_labels(points, first)
    second = replace(first, points=points, labels=labels)
    found = register(stable_points(first), stable_points(second), survey.registration)
    if not found.converged:
        raise RecognitionError("registration: the two scans did not settle on one another")
    moved = apply_transform(found.T_first_second, points.astype(float)).astype(np.float32)
    target = layout.target if layout is not None else find_grid(first, config)
    shown = moved
    if behind is not None:
        more = apply_transform(found.T_first_second, behind.astype(float)).astype(np.float32)
        shown = np.concatenate([moved, more])
    after = find_reached(shown, first, target, survey, expected)
    seen = np.isfinite(after)
    beyond = target.station > first.unsprayed[1]  # of the face nobody knows how far it was
    layer = np.where(beyond[:, None], np.nan, target.offset - after)
    on_wall = target.station < first.unsprayed[1] - config.process.target.corner_m  # not the face
    # judged is what the prediction judges: what the plan said it can cover, away from the ends
    covered = target.inside if layout is None else layout.exposed
    finish = judge_finish(after, target, covered, config.process.target)
    noise = measure_thickness(first.points, moved, first, survey.thickness)
    figures = {
        **finish.to_dict(),
        "tolerance_mm": 1e3 * config.process.target.tolerance_m,
        "laid_m3": float(target.volume(np.nan_to_num(layer))[target.inside & on_wall[:, None]].sum()),
        "unseen_m2": float(target.area[target.inside & ~seen].sum()),
        "registration": _describe(found),
        "noise_mm": 1e3 * noise.noise_floor,
        "noise_m2_mm": 1e3 * noise.noise_floor_m2,
        "bias_mm": 1e3 * noise.bias,
    }
    surface = _renew(first, moved, labels, target, layer)
    return Achieved(target, after, layer, finish.value, surface, figures)


def find_reached(
    points: NDArray[np.float32],
    first: Surface,
    target: Target,
    survey: SurveyParameters,
    expected: Array | None,
) -> Array:
    """Find the wall a further scan shows (`find_after`), if it is that of the first one.

    Raises:
        RecognitionError: It shows too little of the wall or of the arches, or lies deeper than the first one
            showed it: a wall that is sprayed comes nearer.
    """
    if expected is not None and expected.shape != target.offset.shape:
        expected = None
    after = find_after(points, first, target, expected)
    share = np.isfinite(after).sum() / max(1, np.isfinite(target.offset).sum())
    needed = survey.registration.min_share
    if not share >= needed:
        raise RecognitionError(
            f"the scan shows {100 * share:.0f} % of the wall of the first one, needed {100 * needed:.0f} %"
        )
    seen, arch = np.isfinite(after) & target.inside, target.arch & target.inside
    if arch.any() and not (share := float(seen[arch].mean())) >= needed:
        raise RecognitionError(
            f"the scan shows {100 * share:.0f} % of the arches of the first one, needed {100 * needed:.0f} %"
        )
    known = seen & ~target.arch & (target.guessed == 0.0)
    deeper = float((after - target.offset > DEEPER_M)[known].mean()) if known.any() else 0.0
    if not deeper <= DEEPER_SHARE:
        raise RecognitionError(
            f"{100 * deeper:.0f} % of the wall lies more than {1e3 * DEEPER_M:.0f} mm deeper than before, "
            f"allowed {100 * DEEPER_SHARE:.0f} %: a wall that is sprayed comes nearer"
        )
    return after


def carry_labels(points: NDArray[np.float32], first: Surface) -> NDArray[np.uint8]:
    """Tell what each point is from its nearest neighbour in the first scan; what is new is OTHER, (n,)."""
    tree = cKDTree(first.points[::EVERY])
    far, owner = tree.query(points, distance_upper_bound=SAME_M)
    labels = np.full(len(points), Label.OTHER, dtype=np.uint8)
    near = np.isfinite(far)
    labels[near] = first.labels[::EVERY][owner[near]]
    return labels


def find_grid(first: Surface, config: PlanningParameters) -> Target:
    """Find present and wanted surface as the plan does."""
    wall = fit_wall(first, config.path)
    return find_target(first, wall, config.process, config.path.bridge_m)


def _describe(found: Registration) -> dict[str, Any]:
    return {"residual_mm": 1e3 * found.residual, "share": found.share, "converged": found.converged}


def _renew(
    first: Surface, points: NDArray[np.float32], labels: NDArray[np.uint8], target: Target, layer: Array
) -> Surface:
    """Put the layer on the wall, which the arm may hit next; where it was not seen, its neighbour's."""
    known = np.isfinite(layer)
    laid = np.zeros(layer.shape)
    if known.any():
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        laid = np.maximum(layer[tuple(nearest)], 0.0)
    station, along = (x.ravel() for x in np.meshgrid(first.station, first.along, indexing="ij"))
    on = (station >= first.unsprayed[0]) & (station <= first.unsprayed[1])
    by = np.where(on, target.sample(laid, station, along), 0.0).reshape(first.offset.shape)
    offset = (first.offset - by).astype(np.float32)
    return replace(first, offset=offset, points=points, labels=labels)
