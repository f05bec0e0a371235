"""Results of a command in one folder: files and one JSON tree, written when nothing can fail but the disk."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder, write_atomic
from ascrcp.session.store import write_json


def check_folder(folder: Path) -> None:
    """Refuse a place that cannot become a folder.

    Raises:
        InputError: A file stands there.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: not a folder")


def write_folder(folder: Path, files: Mapping[str, bytes], json_name: str, tree: dict[str, Any]) -> None:
    """Write files and a tree, each whole or not at all; the folder is made.

    Raises:
        InputError: The disk refuses.
    """
    make_folder(folder)
    for name, data in files.items():
        write_atomic(folder / name, lambda file, data=data: file.write(data))  # type: ignore[misc]
    write_json(folder / json_name, tree)
