"""The options of the command line (design.md section 9)."""

import argparse
from pathlib import Path

from ascrcp import __version__

Options = argparse.Namespace

BENCHES = (
    "kinematics",
    "headings",
    "perception",
    "planning",
    "proof",
    "sister",
    "control",
    "rigs",
    "realtime",
)

MOST_RESPRAYS = 9
"""Further sprayings a headless job may be asked for; a third has little left to mend."""


def _common(parser: argparse.ArgumentParser, defaults: bool = False) -> None:
    """Add the common options; a stage's own leave alone what was given before its name."""
    if not defaults:
        parser.argument_default = argparse.SUPPRESS
    group = parser.add_argument_group("common options")
    group.add_argument(
        "--json",
        action="store_true",
        default=_default(defaults, False),
        help="one JSON object on stdout, progress on stderr",
    )
    group.add_argument(
        "--machine", default=_default(defaults, "kc"), metavar="NAME", help="kc, or a machine YAML"
    )
    group.add_argument("--rig", type=Path, metavar="FILE", help="overlay any parameter of the simulated rig")
    group.add_argument(
        "--seed",
        type=_natural,
        default=_default(defaults, 1),
        metavar="N",
        help="seed of everything random (1)",
    )
    group.add_argument(
        "--load-kg", type=_payload, default=_default(defaults, 0.0), metavar="X", help="concrete in the hose"
    )
    group.add_argument("--cloud", type=Path, metavar="FILE", help="this cloud, in the base frame, not a scan")
    group.add_argument("--profile", type=Path, metavar="FILE", help="design profile of the tunnel")
    group.add_argument("--control", type=Path, metavar="FILE", help="control parameters written by tune")
    group.add_argument(
        "--planner",
        choices=("coverage", "thesis"),
        help="coverage doses the concrete to the wanted surface; thesis: constant speed and flow",
    )


def _default(wanted: bool, value: object) -> object:
    return value if wanted else argparse.SUPPRESS


