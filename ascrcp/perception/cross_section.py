"""The section at any station: the wall beside the design line, as a surveyor draws it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.errors import InputError
from ascrcp.core.flow import Surface
from ascrcp.core.geometry import Array


@dataclass(frozen=True)
class CrossSection:
    """The wall in one plane across the axis.

    Attributes:
        station: Where [m].
        along: Arc length along the design line [m], shape (k,).
        offset: Outward from the design line [m], NaN where unknown, shape (k,).
        filled: Whether the wall was in shadow there and filled in, shape (k,).
        yz: The wall in the section plane, left and up of the axis [m], NaN where unknown, shape (k, 2).
        area_beyond: Area between design line and wall where the wall lies outside [m2].
        area_inside: Area of rock inside the design line [m2].
    """

    station: float
    along: Array
    offset: Array
    filled: NDArray[np.bool_]
    yz: Array
    area_beyond: float
    area_inside: float


def cut_section(surface: Surface, station: float) -> CrossSection:
    """Cut the unrolled wall at a station, interpolating between its rows.

    Raises:
        InputError: A station outside the wall that was recognised.
    """
    rows = surface.station
    half = float(rows[1] - rows[0]) / 2
    if not rows[0] - half <= station <= rows[-1] + half:
        raise InputError(
            f"station {station:g} m, allowed {rows[0] - half:.2f}..{rows[-1] + half:.2f} m (the wall seen)"
        )
    upper = int(np.clip(np.searchsorted(rows, station), 1, len(rows) - 1))
    share = float(np.clip((station - rows[upper - 1]) / (2 * half), 0.0, 1.0))
    low, high = surface.offset[upper - 1].astype(float), surface.offset[upper].astype(float)
    offset = low + (high - low) * share
    offset = np.where(np.isnan(offset), low if share < 0.5 else high, offset)
    filled = surface.filled[upper - 1] if share < 0.5 else surface.filled[upper]
    profile, step = surface.profile, float(surface.along[1] - surface.along[0])
    radius_share = np.linalg.norm(
        profile.point(surface.along + step / 4, offset) - profile.point(surface.along - step / 4, offset),
        axis=-1,
    ) / (step / 2)
    # a trapezium: as wide as the design line at one end, as the wall at the other
    area = np.nan_to_num(offset * step * (1.0 + radius_share) / 2)
    return CrossSection(
        station=float(station),
        along=surface.along,
        offset=offset,
        filled=filled,
        yz=profile.point(surface.along, offset),
        area_beyond=float(area[area > 0].sum()),
        area_inside=float(-area[area < 0].sum()),
    )
