"""Find the function of a command by its name: only what the command needs is loaded."""

import gc
from collections.abc import Callable
from importlib import import_module

from ascrcp.cli.output import Output
from ascrcp.cli.parser import Options

Command = Callable[[Options, Output], int]

COMMANDS: dict[str, str] = {
    "scan": "drive:scan",
    "recognise": "command:recognise",
    "plan": "command:plan",
    "solve": "command:solve",
    "run": "drive:run",
    "report": "command:report",
    "replay": "drive:replay",
    "fk": "arm:forward",
    "ik": "arm:inverse",
    "machines": "arm:machines",
    "calibrate": "calibrate:calibrate_machine",
    "tune": "tune:tune",
    "workspace": "workspace:workspace",
    "align": "survey:align_lidar",
    "thickness": "survey:thickness",
    "section": "survey:section",
    "duct": "duct:duct",
    "muck": "muck:muck",
    "doctor": "doctor:doctor",
    "bench": "bench:bench",
}
"""Module in ascrcp.cli and function of every command."""


def find_command(name: str) -> Command:
    """Load a command.

    Args:
        name: As the parser knows it.

    Returns:
        Its function: options and output -> exit code.
    """
    module, _, function = COMMANDS[name].partition(":")
    found: Command = getattr(import_module(f"ascrcp.cli.{module}"), function)
    if not gc.get_freeze_count():  # what was loaded stays: no use in searching it for garbage
        gc.freeze()
    return found