def _natural(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**32:
        raise argparse.ArgumentTypeError(f"{text} is not in 0..{2**32 - 1}")
    return value


def _few(text: str) -> int:
    value = int(text)
    if not 0 <= value <= MOST_RESPRAYS:
        raise argparse.ArgumentTypeError(f"{text} is not in 0..{MOST_RESPRAYS}")
    return value


def _shift(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y,Z in metres") from None
    if not max(abs(x), abs(y), abs(z)) <= 1e8:
        raise argparse.ArgumentTypeError(f"{text!r} is not within 1e8 m")
    return x, y, z


def _payload(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 500.0:
        raise argparse.ArgumentTypeError(f"{text} kg is not in 0..500")
    return value


def _minutes(text: str) -> float:
    value = float(text)
    if not 0.5 <= value <= 600.0:
        raise argparse.ArgumentTypeError(f"{text} min is not in 0.5..600")
    return value


def _metres(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 1000.0:
        raise argparse.ArgumentTypeError(f"{text} m is not in 0..1000")
    return value


def build_parser() -> argparse.ArgumentParser:
    """Build the parser of the whole command line."""
    parser = argparse.ArgumentParser(
        prog="ascrcp", description="Automatic Shotcrete Robot Control Platform.", allow_abbrev=False
    )
    parser.add_argument("--version", action="version", version=f"ascrcp {__version__}")
    parser.add_argument("--offscreen", action="store_true", help="the whole automatic job without a display")
    parser.add_argument(
        "--round", type=Path, metavar="DIR", help="round folder; a new one below rounds/ if left out"
    )
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="where screen pictures go")
    parser.add_argument(
        "--realtime", action="store_true", help="real time instead of lockstep with --offscreen"
    )
    parser.add_argument(
        "--respray",
        type=_few,
        default=0,
        metavar="N",
        help="with --offscreen: spray again at most N times what a second scan finds too thin (0)",
    )
    _common(parser, defaults=True)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="stages and tools")
    for name, text, needs_round in _STAGES:
        stage = commands.add_parser(name, help=text, description=text, allow_abbrev=False)
        _common(stage)
        if name == "recognise":
            stage.add_argument(
                "input", nargs="?", type=Path, default=None, metavar="CLOUD", help="ply pcd las laz xyz csv"
            )
            stage.add_argument(
                "--out", type=Path, default=None, metavar="DIR", help="where features.json and the cloud go"
            )
            stage.add_argument(
                "--shift",
                type=_shift,
                default=(0.0, 0.0, 0.0),
                metavar="X,Y,Z",
                help="taken off the cloud's coordinates [m], for a surveyor's frame",
            )
            stage.add_argument("--round", type=Path, metavar="DIR", help="round folder with a scan")
        elif needs_round is not None:
            stage.add_argument("--round", type=Path, metavar="DIR", required=needs_round, help="round folder")
        if name in ("scan", "run"):
            stage.add_argument(
                "--realtime", action="store_true", default=argparse.SUPPRESS, help="not in lockstep"
            )
        if name in ("fk", "ik"):
            stage.add_argument(
                "input", nargs="?", default=None, metavar="JSON", help="JSON text; standard input if left out"
            )
        if name == "machines":
            stage.add_argument(
                "--urdf", type=Path, default=None, metavar="DIR", help="write NAME.urdf and NAME.srdf there"
            )
        if name == "bench":
            stage.add_argument("which", nargs="?", default="all", choices=("all", *BENCHES))
            stage.add_argument(
                "--minutes", type=_minutes, default=10.0, metavar="M", help="of bench realtime (10)"
            )
        if name == "tune":
            stage.add_argument(
                "--out", type=Path, required=True, metavar="YAML", help="the new control parameters"
            )
            stage.add_argument(
                "--steps", type=Path, default=None, metavar="DIR", help="pictures of the step responses"
            )
        if name == "plan":
            _plan(stage)
        if name in _OWN:
            _OWN[name](stage)
        if name == "section":
            stage.add_argument(
                "--station", type=float, required=True, metavar="M", help="station along the axis [m]"
            )
    return parser


def _calibration(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--data", type=Path, required=True, metavar="FILE", help="CSV of joint readings and surveyed points"
    )
    stage.add_argument("--out", type=Path, required=True, metavar="YAML", help="the new machine file")
    stage.add_argument(
        "--fit",
        default=None,
        action="append",
        choices=("zeros", "lengths", "sag"),
        help="only this group; may be repeated",
    )
    stage.add_argument(
        "--hold",
        action="append",
        default=None,
        metavar="NAME",
        help="leave a parameter as it is; may be repeated",
    )
    stage.add_argument(
        "--simulate",
        type=_natural,
        default=None,
        metavar="N",
        help="first survey N poses of the simulated rig into FILE",
    )


def _workspace(stage: argparse.ArgumentParser) -> None:
    stage.add_argument("--round", type=Path, metavar="DIR", help="recognised round: the map of its wall")
    stage.add_argument("--out", type=Path, required=True, metavar="DIR", help="where map and pictures go")


def _duct(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "contours",
        nargs="?",
        type=Path,
        default=None,
        metavar="CONTOURS",
        help="csv or yaml; a trial bend if left out",
    )
    stage.add_argument(
        "--at",
        type=_metres,
        action="append",
        default=[],
        metavar="M",
        help="ring so far into the duct [m]; may be repeated",
    )
    stage.add_argument("--stand-off", type=_metres, default=None, metavar="M", help="gun to wall [m]")
    stage.add_argument("--out", type=Path, required=True, metavar="DIR", help="where joints and pictures go")


def _plan(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--after",
        type=Path,
        default=None,
        metavar="SCAN",
        help="second scan, a recognised round or a cloud in the base frame: plan only what is still too thin",
    )


def _muck(stage: argparse.ArgumentParser) -> None:
    stage.add_argument("--depth", type=_metres, default=None, metavar="M", help="muck on the invert [m]")
    stage.add_argument("--length", type=_metres, default=None, metavar="M", help="along the tunnel [m]")
    stage.add_argument("--out", type=Path, required=True, metavar="DIR", help="where joints and picture go")


def _thickness(stage: argparse.ArgumentParser) -> None:
    stage.add_argument(
        "--after", type=Path, required=True, metavar="DIR", help="recognised round of the second scan"
    )
    stage.add_argument("--out", type=Path, required=True, metavar="DIR", help="where map and figures go")


_OWN = {
    "calibrate": _calibration,
    "workspace": _workspace,
    "thickness": _thickness,
    "duct": _duct,
    "muck": _muck,
}
"""Options that one stage alone has."""

_STAGES: tuple[tuple[str, str, bool | None], ...] = (
    ("scan", "zero the joints and scan the heading", False),
    ("recognise", "cloud -> axis, arches, overbreak, bays (features.json, labelled cloud)", False),
    ("plan", "recognised round -> nozzle path (path.csv)", True),
    ("solve", "path -> joint sequence (joints.csv)", True),
    ("run", "drive a solved round on the rig", True),
    ("report", "build the report of a round", True),
    ("replay", "run the recorded inputs again and compare every command bit by bit", True),
    ("fk", "joints -> nozzle pose", None),
    ("ik", "nozzle pose -> every joint solution", None),
    ("machines", "list the arms", None),
    ("calibrate", "measured tip positions -> machine file with fitted zeros, lengths and sag", None),
    ("tune", "small motions over the bus -> control parameters of this machine", None),
    ("workspace", "what the arm reaches, and how much of a heading from this parking place", None),
    ("align", "find the pan head's zero from the lance in a round's scan", True),
    ("thickness", "layer between two scans of one wall, with its noise floor", True),
    ("section", "the wall in one plane across the axis", True),
    ("duct", "contours of a duct -> joints that spray rings inside it (duct arm)", None),
    ("muck", "muck on the invert -> scoops, joints and time (muck arm)", None),
    ("doctor", "say what is missing on this computer", None),
    ("bench", "measure figures beside peers", None),
)
