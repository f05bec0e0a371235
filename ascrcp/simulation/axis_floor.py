"""How well any method could know the axis of bare rock: the Cramer-Rao bound of arches and blocks."""

import numpy as np

from ascrcp.core.geometry import Array
from ascrcp.core.profile import Profile
from ascrcp.simulation.heading import HeadingTruth
from ascrcp.simulation.tunnel import TunnelConfig
from ascrcp.simulation.tunnel_arch import ERROR_LENGTH

_ROCK_CELL = 0.25  # patches of rock, small beside its blocks [m]
_LEAST_ERROR = 1e-4  # steel is bent no truer than this [m]; keeps the bound finite


def direction_floor_deg(truth: HeadingTruth, config: TunnelConfig) -> float:
    """Compute the least standard deviation of the axis' direction, yaw and pitch together [deg].

    An unbiased method that sees arches and rock of the unsprayed part without noise and knows both
    lines, the roughness and every lean still does not know how far each segment of steel was bent and
    each block of rock broke off. Roughness counts by its spectrum at long waves, rms squared times
    wavelength, as blocks of that length independent of each other have.

    Args:
        truth: The heading.
        config: What it was drawn from.
    """
    profile, (first, last) = truth.profile, truth.unsprayed
    information = np.zeros((4, 4))
    along = np.arange(0.5 * _ROCK_CELL, profile.length, _ROCK_CELL)
    height = profile.point(along)[:, 1] - profile.point(along)[:, 1].max()
    error = max(config.arches.radial_error, _LEAST_ERROR)
    for arch in truth.arches:
        station = arch.station + np.tan(np.radians(arch.lean_deg)) * height
        variance = error**2 * ERROR_LENGTH / _ROCK_CELL
        information += _information(profile, along, station - first, variance)
    spectrum = sum((octave.rms * octave.wavelength) ** 2 for octave in config.rock.roughness)
    for station in np.arange(first + 0.5 * _ROCK_CELL, last, _ROCK_CELL):
        information += _information(
            profile, along, np.full(len(along), station - first), spectrum / _ROCK_CELL**2
        )
    spread = np.linalg.inv(information)
    return float(np.degrees(np.sqrt(spread[2, 2] + spread[3, 3])))


def _information(profile: Profile, along: Array, lever: Array, variance: float) -> Array:
    """Information about (dy, dz, yaw, pitch) in offsets at some places, shape (4, 4)."""
    normal = profile.normal(along)
    design = np.column_stack([normal, normal * lever[:, None]])
    return np.asarray(design.T @ design / variance)
