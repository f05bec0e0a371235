"""Read a design profile: YAML, DXF drawing or text file of points -> Profile.

A drawing shows the section as seen looking into the heading: its x runs to the right, its y up. The
axis is the drawing's origin where that lies inside the line; otherwise half-way between the walls at
the height where the line is widest (`origin` in a YAML file sets it). Of a closed line the floor, where
it runs flatter than 45 degrees, is left out.
"""

import re
from pathlib import Path

import numpy as np

from ascrcp.core.arc_fit import fit_arcs
from ascrcp.core.config import Struct, convert, read_yaml
from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array
from ascrcp.core.profile import Arc, Profile, check_line

MAX_BYTES = 20_000_000
MAX_POINTS = 100_000
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
SIZE = (1.5, 40.0)  # width and height a tunnel may have [m]
_FLOOR_DEG = 45.0  # a closed line is floor where its normal points further down than this
_GAP = 0.5  # widest gap between points given in no order [m]
_GAP_RATIO = 10.0  # and between points given in order, beside their usual spacing
_STRAIGHT_DEG = 3.0  # a longer step is a straight wall where it turns by less at one end; placeholder
_LOOK = 0.25  # the floor's slope is taken over this far to either side [m]


class ProfileFile(Struct):
    """What a profile YAML may hold: one of `arcs`, `points` and `points_file`, and the offsets.

    Attributes:
        arcs: Arcs of the design line relative to the axis, by rising section angle.
        points: Points (y, z) of the design line, y left, z up.
        points_file: A DXF or text file, relative to this file.
        unit: Unit of the points, m, cm or mm.
        origin: The axis in the coordinates of the points (as they stand there).
    """

    name: str
    arcs: list[Arc] | None = None
    points: list[tuple[float, float]] | None = None
    points_file: str | None = None
    unit: str = "m"
    origin: tuple[float, float] | None = None
    arch_line: float = -0.22
    overbreak_line: float = 0.15
    arch_width: float = 0.20
    spray_depth: float = 3.0

    def __post_init__(self) -> None:
        given = sum(value is not None for value in (self.arcs, self.points, self.points_file))
        if given != 1:
            raise ValueError("exactly one of arcs, points and points_file must be given")
        if self.unit not in UNITS:
            raise ValueError(f"unit {self.unit!r}, allowed {', '.join(UNITS)}")
        if self.arcs is not None and (self.origin is not None or self.unit != "m"):
            raise ValueError("arcs are in metres relative to the axis: origin and unit belong to points")


