"""A quick start: what is heavy is loaded where it is used, in the compute process."""

import inspect
import subprocess
import sys

import pytest

from ascrcp.cli.dispatch import COMMANDS, find_command
from ascrcp.cli.parser import build_parser
from ascrcp.session.remote import Remote

HEAVY = ("matplotlib", "open3d", "scipy.stats", "scipy.signal", "laspy", "jinja2")
"""Seconds of start, and the interpreter's lock while they work: only for the compute process."""


def loaded_by(statement: str) -> set[str]:
    """Modules of a fresh interpreter after a statement."""
    found = subprocess.run(
        [sys.executable, "-c", f"import sys\n{statement}\nprint(*sorted(sys.modules))"],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return set(found.stdout.split())


def test_application_loads_nothing_of_the_compute_process() -> None:
    loaded = loaded_by("import ascrcp.__main__, ascrcp.cli.drive, ascrcp.app, ascrcp.hmi.application")
    assert not loaded & {*HEAVY, "ascrcp.session.stages", "ascrcp.session.report"}


def test_answers_of_the_stages_bring_nothing_along() -> None:
    """They are unpickled while the control thread runs: an import then would hold its lock."""
    names = "ascrcp.session.outcome, ascrcp.control.steer_plan, ascrcp.kinematics.obstacle, ascrcp.core.flow"
    answers = loaded_by(f"import {names}, ascrcp.session.snapshot")
    application = loaded_by("import ascrcp.app")
    assert answers <= application


@pytest.mark.parametrize(
    ("statement", "kept_out"),
    [
        ("import ascrcp.__main__", {"scipy", "PySide6", "can", "ascrcp.app", *HEAVY}),
        ("from ascrcp.cli.dispatch import find_command; find_command('fk')", {"can", "ascrcp.app", *HEAVY}),
        ("from ascrcp.cli.dispatch import find_command; find_command('run')", {"PySide6", *HEAVY}),
    ],
    ids=["help", "fk", "run"],
)
def test_command_loads_no_more_than_it_needs(statement: str, kept_out: set[str]) -> None:
    assert not loaded_by(statement) & kept_out


def test_every_command_of_the_parser_is_found() -> None:
    actions = [a for a in build_parser()._actions if a.dest == "command"]
    assert set(actions[0].choices or ()) == set(COMMANDS)
    for name in COMMANDS:
        assert list(inspect.signature(find_command(name)).parameters) == ["options", "output"], name


@pytest.mark.parametrize("remote", Remote)
def test_every_stage_is_found_and_tells_its_progress(remote: Remote) -> None:
    assert "progress" in inspect.signature(remote.function).parameters
