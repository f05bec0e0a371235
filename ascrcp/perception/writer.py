"""Write the labelled cloud as binary PLY that any viewer shows in colour: Surface -> file."""

from pathlib import Path

import numpy as np

from ascrcp.core.file import write_atomic
from ascrcp.core.flow import Label, Surface

# calm greys for what is normal, colour for findings (ISA-101)
COLOURS: dict[Label, tuple[int, int, int]] = {
    Label.OTHER: (110, 110, 110),
    Label.SPRAYED: (170, 170, 175),
    Label.BAY: (150, 180, 205),
    Label.ARCH: (240, 150, 40),
    Label.OVERBREAK: (205, 45, 60),
    Label.GROUND: (95, 85, 75),
    Label.FACE: (130, 120, 150),
}
_ROW = np.dtype([("xyz", "<f4", 3), ("label", "u1"), ("rgb", "u1", 3)])


def write_labelled_cloud(path: Path, surface: Surface) -> None:
    """Write points, labels and their colours; the file appears whole or not at all.

    Args:
        path: File to write, usually cloud.ply in the round folder.
        surface: Recognised heading.

    Raises:
        InputError: If the folder cannot be written to.
    """
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment labels: {' '.join(f'{label.value}={label.name.lower()}' for label in Label)}\n"
        f"element vertex {len(surface.points)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar label\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    rows = np.empty(len(surface.points), dtype=_ROW)
    rows["xyz"] = surface.points
    rows["label"] = surface.labels
    palette = np.zeros((256, 3), dtype=np.uint8)
    for label, colour in COLOURS.items():
        palette[label] = colour
    rows["rgb"] = palette[surface.labels]
    write_atomic(path, lambda file: file.write(header.encode("ascii") + rows.tobytes()))
