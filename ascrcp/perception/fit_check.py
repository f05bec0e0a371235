"""Refuse what is no tunnel of the profile: a fit's cover, arc, share, spread and taper."""

import numpy as np

from ascrcp.core.errors import RecognitionError
from ascrcp.core.profile import Profile
from ascrcp.perception.fit import Fit
from ascrcp.perception.parameter import AxisParameters

_MAX_BEYOND = 0.3  # deep overbreak is a few per cent; the corners of a square room half of it; placeholder
_MIN_COMPACT = 0.6  # placeholder
_MIN_ARC = 0.5  # less of the arc does not hold the axis in place: one side wall is a third; placeholder


def check_fit(fit: Fit, profile: Profile, parameters: AxisParameters) -> None:
    """Refuse what is no tunnel of this profile.

    Raises:
        RecognitionError: Saying which condition fails.
    """
    name = profile.name
    if not fit.cover >= 1.0:
        raise RecognitionError(
            f"no tunnel found: only {fit.cover:.1f} m of wall fit profile {name}, at least 1 m is needed"
        )
    if not fit.arc >= _MIN_ARC:
        raise RecognitionError(
            f"no tunnel found: wall is seen over {100 * fit.arc:.0f} % of the arc of profile {name} only, "
            f"at least {100 * _MIN_ARC:.0f} % are needed to place the axis"
        )
    if not fit.share >= parameters.min_share:
        raise RecognitionError(
            f"no tunnel found: only {100 * fit.share:.0f} % of the points lie on profile {name}, "
            f"at least {100 * parameters.min_share:.0f} % are needed; is it another tunnel's profile?"
        )
    if not fit.beyond <= _MAX_BEYOND:
        raise RecognitionError(
            f"no tunnel found: {100 * fit.beyond:.0f} % of the points about profile {name} lie far outside "
            f"it, at most {100 * _MAX_BEYOND:.0f} % are believed; is it another tunnel's profile?"
        )
    if not fit.compact >= _MIN_COMPACT:
        raise RecognitionError(
            f"no tunnel found: points near profile {name} are scattered, only {100 * fit.compact:.0f} % of "
            f"the cells hold one surface, at least {100 * _MIN_COMPACT:.0f} % are needed"
        )
    taper = _taper(fit)
    if not taper <= parameters.max_taper:
        raise RecognitionError(
            f"no tunnel found: what fits profile {name} widens by {taper:.2f} m per metre along the axis, "
            f"allowed {parameters.max_taper:g}"
        )


def _taper(fit: Fit) -> float:
    """Median slope of the rings' offset, inner and outer rings apart."""
    slopes = []
    for outer in (False, True):
        mine = fit.ring_outer == outer
        station, offset = fit.ring_station[mine], fit.ring_offset[mine]
        if len(station) > 3:
            ds = station[3:] - station[:-3]
            slopes.append(np.abs(offset[3:] - offset[:-3])[ds < 0.6] / ds[ds < 0.6])
    every = np.concatenate(slopes) if slopes else np.zeros(0)
    return float(np.median(every)) if len(every) else np.inf
