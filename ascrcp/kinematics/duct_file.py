"""Contour files: CSV or YAML -> Duct. docs/sister_machines.md describes both formats."""

import csv
from pathlib import Path

import numpy as np

from ascrcp.core.config import Struct, convert, read_yaml
from ascrcp.core.errors import InputError
from ascrcp.core.geometry import Array
from ascrcp.kinematics.duct import Duct

COLUMNS = ("contour", "x", "y", "z")
MAX_BYTES = 20_000_000
"""Largest CSV read: some 400,000 points."""


class ContourFile(Struct):
    """YAML form: contours in order into the duct, points x, y, z in the arm's base frame [m]."""

    name: str
    contours: list[list[tuple[float, float, float]]]


def read_duct(path: Path) -> Duct:
    """Read contours.

    Raises:
        InputError: A file that is neither, or contours that are no duct; one line says where.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        file = convert(read_yaml(path), ContourFile, str(path))
        return _join(f"{path}: {file.name}", [np.array(points, dtype=float) for points in file.contours])
    if path.suffix.lower() == ".csv":
        return _join(str(path), _read_csv(path))
    raise InputError(f"{path}: contours come as .csv or .yaml")


def encode_duct(duct: Duct) -> bytes:
    """Write a duct as CSV text."""
    lines = [",".join(COLUMNS)]
    for number, points in enumerate(duct.contour, start=1):
        lines += [f"{number},{x:.6f},{y:.6f},{z:.6f}" for x, y, z in points.tolist()]
    return ("\n".join(lines) + "\n").encode()


def _join(name: str, contours: list[Array]) -> Duct:
    counts = sorted({len(points) for points in contours})
    if len(counts) != 1:
        raise InputError(f"{name}: every contour needs the same number of points, not {counts[:6] or 'none'}")
    return Duct.from_contours(name, np.stack(contours))


def _read_csv(path: Path) -> list[Array]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES} bytes")
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text") from None
    rows = csv.reader(lines)
    head = [name.strip().lower() for name in next(rows, [])]
    if tuple(head) != COLUMNS:
        raise InputError(f"{path}: line 1 must read {','.join(COLUMNS)}")
    contours: list[list[list[float]]] = []
    last = ""
    for row in rows:
        if not any(cell.strip() for cell in row):
            continue
        try:
            label, *place = row
            point = [float(cell) for cell in place]
        except ValueError:
            raise InputError(f"{path}: line {rows.line_num} does not hold numbers") from None
        if len(point) != 3 or not all(abs(value) < float("inf") for value in point):
            raise InputError(f"{path}: line {rows.line_num} must hold a contour and three finite numbers")
        if label.strip() != last:
            contours.append([])
            last = label.strip()
        contours[-1].append(point)
    return [np.array(points) for points in contours]
