import dataclasses

import numpy as np
from planning_heading import heading

from ascrcp.core.flow import SprayPath
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.path import solve_path
from ascrcp.planning.dryrun import check_sequence
from ascrcp.planning.mend import time_and_mend
from ascrcp.planning.parameter import change, load_parameters
from ascrcp.planning.path import plan
from ascrcp.planning.timing import time_path

ARM = load_arm("kc")
PARAMETERS = load_parameters()
SURFACE = heading(unsprayed=(10.2, 11.4), arches=(), floor_z=-1.9)
AROUND = Obstacles.from_surface(SURFACE, ARM)


def some(path: SprayPath, rows: np.ndarray) -> SprayPath:
    names = [name for name in SprayPath.SHAPES if name != "R_base_tunnel"]
    return dataclasses.replace(path, **{name: getattr(path, name)[rows] for name in names})


WHOLE = plan(SURFACE, PARAMETERS.path)
PATH = some(WHOLE, np.flatnonzero((WHOLE.pass_index == 0) & (np.degrees(WHOLE.angle) > 30))[:30])
FOUND = solve_path(ARM, PATH, ARM.zero_pose, obstacles=AROUND)
TIMED = time_path(ARM, FOUND.path, FOUND.q, FOUND.break_before, PARAMETERS.timing, AROUND)


def test_a_solved_path_passes_the_dry_run_whole() -> None:
    run = check_sequence(ARM, TIMED.sequence, PARAMETERS.check, AROUND, 0.0)
    assert run.ok and not run.points
    mended = time_and_mend(ARM, FOUND.path, FOUND.q, FOUND.break_before, PARAMETERS, AROUND, 0.0)
    assert not mended.replaced and mended.timed.sequence.t.tobytes() == TIMED.sequence.t.tobytes()


def test_a_wrong_load_shows_in_the_pose() -> None:
    run = check_sequence(ARM, TIMED.sequence, change(PARAMETERS.check, pose_mm=5.0), AROUND, 181.0)
    assert {f.rule for f in run.findings} == {"pose"} and "off its planned pose" in run.findings[0].text


def test_rows_that_come_too_near_are_found_and_named() -> None:
    q = TIMED.sequence.q.copy()
    row = int(np.argmax(TIMED.sequence.point == 12)) + 1
    q[row, 1] += np.radians(25.0)
    bad = dataclasses.replace(TIMED.sequence, q=q)
    run = check_sequence(ARM, bad, PARAMETERS.check, AROUND)
    rules = {f.rule for f in run.findings}
    assert {"clearance", "speed", "step"} <= rules
    assert next(f for f in run.findings if f.rule == "clearance").row == row
    assert set(run.points) & {12, 13}


def test_a_bad_point_gives_way_to_its_neighbours() -> None:
    q = FOUND.q.copy()
    q[15, 1] += np.radians(1.5)  # the nozzle some 200 mm off: wrong, but within every limit of the joints
    path = FOUND.path
    mended = time_and_mend(ARM, path, q, FOUND.break_before, PARAMETERS, AROUND, 0.0)
    assert 15 in mended.replaced and "replaced by its neighbours" in mended.replaced[15]
    assert mended.run.ok
    left = mended.timed.sequence.point
    assert 15 not in left and {0, 29} <= set(left.tolist())
    # one stroke still, that passes where the point was
    between = mended.timed.sequence.spraying[:-1]
    assert between.all()
    way = np.linalg.norm(mended.timed.sequence.position - path.position[15], axis=1)
    assert way.min() < 0.03
