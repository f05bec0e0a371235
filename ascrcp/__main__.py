"""Front door: `ascrcp` opens the application, `ascrcp COMMAND` runs one stage."""

import os
import sys
from collections.abc import Sequence

from ascrcp.cli import parser
from ascrcp.cli.dispatch import find_command
from ascrcp.cli.output import Output, guarded
from ascrcp.core.ending import Ending, interrupted_by_terminate


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the platform.

    Args:
        arguments: Command line without the program's name; the process's own if None.

    Returns:
        Exit code: 0 ok, 1 failed, 2 bad input.
    """
    options = parser.build_parser().parse_args(arguments)
    output = Output(json=options.json)
    return guarded(output, lambda: _run(options, output))


def _run(options: parser.Options, output: Output) -> int:
    if options.command is not None:
        with interrupted_by_terminate():
            return find_command(options.command)(options, output)
    with Ending() as ending:
        code = _show(options, output, ending)
        ending.check()
    return code


def _show(options: parser.Options, output: Output, ending: Ending) -> int:
    """Open the screen, by hand or for the whole automatic job."""
    has_display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    offscreen = options.offscreen or (sys.platform.startswith("linux") and not has_display)
    if offscreen and not options.offscreen:
        output.say("no display: the whole automatic job runs headless (--offscreen)")
    from ascrcp.cli import drive  # not for a command that needs neither session nor Qt
    from ascrcp.hmi import application

    ending.check()
    session = drive.open_session(options, lockstep=offscreen, resprays=options.respray if offscreen else None)
    if not offscreen:
        return application.run(session, offscreen=False, pictures=options.pictures, auto=False, ending=ending)
    pictures = options.pictures or session.round.pictures
    with output.progress(session) as tell:
        code = application.run(
            session,
            offscreen=True,
            pictures=pictures,
            auto=True,
            tell=tell,
            gallery=options.pictures is not None,
            resprays=options.respray,
            ending=ending,
        )
    ending.check()
    return drive.finish_job(session, output, code)


if __name__ == "__main__":
    sys.exit(main())
