"""The inverses' promises at full size: round trips, limits, singularities, a numeric search beside."""

import numpy as np

from ascrcp.cli.bench import Figure, Say
from ascrcp.kinematics.arm import Arm, load_arm
from ascrcp.kinematics.proof import (
    check_round_trip,
    draw_singular,
    draw_within_limits,
    expected_gap,
    least_singular_value,
)
from ascrcp.kinematics.search import compare_with_search

POSES = 100_000
SINGULAR_DRAWS = 40_000
SEARCHED = 500
STARTS = 200
"""Starts of the numeric search per pose: with these it finds every solution itself."""

ISOLATED = 1e-3
"""Singular value above which solutions are isolated enough for a numeric search to tell them apart."""

MISS = 1e-10
GAP = 1e-9


def prove_inverse(machine: str, seed: int, say: Say) -> list[Figure]:
    """Hold the machine's inverse to its promises; every figure has an aim."""
    arm = load_arm(machine)
    rng = np.random.default_rng(seed)
    say(f"proof: {POSES} poses of {arm.name} within limits, as many on their limits, singular ones")
    figures = _round_trips(arm, "within limits", draw_within_limits(arm, POSES, rng), near=False)
    figures += _round_trips(arm, "on limits", draw_within_limits(arm, POSES, rng, at_ends=0.5), near=True)
    figures += _round_trips(arm, "singular", draw_singular(arm, SINGULAR_DRAWS, rng)[0], near=True)
    say(f"proof: {SEARCHED} poses searched from {STARTS} starts each")
    return figures + _search(arm, rng)


def _round_trips(arm: Arm, kind: str, q: np.ndarray, *, near: bool) -> list[Figure]:
    trip = check_round_trip(arm, q, use_near=near)
    apart = np.flatnonzero(trip.gap > GAP)
    # near a singularity rounding of the pose alone parts the joints by more
    lost = int((trip.gap[apart] > expected_gap(arm, q[apart])).sum())
    poses = f"{len(q)} poses {kind}"
    return [
        Figure(
            f"joints lost, {kind}", lost, "", 0.0, note=f"{poses}; {len(apart)} apart by more than {GAP:g}"
        ),
        Figure(f"joints' gap, {kind}", float(np.median(trip.gap)), "rad, m", GAP, note="median"),
        Figure(f"solutions' miss, {kind}", max(trip.miss_m, trip.miss_rad), "m, rad", MISS, note="largest"),
        Figure(f"solutions, {kind}", int(trip.count.max()), "", 8.0, note="most of one pose"),
    ]


def _search(arm: Arm, rng: np.random.Generator) -> list[Figure]:
    q = np.concatenate(
        [
            draw_within_limits(arm, SEARCHED, rng),
            draw_within_limits(arm, SEARCHED // 5, rng, at_ends=0.3),
            draw_singular(arm, SEARCHED, rng)[0],
        ]
    )
    isolated = least_singular_value(arm, q) > ISOLATED
    isolated[: SEARCHED // 10] = False  # leave room for limit and near-singular poses
    q = q[np.flatnonzero(isolated)[-SEARCHED:]]
    found = compare_with_search(arm, q, STARTS, rng)
    return [
        Figure(
            "solutions missing beside a numeric search",
            found.missing,
            "",
            0.0,
            note=f"{found.poses} poses, {found.solutions} solutions, the search found {found.found}",
        )
    ]
