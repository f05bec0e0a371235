"""Label the points: what each point of the cloud was taken for (thesis figure 3-20)."""

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.flow import Label
from ascrcp.core.profile import Profile
from ascrcp.perception.parameter import SectionParameters
from ascrcp.perception.raster import Unrolled
from ascrcp.perception.ring import Ring
from ascrcp.perception.section import Extent, is_wall
from ascrcp.perception.wall import Wall, is_arch

_FACE_ROUGH = 0.4  # the face lies within this of its middle [m]; placeholder


def label_points(
    flat: Unrolled,
    extent: Extent,
    rings: list[Ring],
    wall: Wall,
    overbreak: NDArray[np.bool_],
    profile: Profile,
    parameters: SectionParameters,
) -> NDArray[np.uint8]:
    """Label points above the floor.

    Args:
        flat: The points.
        extent: Sprayed edge and face.
        rings: Arches.
        wall: Unrolled wall, for its raster.
        overbreak: Cells of the wall that belong to an overbreak region, shape (ns, na).
        profile: Design profile.
        parameters: The wall band.

    Returns:
        `Label` of each point, shape (n,).
    """
    labels = np.full(len(flat), Label.OTHER, dtype=np.uint8)
    band = is_wall(flat, profile, parameters)
    unsprayed = band & (flat.station > extent.sprayed_end) & (flat.station < extent.end)
    labels[band & (flat.station <= extent.sprayed_end)] = Label.SPRAYED
    labels[unsprayed] = Label.BAY
    cells = np.append(overbreak.ravel(), False)
    index = wall.raster.index(flat.station, flat.along)
    labels[unsprayed & cells[index] & (flat.offset > profile.overbreak_line)] = Label.OVERBREAK
    labels[unsprayed & is_arch(flat, rings, profile)] = Label.ARCH
    if extent.face is not None:
        inside = flat.offset < profile.arch_line - parameters.inside
        labels[inside & (np.abs(flat.station - extent.face) < _FACE_ROUGH)] = Label.FACE
    return labels
