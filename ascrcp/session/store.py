"""Keep scan, surface and summaries of a round: checked NumPy archives and JSON."""

import struct
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ascrcp.core.config import convert
from ascrcp.core.errors import InputError
from ascrcp.core.file import write_atomic
from ascrcp.core.flow import Arch, Axis, Bay, Overbreak, Scan, Surface
from ascrcp.core.profile import Profile

VERSION = 1
MAX_BYTES = 2_000_000_000  # faults.md, security: a cloud is capped at 2 GB

# what zipfile, zlib and NumPy raise on a damaged archive
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    KeyError,
    ValueError,
    TypeError,
    EOFError,
    RuntimeError,
    AttributeError,
    msgspec.DecodeError,
)


_ENCODER = msgspec.json.Encoder(enc_hook=lambda value: value.tolist())


def encode_json(tree: Any) -> bytes:
    """Encode plain values, NumPy's own numbers and arrays among them; NaN becomes null."""
    return _ENCODER.encode(tree)


def write_json(path: Path, tree: Any) -> None:
    """Write plain values as indented JSON, whole or not at all."""
    data = msgspec.json.format(encode_json(tree), indent=1)
    write_atomic(path, lambda file: file.write(data + b"\n"))


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
        InputError: Missing, unreadable or not JSON.
    """
    try:
        return msgspec.json.decode(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: not JSON: {error}") from None


def write_archive(path: Path, kind: str, meta: Any, arrays: dict[str, Any]) -> None:
    """Write arrays with a small JSON head as a NumPy archive, whole or not at all."""
    head = encode_json({"format": f"ascrcp-{kind}", "version": VERSION, "meta": meta})
    columns: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    columns["head"] = np.frombuffer(head, np.uint8)
    write_atomic(path, lambda file: np.savez(file, **columns))


def read_archive(path: Path, kind: str, names: tuple[str, ...]) -> tuple[Any, dict[str, Any]]:
    """Read an archive of ours; the zip container's CRC-32 per member finds flipped bits."""
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(info.file_size for info in archive.infolist()) > MAX_BYTES:
                raise InputError(f"{path}: larger than {MAX_BYTES} bytes unpacked")
            broken = archive.testzip()
            if broken is not None:
                raise InputError(f"{path}: {broken} is corrupt (checksum)")
        with np.load(path, allow_pickle=False) as archive:
            head = msgspec.json.decode(archive["head"].tobytes())
            if head.get("format") != f"ascrcp-{kind}" or head.get("version") != VERSION:
                raise InputError(f"{path}: not an ascrcp-{kind} file of version {VERSION}")
            return head["meta"], {name: archive[name] for name in names}
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except _DAMAGE as error:
        raise InputError(f"{path}: not a readable ascrcp-{kind} file: {error}") from None


def write_scan(path: Path, scan: Scan) -> None:
    """Keep a raw scan."""
    arrays = {name: getattr(scan, name) for name in ("ranges", "beam", "pan", "q")}
    write_archive(path, "scan", {"complete": scan.complete}, arrays)


def read_scan(path: Path) -> Scan:
    """Read a raw scan back.

    Raises:
        InputError: Missing, cut, flipped or of another kind.
    """
    meta, arrays = read_archive(path, "scan", ("ranges", "beam", "pan", "q"))
    return Scan(**arrays, complete=bool(meta["complete"]))


_SURFACE_ARRAYS = ("station", "along", "offset", "filled", "points", "labels")


class _SurfaceMeta(msgspec.Struct):
    axis: dict[str, Any]
    profile: Any
    unsprayed: tuple[float, float]
    arches: list[Arch]
    overbreak: list[Overbreak]
    bays: list[Bay]


def write_surface(path: Path, surface: Surface) -> None:
    """Keep a recognised surface."""
    axis = asdict(surface.axis)
    axis |= {"point": surface.axis.point.tolist(), "direction": surface.axis.direction.tolist()}
    meta = {
        "axis": axis,
        "profile": msgspec.to_builtins(surface.profile),
        "unsprayed": surface.unsprayed,
        "arches": surface.arches,
        "overbreak": surface.overbreak,
        "bays": surface.bays,
    }
    write_archive(path, "surface", meta, {name: getattr(surface, name) for name in _SURFACE_ARRAYS})


def read_surface(path: Path) -> Surface:
    """Read a recognised surface back.

    Raises:
        InputError: Missing, cut, flipped or of another kind.
    """
    tree, arrays = read_archive(path, "surface", _SURFACE_ARRAYS)
    try:
        meta = msgspec.convert(tree, _SurfaceMeta)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: surface description: {error}") from None
    axis = dict(meta.axis)
    axis |= {
        "point": np.array(axis["point"]),
        "direction": np.array(axis["direction"]),
        "evidence": tuple(axis["evidence"]),
    }
    return Surface(
        axis=Axis(**axis),
        profile=convert(meta.profile, Profile, f"{path}: profile"),
        unsprayed=meta.unsprayed,
        arches=tuple(meta.arches),
        overbreak=tuple(meta.overbreak),
        bays=tuple(meta.bays),
        **arrays,
    )
