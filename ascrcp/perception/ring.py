"""The middle plane of one arch, which leans and may be skew."""

from dataclasses import dataclass

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile

_AROUND = 50  # places round the profile at which two arches are compared


@dataclass(frozen=True)
class Ring:
    """The middle plane of one arch: station = station + lean * z + skew * y, in the tunnel frame.

    Attributes:
        station: Where the plane meets the axis [m].
        lean: Metres of station per metre of height.
        skew: Metres of station per metre to the left.
        width: Along the axis [m].
        along: First and last arc length at which it was seen [m].
    """

    station: float
    lean: float
    skew: float
    width: float
    along: tuple[float, float]

    def distance(self, station: Array, yz: Array) -> Array:
        """Signed distance along the axis from the plane [m], shape (n,)."""
        return station - self.station - self.lean * yz[:, 1] - self.skew * yz[:, 0]


def gap(ring: Ring, other: Ring, profile: Profile) -> Array:
    """Distance along the axis between two rings' middles, evenly round the profile [m], shape (k,)."""
    yz = profile.point(np.linspace(0.0, profile.length, _AROUND), profile.arch_line)
    origin = np.zeros(len(yz))
    return np.asarray(np.abs(ring.distance(origin, yz) - other.distance(origin, yz)))