def read_profile(path: Path) -> Profile:
    """Read a profile by its suffix: .yaml .yml, .dxf, or .txt .csv .xy with points.

    Raises:
        ConfigError: One line: unreadable, wrong units, a gap, a crossing, or no tunnel's section.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return _read_yaml(path)
    if suffix in _READERS:
        return build_profile(_READERS[suffix](path, None), ProfileFile(name=path.stem, points=[]), str(path))
    allowed = " ".join((".yaml", *_READERS))
    raise ConfigError(f"{path}: unknown profile format {suffix or 'without suffix'!r}, allowed {allowed}")


def _read_yaml(path: Path) -> Profile:
    file = convert(read_yaml(path), ProfileFile, str(path))
    if file.arcs is not None:
        offsets = {name: getattr(file, name) for name in Profile.__struct_fields__ if name != "arcs"}
        try:
            return Profile(arcs=file.arcs, **offsets)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
    if file.points is not None:
        line = np.array(file.points, dtype=float).reshape(-1, 2) * UNITS[file.unit]
        return build_profile(line, file, str(path))
    place = path.parent / str(file.points_file)
    reader = _READERS.get(place.suffix.lower())
    if reader is None:
        raise ConfigError(f"{path}: points_file {place.name}: allowed {' '.join(_READERS)}")
    try:
        line = reader(place, UNITS[file.unit])
    except ConfigError as error:
        raise ConfigError(f"{path}: points_file {error}") from None
    if file.origin is not None:  # it stands in the file's coordinates: x to the right
        file = convert({**_plain(file), "origin": [-file.origin[0], file.origin[1]]}, ProfileFile, str(path))
    return build_profile(line, file, str(path))


def _plain(file: ProfileFile) -> dict[str, object]:
    return {name: getattr(file, name) for name in file.__struct_fields__ if getattr(file, name) is not None}


def build_profile(line: Array, file: ProfileFile, where: str) -> Profile:
    """Build a profile from points of its design line.

    Args:
        line: Points (y, z), y left, z up [m], in walking order or in none, shape (n, 2).
        file: Name, offsets and, if known, the axis.
        where: File, for messages.

    Raises:
        ConfigError: The points are no section of a tunnel.
    """
    try:
        line = _ordered(_checked(line))
        origin = np.array(file.origin) * UNITS[file.unit] if file.origin is not None else _find_axis(line)
        line = _without_floor(line - origin)
        arcs, _ = fit_arcs(line)
        return Profile(
            name=file.name,
            arcs=[
                Arc(
                    centre=a.centre,
                    radius=a.radius,
                    start_deg=float(np.degrees(a.start)),
                    end_deg=float(np.degrees(a.end)),
                )
                for a in arcs
            ],
            arch_line=file.arch_line,
            overbreak_line=file.overbreak_line,
            arch_width=file.arch_width,
            spray_depth=file.spray_depth,
        )
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _checked(line: Array) -> Array:
    if len(line) > MAX_POINTS:
        raise ConfigError(f"{len(line)} points, allowed {MAX_POINTS}")
    if not np.isfinite(line).all():
        raise ConfigError("a point of the design line is not finite")
    line = line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > 1e-9])] if len(line) else line
    if len(line) < 4:
        raise ConfigError(f"only {len(line)} different points, a design line needs at least 4")
    width, height = (float(v) for v in np.ptp(line, axis=0))
    if not (SIZE[0] <= width <= SIZE[1] and SIZE[0] <= height <= SIZE[1]):
        hint = "; are the points in millimetres?" if SIZE[0] <= width / 1000 <= SIZE[1] else ""
        raise ConfigError(
            f"the line is {width:.4g} m wide and {height:.4g} m high, "
            f"allowed {SIZE[0]:g}..{SIZE[1]:g} m{hint}"
        )
    return line


def _ordered(line: Array) -> Array:
    """Bring points into walking order with rising section angle; refuse gaps."""
    middle = (line.min(axis=0) + line.max(axis=0)) / 2
    about = line - middle
    by_angle = line[np.argsort(np.arctan2(about[:, 0], about[:, 1]), kind="stable")]  # from the floor round
    way = _length(line)
    if way <= 1.5 * _length(by_angle):
        usual = float(np.median(np.hypot(*np.diff(line, axis=0).T)))
        if len(line) >= 30:
            _check_gaps(line, max(_GAP, _GAP_RATIO * usual))
        closed = float(np.hypot(*(line[0] - line[-1]))) <= max(2.0 * usual, 0.02)
        if closed and len(line) > 4:
            line = _cut_below(line[:-1] if np.hypot(*(line[0] - line[-1])) < 1e-6 else line, middle)
        way_at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        even = np.linspace(0.0, way_at[-1], 240)
        check_line(np.stack([np.interp(even, way_at, line[:, k]) for k in (0, 1)], axis=-1), "points")
        # rising section angle: clockwise in (y, z), whose area is negative
        return line if _area(line) < 0.0 else line[::-1]
    line = _cut_below(by_angle, middle)
    _check_gaps(line, _GAP)
    return line


def _check_gaps(line: Array, widest: float) -> None:
    """Refuse a long step between points unless it is a straight wall: in line with what it joins."""
    step = np.diff(line, axis=0)
    spacing = np.hypot(*step.T)
    turn = np.abs(
        np.arctan2(
            step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0], np.sum(step[:-1] * step[1:], axis=1)
        )
    )
    bent = np.minimum(np.append(np.inf, turn), np.append(turn, np.inf))
    gap = np.where((spacing > widest) & (bent > np.radians(_STRAIGHT_DEG)), spacing, 0.0)
    if gap.max() > 0.0:
        y, z = line[int(gap.argmax())]
        raise ConfigError(f"the design line has a gap of {gap.max():.2f} m after ({y:.2f}, {z:.2f}) m")


def _length(line: Array) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _area(line: Array) -> float:
    y, z = line.T
    return float(np.sum(y * np.roll(z, -1) - z * np.roll(y, -1)) / 2)


def _cut_below(line: Array, middle: Array) -> Array:
    """Let a closed line begin at its floor, straight below the middle (or at the widest gap there)."""
    below = line[:, 1] < middle[1]
    step = np.hypot(*(np.roll(line, -1, axis=0) - line).T)
    wide = np.where(below, step, 0.0)
    start = (
        int(wide.argmax())
        if wide.max() > _GAP
        else int(np.where(below, np.abs(line[:, 0] - middle[0]), np.inf).argmin())
    )
    return np.roll(line, -(start + 1), axis=0)


def _find_axis(line: Array) -> Array:
    """Origin of the drawing if it lies inside the line, else the middle of the widest chord."""
    low, high = line.min(axis=0), line.max(axis=0)
    middle = (low[0] + high[0]) / 2
    if abs(middle) < 0.1 * (high[0] - low[0]) and low[1] <= 0.0 < high[1]:
        return np.zeros(2)
    near = 0.01 * (high[0] - low[0])
    side = np.minimum(line[:, 0] - low[0], high[0] - line[:, 0]) < near
    return np.array([middle, float(np.median(line[side, 1]))])


def _without_floor(line: Array) -> Array:
    """Keep the run about the crown whose outward normal points at most 45 degrees down."""
    step = np.diff(line, axis=0)
    count = np.maximum(1, np.ceil(np.hypot(*step.T) / (_LOOK / 4)).astype(int))
    if count.sum() > 10 * MAX_POINTS:
        raise ConfigError("the design line is far too long")
    index = np.repeat(np.arange(len(step)), count)
    part = np.concatenate([np.arange(n) / n for n in count])
    dense = np.concatenate([line[index] + part[:, None] * step[index], line[-1:]])
    index = np.append(index, len(step))
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    ahead, back = (
        np.stack([np.interp(way + d, way, dense[:, k]) for k in (0, 1)], axis=-1) for d in (_LOOK, -_LOOK)
    )
    tangent = ahead - back
    # outward normal of a clockwise walk is on the left hand; how far it points down
    down = np.degrees(np.arctan2(-tangent[:, 0], np.abs(tangent[:, 1])))
    floor = (down > _FLOOR_DEG) & (dense[:, 1] < np.median(dense[:, 1]))
    crown = int(dense[:, 1].argmax())
    if dense[crown, 1] - max(line[0, 1], line[-1, 1]) < SIZE[0] / 5:
        raise ConfigError(
            "the design line has no crown between two walls; is it upside down, or one side only?"
        )
    before, after = np.flatnonzero(floor[:crown]), np.flatnonzero(floor[crown:])
    first = int(before[-1]) + 1 if len(before) else 0
    last = crown + int(after[0]) - 1 if len(after) else len(dense) - 1
    own = line[index[first] + 1 : index[last] + 1]
    kept = np.concatenate([dense[first : first + 1], own, dense[last : last + 1]])
    kept = kept[np.concatenate([[True], np.hypot(*np.diff(kept, axis=0).T) > 1e-6])]
    if len(kept) < 3 or kept[:, 1].max() - kept[[0, -1], 1].min() < SIZE[0] / 2:
        raise ConfigError("no walls and crown found in the design line")
    return kept


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def read_points(path: Path, scale: float | None) -> Array:
    """Read two numbers a line (x right, y up); anything after # or // is a comment in any encoding.

    Returns:
        Points (y left, z up) [m], shape (n, 2).
    """
    lines = _read_bytes(path).decode("latin-1").splitlines()
    rows: list[tuple[float, float]] = []
    for number, text in enumerate(lines, 1):
        words = re.split(r"#|//", text)[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        if len(words) != 2 or not all(_NUMBER.fullmatch(word) for word in words):
            if not rows and not any(_NUMBER.fullmatch(word) for word in words):
                continue  # a heading
            shown = text.strip()[:40].encode("ascii", "replace").decode()
            raise ConfigError(f"{path}: line {number} is {shown!r}, two numbers are needed")
        rows.append((float(words[0]), float(words[1])))
    if not rows:
        raise ConfigError(f"{path}: holds no points")
    return np.array(rows) * [-1.0, 1.0] * (scale or 1.0)


def _read_bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ConfigError(f"{path}: larger than {MAX_BYTES} bytes")
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from None


def read_dxf(path: Path, scale: float | None) -> Array:
    """Read the design line of a DXF drawing; see `ascrcp.core.drawing`."""
    from ascrcp.core.drawing import read_drawing  # ezdxf takes half a second to import

    _read_bytes(path)
    return read_drawing(path, scale) * [-1.0, 1.0]


_READERS = {".dxf": read_dxf, ".txt": read_points, ".csv": read_points, ".xy": read_points}
