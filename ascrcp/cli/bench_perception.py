"""Recognition on generated headings with exact truth, and its speed beside Open3D's usual chain."""

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ascrcp.cli.bench import Figure, Say
from ascrcp.cli.bench_survey import measure_survey
from ascrcp.cli.heading_verdict import Verdict, judge
from ascrcp.core.errors import RecognitionError
from ascrcp.core.flow import Cloud
from ascrcp.core.profile import Arc, Profile
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.recognise import recognise
from ascrcp.simulation.axis_floor import direction_floor_deg
from ascrcp.simulation.variety import Sample, Variety, draw_sample, load_variety, tunnel_of

HEADINGS = 40
FIRST_SEED = 900_000
"""Seeds of the proof start here: none of them was drawn while settings were chosen."""

SPEED_POINTS = 3.15
"""Beams cast for three million echoes [millions]."""

MANY_POINTS = 10.5
REPEATS = 5


@dataclass(frozen=True)
class Refusal:
    """A cloud that must be refused: what it is, and the message, None if it was believed."""

    what: str
    message: str | None


def measure_perception(seed: int, say: Say) -> list[Figure]:
    """Prove recognition on generated headings; every figure hangs on the seeds alone."""
    verdicts: list[Verdict] = []
    refused: list[str] = []
    variety = load_variety()
    for number in range(HEADINGS):
        kind = variety.kinds[number % len(variety.kinds)]
        say(f"bench: heading {number + 1} of {HEADINGS}, {kind.name}")
        sample = draw_sample(variety, kind, FIRST_SEED + 1000 * seed + number)
        try:
            surface = recognise(sample.cloud, sample.heading.truth.profile, load_parameters())
        except RecognitionError as error:
            refused.append(f"{kind.name}: {error}")
            continue
        floor = direction_floor_deg(sample.heading.truth, tunnel_of(variety, kind))
        verdict = replace(judge(surface, sample), floor_deg=floor)
        say(f"bench: {_brief(verdict)}")
        verdicts.append(verdict)
    say("bench: clouds that must be refused")
    refusals = try_refusals(variety, FIRST_SEED + 1000 * seed)
    return [
        Figure("headings refused", len(refused), "", 0.0, note="; ".join(refused) or f"of {HEADINGS}"),
        *_arches(verdicts),
        *_pockets(verdicts),
        *_axes(verdicts),
        Figure(
            "bad clouds believed",
            sum(r.message is None for r in refusals),
            "",
            0.0,
            note="; ".join(f"{r.what}: {'BELIEVED' if r.message is None else 'refused'}" for r in refusals),
        ),
        *measure_survey(FIRST_SEED + 1000 * seed, say),
    ]


def _brief(v: Verdict) -> str:
    return (
        f"axis {v.axis_deg:.3f} deg {v.axis_mm:.1f} mm, arches {len(v.station_mm)} found "
        f"{len(v.missed_arches)} missed {len(v.false_arches)} false, pockets {len(v.pockets)} "
        f"{len(v.missed_pockets)} missed {len(v.false_regions)} false, "
        f"volume {v.volume:.3f} of {v.volume_true:.3f} m3"
    )


def _arches(verdicts: list[Verdict]) -> list[Figure]:
    found = sum(len(v.station_mm) for v in verdicts)
    missed = sum(len(v.missed_arches) for v in verdicts)
    false = sum(len(v.false_arches) for v in verdicts)
    precision, recall = 100 * found / max(1, found + false), 100 * found / max(1, found + missed)
    both = 2 * precision * recall / max(1e-9, precision + recall)
    station = [abs(e) for v in verdicts for e in v.station_mm]
    crown = [abs(e) for v in verdicts for e in v.crown_mm]
    lean = [abs(e) for v in verdicts for e in v.lean_deg]
    note = f"{found} found, {missed} missed, {false} false; synthetic headings"
    return [
        Figure("arches, precision", precision, "%", 99.0, more_is_better=True, note=note),
        Figure("arches, recall", recall, "%", 99.0, more_is_better=True),
        Figure("arches, F", both, "%", 99.0, more_is_better=True, note="paper, real scans: 90.6 %"),
        Figure("arches, station", max(station), "mm", 20.0, note=f"largest; median {median(station):.2g}"),
        Figure("arches, station at the crown", max(crown), "mm", note=f"largest; median {median(crown):.2g}"),
        Figure("arches, lean", max(lean), "deg", 0.5, note=f"largest; median {median(lean):.2g}"),
    ]


