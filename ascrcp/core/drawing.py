"""Read the design line of a DXF drawing: lines, arcs, polylines, splines -> one chain of points."""

from pathlib import Path
from typing import Any

import numpy as np

from ascrcp.core.errors import ConfigError
from ascrcp.core.geometry import Array

FLATTEN = 0.0005  # curves become chords this near to them [m]
JOIN = 0.02  # ends of entities this near belong together [m]
MAX_ENTITIES = 5000
_KINDS = ("LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE")
_METRES = {1: 0.0254, 2: 0.3048, 4: 0.001, 5: 0.01, 6: 1.0, 14: 0.1}  # $INSUNITS


def read_drawing(path: Path, scale: float | None) -> Array:
    """Read all curves of the model space as one chain, in the drawing's axes (x right, y up).

    Args:
        path: The DXF file; the design line must be its only geometry, or lie on a layer called
            "design" or "profile".
        scale: Metres per drawing unit; None takes the drawing's own unit, metres if it names none.

    Returns:
        Points [m] in walking order, shape (n, 2).

    Raises:
        ConfigError: Not a DXF, no curves, or curves that do not join.
    """
    from ezdxf.filemanagement import readfile  # heavy: only for who brings a drawing
    from ezdxf.path import make_path

    try:
        document = readfile(str(path))
        unit = scale if scale is not None else _METRES.get(int(document.header.get("$INSUNITS", 6)), 1.0)
        entities = _design(list(document.modelspace()))
        if len(entities) > MAX_ENTITIES:
            raise ConfigError(f"{path}: {len(entities)} curves, allowed {MAX_ENTITIES}")
        chains = []
        for entity in entities:
            points = np.array([(v.x, v.y) for v in make_path(entity).flattening(FLATTEN / unit)])
            if len(points) >= 2:
                chains.append(points.astype(float) * unit)
    except ConfigError:
        raise
    except Exception as error:  # noqa: BLE001 - what ezdxf raises on damaged files is of many kinds
        text = " ".join(str(error).split())[:120] or type(error).__name__
        raise ConfigError(f"{path}: not a readable DXF drawing ({text})") from None
    if not chains:
        raise ConfigError(f"{path}: the drawing holds no {', '.join(_KINDS)}")
    return _joined(chains, path)


def _design(entities: list[Any]) -> list[Any]:
    curves = [e for e in entities if e.dxftype() in _KINDS]
    named = [e for e in curves if e.dxf.layer.lower() in ("design", "profile")]
    return named or curves


def _joined(chains: list[Array], path: Path) -> Array:
    """Put chains end to end, whatever their order and direction."""
    line = chains.pop(0)
    while chains:
        near = [
            (float(np.hypot(*(p - q))), k, head, flip)
            for k, chain in enumerate(chains)
            for head, p in ((True, line[0]), (False, line[-1]))
            for flip, q in ((False, chain[0]), (True, chain[-1]))
        ]
        gap, k, head, flip = min(near)
        if gap > JOIN:
            end = line[0] if head else line[-1]
            raise ConfigError(
                f"{path}: the design line has a gap of {gap:.3f} m at ({end[0]:.2f}, {end[1]:.2f}) m, "
                f"allowed {JOIN:g}"
            )
        chain = chains.pop(k)
        if head:
            line = np.concatenate([chain if flip else chain[::-1], line])
        else:
            line = np.concatenate([line, chain[::-1] if flip else chain])
    return line
