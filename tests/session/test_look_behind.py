"""A further scan looks behind the arches on the real rig: stopped meanwhile, repeated, and what it shows."""

import time
from pathlib import Path

import numpy as np
from test_second_scan import do, shorten

from ascrcp.app import Options, open_session
from ascrcp.core.geometry import apply_transform
from ascrcp.perception.parameter import load_parameters
from ascrcp.perception.voxel import voxel
from ascrcp.planning.table import read_joints, write_joints
from ascrcp.session.again import _lay_over
from ascrcp.session.session import Session
from ascrcp.session.stages import project_scan
from ascrcp.session.state import Refusal, Step
from ascrcp.session.store import read_archive, read_json, read_scan, read_surface

LONG = Path(__file__).parent / "long.yaml"
LANCE = 5  # index of the telescope that carries the lidar
SPRAYED_S = 60.0


def stop_when_drawn_out(session: Session) -> None:
    session.start(Step.RESCAN)
    limit = time.monotonic() + 120.0
    while session.measured_q()[LANCE] < 0.3:
        assert session.snapshot().job.active is Step.RESCAN and time.monotonic() < limit
        time.sleep(0.001)
    session.stop()
    session.wait()


def test_the_look_behind_the_arches_on_the_rig(tmp_path: Path) -> None:
    options = Options(rig=LONG, seed=5, planner="thesis", resprays=0)
    session = open_session(options, tmp_path / "round", tmp_path)
    try:
        session.reset_and_wait(30.0)
        do(session, Step.ZERO, Step.RECOGNISE)
        joints = session.round.joints
        write_joints(joints, shorten(read_joints(joints), SPRAYED_S), session.arm.prismatic)
        do(session, Step.LOAD, Step.GO_TO_START, Step.RUN, Step.ZERO)

        stop_when_drawn_out(session)
        assert session.measured_q()[LANCE] > 0.2, "the lance stands in the heading"
        assert session.round.rescans() == [], "nothing of it counts"
        session.reset_and_wait(30.0)
        assert session.refusal(Step.RESCAN) is session.refusal(Step.RECOGNISE) is Refusal.NEEDS_ZERO

        do(session, Step.ZERO, Step.RESCAN)
        (found,) = session.round.rescans()
        assert found.folder.name == "rescan-2", "the one given up is not reused"
        first, look = read_scan(found.scan), read_scan(found.look)
        assert look.q[LANCE] - first.q[LANCE] > 0.5
        assert np.abs(np.delete(look.q - first.q, LANCE)).max() < 0.02
        assert session.measured_q()[LANCE] < 0.05, "it comes back"
        assert session.refusal(Step.RESCAN) is None

        notes = read_json(found.finish)["look"]
        assert notes["share"] > 0.5 and notes["residual_mm"] < 10.0
        _, with_look = read_archive(found.achieved, "achieved", ("after",))
        assert np.isfinite(with_look["after"]).mean() > 0.3

        # laid over the sweep before it: a shift is taken off again
        surface = read_surface(session.round.surface)
        clouds = [
            voxel(project_scan(scan, "kc", 0.0, {}).points, load_parameters().voxel) for scan in (first, look)
        ]
        T = np.eye(4)
        T[:3, 3] = (0.01, -0.02, 0.03)
        laid = [
            _lay_over(clouds[0], cloud, surface, {})
            for cloud in (clouds[1], apply_transform(T, clouds[1].astype(float)).astype(np.float32))
        ]
        assert laid[0] is not None and laid[1] is not None
        assert np.abs(laid[0] - laid[1]).max() < 0.004
        assert _lay_over(clouds[0], clouds[1] + np.float32(5.0), surface, {}) is None, "another place"
    finally:
        session.close()
