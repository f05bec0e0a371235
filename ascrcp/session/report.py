"""The round's report: one HTML page with pictures and the error table of the run."""

import base64
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ascrcp.core.file import write_atomic
from ascrcp.core.paths import RESOURCES
from ascrcp.planning.table import read_path
from ascrcp.planning.target import LEFT_TEXT
from ascrcp.session import picture
from ascrcp.session.evaluation import RULE_DEG, RULE_MM
from ascrcp.session.finish_picture import FinishMap, finish_maps
from ascrcp.session.layout_store import read_layout
from ascrcp.session.plan_picture import spray_plan
from ascrcp.session.round import Round
from ascrcp.session.store import read_archive, read_json, read_surface


def build_report(folder: Path, progress: Any = None) -> Path:
    """Build `report.html` and its pictures from what the round folder holds.

    Stages that have not run yet are left out; the page says which.

    Args:
        folder: Round folder.
        progress: Called with the fraction done.

    Returns:
        Path of the page.

    Raises:
        InputError: A file of the round is missing or broken, or the disk refuses.
    """
    tell = progress or (lambda fraction: None)
    round_ = Round(folder)
    surface = read_surface(round_.surface) if round_.surface.exists() else None
    path = read_path(round_.path) if round_.path.exists() else None
    trace = round_.read_trace() if round_.trace.exists() else None
    pictures: dict[str, bytes] = {}
    if surface is not None:
        pictures["wall"] = picture.unrolled_wall(surface, path)
        tell(0.2)
        if path is not None and round_.plan.exists():
            pictures["plan"] = spray_plan(*read_layout(round_.plan, surface))
        tell(0.4)
        pictures["sections"] = picture.sections(surface)
        tell(0.6)
        pictures["cloud"] = picture.cloud_and_path(surface, path, trace)
        tell(0.8)
        maps = _finish_maps(round_)
        if maps:
            pictures["finish"] = finish_maps(surface, maps)
        tell(0.9)
    if trace is not None:
        pictures["error"] = picture.nozzle_error(trace)
    for name, data in pictures.items():
        target = round_.pictures / f"{name}.png"
        write_atomic(target, lambda file, data=data: file.write(data))  # type: ignore[misc]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(RESOURCES), autoescape=True, undefined=jinja2.StrictUndefined
    )
    html = environment.get_template("report.html").render(
        manifest=round_.manifest(),
        prediction=_prediction(round_),
        features=read_json(round_.features) if round_.features.exists() else None,
        result=read_json(round_.result) if round_.result.exists() else None,
        spray_points=len(path) if path is not None else None,
        path_length=_length(path.position) if path is not None else None,
        rule={"mm": RULE_MM, "deg": RULE_DEG},
        pictures={name: base64.b64encode(data).decode() for name, data in pictures.items()},
        joints=_joint_rows(round_),
        finish=_finish_rows(round_),
        rebound=_rebound_rows(round_),
    )
    write_atomic(round_.report, lambda file: file.write(html.encode()))
    tell(1.0)
    return round_.report


def _prediction(round_: Round) -> dict[str, Any] | None:
    """What the plan will come to: as driven if it is solved, else as planned; None without one."""
    if not round_.prediction.exists():
        return None
    tree = read_json(round_.prediction)
    found: dict[str, Any] = tree.get("driven", tree["planned"])
    left = {LEFT_TEXT.get(code, code): area for code, area in found["left_out_m2"].items()}
    return {**found, "again": tree["again"], "left_out_m2": left}


def _finish_maps(round_: Round) -> list[FinishMap]:
    """Collect the predicted map and those of the further scans; none without such a scan."""
    maps: list[FinishMap] = []
    if round_.plan.exists():
        _, a = read_archive(round_.plan, "plan", ("station", "along", "growth", "finish"))
        maps.append(FinishMap("predicted", a["station"], a["along"], a["growth"], a["finish"]))
    scans = round_.rescans()
    for number, scan in enumerate(scans):
        _, a = read_archive(scan.achieved, "achieved", ("station", "along", "layer", "finish"))
        title = f"achieved, sprayed {number + 1} times" if number else "achieved"
        maps.append(FinishMap(title, a["station"], a["along"], a["layer"], a["finish"]))
    return maps if scans else []


def _finish_rows(round_: Round) -> list[dict[str, Any]]:
    """Figures predicted and of every further scan, by the keys of plan.json; none without such a scan."""
    scans = round_.rescans()
    if not scans:
        return []
    rows = []
    predicted = _prediction(round_)
    if predicted is not None:
        rows.append({"name": "predicted 预测", **predicted})
    for number, scan in enumerate(scans, start=1):
        name = f"achieved, sprayed {number} × 实测，喷射 {number} 次" if number > 1 else "achieved 实测"
        rows.append({"name": name, **read_json(scan.finish)})
    return rows


def _rebound_rows(round_: Round) -> list[dict[str, Any]]:
    """Rebound believed at the first plan and learned before each further one; none without the latter."""
    rows = []
    for number, place in enumerate([round_, *round_.rescans()]):
        tree = read_json(place.prediction) if place.prediction.exists() else {}
        if "rebound" in tree:
            name = f"learned from spraying {number} 第 {number} 次喷射后" if number else "believed 设定"
            rows.append({"name": name, **tree["rebound"]})
    return rows if len(rows) > 1 else []


def _length(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _joint_rows(round_: Round) -> list[dict[str, Any]]:
    """Joint errors of thesis table 5-10 in degrees and millimetres."""
    if not round_.result.exists():
        return []
    result = read_json(round_.result)
    rows = []
    for joint, error in zip(result["joints"], result["joint_error"], strict=True):
        scale, unit = (1e3, "mm") if joint["kind"] == "prismatic" else (180 / np.pi, "deg")
        mean, most = (None if error[k] is None else error[k] * scale for k in ("mean", "max"))
        rows.append({**joint, "unit": unit, "mean": mean, "max": most})
    return rows
