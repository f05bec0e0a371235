"""Keep a planned layout in the round folder as plan.npz, and read it back for solving and the report."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ascrcp.core.errors import InputError
from ascrcp.core.flow import SprayPath, Surface
from ascrcp.core.geometry import Array
from ascrcp.planning.coverage import Lines
from ascrcp.planning.learning import learn_rebound
from ascrcp.planning.parameter import change
from ascrcp.planning.process import ProcessParameters, ReboundParameters
from ascrcp.planning.spray_plan import Layout, SprayPlan
from ascrcp.planning.table import read_joints
from ascrcp.planning.target import Target, find_lids
from ascrcp.session.round import Round
from ascrcp.session.store import read_archive, write_archive

_LINES = ("nozzle", "wall", "line_along", "theta2", "theta3", "bay", "pass_index", "layer", "overbreak")
_TARGET = ("station", "along", "rock", "offset", "wanted", "arch", "left", "area", "guessed")
_GRIDS = ("layers", "exposed", "leave", "growth", "finish")


def write_layout(file: Path, plan: SprayPlan, finish: Array) -> None:
    """Keep a plan's layout and what it is predicted to come to.

    Args:
        file: plan.npz.
        plan: The plan.
        finish: Predicted distance of each patch from the wanted surface [m], NaN where not judged.
    """
    lines, target = plan.lines, plan.target
    arrays: dict[str, Any] = {name: getattr(lines, name.removeprefix("line_")) for name in _LINES}
    arrays |= {name: getattr(target, name) for name in _TARGET}
    arrays |= {name: getattr(plan.layout, name) for name in ("layers", "exposed", "leave")}
    arrays |= {"growth": plan.growth, "finish": finish}
    meta = {"rebound": msgspec.to_builtins(plan.layout.rebound)}
    write_archive(file, "plan", meta, arrays)


def read_layout(file: Path, surface: Surface) -> tuple[Layout, Array, Array]:
    """Read a layout back, with the predicted layer and finish [m], shape (ns, na).

    Args:
        file: plan.npz.
        surface: The heading it was planned on.

    Raises:
        InputError: Missing, cut, flipped, of another kind, or of another heading.
    """
    meta, a = read_archive(file, "plan", (*_LINES, *_TARGET, *_GRIDS))
    lines = Lines(**{name.removeprefix("line_"): a[name] for name in _LINES})
    if len(a["along"]) != a["offset"].shape[1] or not np.isfinite(a["offset"]).all():
        raise InputError(f"{file}: its grid does not fit together")
    target = Target(
        profile=surface.profile, arches=find_lids(surface, a["along"]), **{name: a[name] for name in _TARGET}
    )
    try:
        rebound = msgspec.convert(meta.get("rebound"), ReboundParameters)
    except msgspec.ValidationError as error:
        raise InputError(f"{file}: rebound: {error}; run `ascrcp plan` on this round again") from error
    layout = Layout(lines, target, a["layers"], a["exposed"], rebound, a["leave"])
    return layout, a["growth"], a["finish"]


def learn(sprayed: Round, surface: Surface, after: Array, process: ProcessParameters) -> ProcessParameters:
    """Put what a spraying shows of the rebound into the process; as it is if nothing tells what was sprayed.

    Args:
        sprayed: Folder with the plan and the joints that were driven.
        surface: The heading before any spraying.
        after: Offset of the wall found afterwards [m], NaN where not seen, shape (ns, na).
        process: As configured.

    Raises:
        InputError: A damaged file.
    """
    if not (sprayed.plan.exists() and sprayed.joints.exists()):
        return process
    layout, _, _ = read_layout(sprayed.plan, surface)
    sequence = read_joints(sprayed.joints)
    fits = layout.target.offset.shape == after.shape and sequence.point.max() < len(layout.lines.along)
    if not fits:
        return process
    return change(process, rebound=learn_rebound(layout, surface, sequence, after, process))


def find_expected(sprayed: Round, surface: Surface) -> Array | None:
    """Offset from the design line that what was sprayed was to leave [m], shape (ns, na).

    Args:
        sprayed: Folder with the plan and the joints that were driven.
        surface: The heading before any spraying.

    Returns:
        None if nothing tells what was sprayed.

    Raises:
        InputError: A damaged file.
    """
    if not (sprayed.plan.exists() and sprayed.joints.exists()):
        return None
    layout, growth, _ = read_layout(sprayed.plan, surface)
    return np.asarray(layout.target.offset - growth)


def layout_of(round_: Round, path: SprayPath, surface: Surface) -> Layout | None:
    """Return the layout a path was planned with, None if it has none: the thesis's has not.

    Raises:
        InputError: A damaged or missing file, or the layout of another path.
    """
    if not round_.prediction.exists() and not round_.plan.exists():
        return None
    round_.need("plan", "plan")
    layout, _, _ = read_layout(round_.plan, surface)
    if len(layout.lines.along) != len(path) or not np.array_equal(layout.lines.bay, path.bay):
        raise InputError(f"{round_.plan}: belongs to another path; run `ascrcp plan` on this round again")
    return layout