def _pockets(verdicts: list[Verdict]) -> list[Figure]:
    seen = sum(len(v.pockets) for v in verdicts)
    volume, true = sum(v.volume for v in verdicts), sum(v.volume_true for v in verdicts)
    each = [abs(v.volume / v.volume_true - 1.0) for v in verdicts if v.volume_true > 0.0]
    shadow, dark = sum(v.shadow for v in verdicts), sum(v.shadow_true for v in verdicts)
    pocket = [abs(p.found / p.volume - 1.0) for v in verdicts for p in v.pockets]
    return [
        Figure(
            "pockets missed",
            sum(len(v.missed_pockets) for v in verdicts),
            "",
            0.0,
            note=f"of {seen} with 0.2 m2 in sight and 0.10 m depth",
        ),
        Figure("pockets found in pieces", sum(v.split for v in verdicts), "", 0.0),
        Figure("false regions of that size", sum(len(v.false_regions) for v in verdicts), "", 0.0),
        Figure(
            "overbreak volume in sight, total",
            100 * abs(volume / true - 1.0),
            "%",
            3.0,
            note=f"{volume:.2f} m3 found, {true:.2f} m3 true",
        ),
        Figure(
            "overbreak volume, worst heading",
            100 * max(each),
            "%",
            8.0,
            note=f"{sum(e <= 0.08 for e in each)} of {len(each)} within, median {100 * median(each):.2g} %",
        ),
        Figure(
            "overbreak volume, a pocket",
            100 * median(pocket),
            "%",
            note=f"median; {sum(e <= 0.08 for e in pocket)} of {len(pocket)} within 8 %",
        ),
        Figure(
            "overbreak volume out of sight, estimate",
            100 * abs(shadow / dark - 1.0),
            "%",
            note=f"{shadow:.2f} m3 estimated, {dark:.2f} m3 true",
        ),
    ]


def _axes(verdicts: list[Verdict]) -> list[Figure]:
    figures = []
    for bare, name, degrees in ((False, "axis", 0.1), (True, "axis, only bare rock seen", 0.3)):
        mine = [v for v in verdicts if v.bare == bare]
        angle, aside = [v.axis_deg for v in mine], [v.axis_mm for v in mine]
        note = f"largest of {len(mine)}"
        if bare and mine:
            note += "; no method can do better than one sigma of " + ", ".join(
                f"{v.floor_deg:.2f} (here {v.axis_deg:.2f}, told {v.sigma_deg:.2f})" for v in mine
            )
        figures.append(Figure(f"{name}, direction", max(angle, default=None), "deg", degrees, note=note))
        note = f"largest of {len(mine)}"
        figures.append(
            Figure(f"{name}, position", max(aside, default=None), "mm", None if bare else 10.0, note=note)
        )
    told = [v.axis_deg / v.sigma_deg for v in verdicts]
    note = f"largest; median {median(told):.2g}"
    return [*figures, Figure("axis, error over the sigma told", max(told), "x", 3.0, note=note)]


def try_refusals(variety: Variety, seed: int) -> list[Refusal]:
    """Show recognition what it must refuse: no heading, too few points, another tunnel's profile."""
    sample = draw_sample(variety, variety.kinds[0], seed, (0.4, 0.4))
    points, profile = sample.cloud.points, sample.heading.truth.profile
    trials = [
        ("no heading in view", _inside(sample), profile),
        ("only one side wall", points[_local(sample)[:, 1] > 4.0], profile),
        ("too sparse", points[:: max(1, len(points) // 2500)], profile),
    ]
    trials += [(f"profile {by:+.1f} m", points, scaled(profile, by)) for by in (-0.5, 0.5, 1.2)]
    return [Refusal(what, _message(cloud, profile)) for what, cloud, profile in trials]


def scaled(profile: Profile, by: float) -> Profile:
    """Return a circular profile with another radius."""
    arcs = [
        Arc(centre=arc.centre, radius=arc.radius + by, start_deg=arc.start_deg, end_deg=arc.end_deg)
        for arc in profile.arcs
    ]
    return Profile(
        name=f"{profile.name} {by:+.1f}",
        arcs=arcs,
        arch_line=profile.arch_line,
        overbreak_line=profile.overbreak_line,
        arch_width=profile.arch_width,
        spray_depth=profile.spray_depth,
    )


def _message(points: NDArray[np.float32], profile: Profile) -> str | None:
    try:
        recognise(Cloud(points), profile, load_parameters())
    except RecognitionError as error:
        return str(error)
    return None


def _local(sample: Sample) -> NDArray[Any]:
    axis = sample.heading.truth.axis
    return np.asarray((sample.cloud.points - axis.point) @ axis.T_base_tunnel[:3, :3])


def _inside(sample: Sample) -> NDArray[np.float32]:
    """What stands in the tunnel, without its wall."""
    _, offset = sample.heading.truth.profile.locate(_local(sample)[:, 1:])
    return sample.cloud.points[offset < -1.0]


def measure_speed(seed: int, say: Say) -> list[Figure]:
    """Time the whole chain beside Open3D's first four steps, each cloud in a fresh process."""
    variety = load_variety()
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for millions in (SPEED_POINTS, MANY_POINTS):
            say(f"bench: scanning {millions:g} million beams")
            sample = draw_sample(variety, variety.kinds[0], FIRST_SEED + seed, (millions, millions))
            path = Path(folder) / "cloud.npy"
            np.save(path, sample.cloud.points)
            profile = sample.heading.truth.profile
            del sample
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                results.append(pool.apply(_time_chain, (path, profile, millions == SPEED_POINTS)))
    (n, ours, peak, kept, theirs), (many, longer, *_) = results
    note = f"{n / 1e6:.2f} M points to features, {kept} kept; least of {REPEATS}"
    return [
        Figure("recognise", ours, "s", 1.0, note=note),
        Figure("Open3D: crop, voxel, clusters, normals", theirs or None, "s", note="same cloud and process"),
        Figure("Open3D over recognise", theirs / ours if theirs else None, "x", 3.0, more_is_better=True),
        Figure(f"recognise {many / 1e6:.1f} M points over {n / 1e6:.1f} M", longer / ours, "x", 3.5),
        Figure("peak memory of the process", peak, "GB", 1.2, note="with the cloud, before Open3D is loaded"),
    ]


def _time_chain(path: Path, profile: Profile, beside: bool) -> tuple[int, float, float, int, float]:
    """Points, seconds of the chain, peak memory [GB], points kept, seconds of the peer (0: not measured)."""
    points = np.load(path)
    parameters = load_parameters()
    kept = len(recognise(Cloud(points), profile, parameters).points)
    ours = _least(lambda: recognise(Cloud(points), profile, parameters))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    theirs = 0.0
    if beside:
        chain = open3d_chain(points, kept, parameters.voxel.size)
        theirs = _least(chain)
        ours = min(ours, _least(lambda: recognise(Cloud(points), profile, parameters)))
    return len(points), ours, peak, kept, theirs


def _least(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def open3d_chain(points: NDArray[np.float32], wanted: int, size: float) -> Callable[[], object]:
    """Prepare Open3D's crop, voxel filter, DBSCAN and normals; voxels keep as many points as ours."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(float)))
    box = o3d.geometry.AxisAlignedBoundingBox(np.array([-15.0, -10.0, -10.0]), np.array([40.0, 10.0, 10.0]))
    while len(cloud.voxel_down_sample(size).points) > wanted:
        size *= 1.1

    def chain() -> object:
        thin = cloud.crop(box).voxel_down_sample(size)
        label = np.asarray(thin.cluster_dbscan(eps=2.5 * size, min_points=4))
        tunnel = thin.select_by_index(
            np.flatnonzero(label == np.bincount(label[label >= 0]).argmax()).tolist()
        )
        tunnel.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(20))
        return tunnel

    return chain
