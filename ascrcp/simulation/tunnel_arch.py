"""The steel arches of the simulated tunnel: stations and lean -> H sections swept round the profile."""

import numpy as np

from ascrcp.core.flow import Arch
from ascrcp.core.profile import Profile
from ascrcp.simulation.tunnel import ArchesConfig, Octave, draw
from ascrcp.simulation.tunnel_mesh import Mesh, rough, sweep

ARCH_STEP = 0.10  # chord of an arch's mesh [m]: 0.2 mm off a 5.9 m arc
ERROR_LENGTH = 2.5  # wavelength of its deviation: about the length of one rolled segment [m]


def draw_arches(
    config: ArchesConfig, rng: np.random.Generator, profile: Profile, part: tuple[float, float], floor: float
) -> list[Arch]:
    """Place the arches by rising station; those that do not fit the unsprayed part are left out."""
    stations = list(config.stations)
    if not stations:
        gaps = [draw(rng, config.first if i == 0 else config.spacing) for i in range(config.count)]
        stations = list(part[0] + np.cumsum(gaps))
    along = np.linspace(0.0, profile.length, 1000)
    standing = profile.point(along, profile.arch_line)[:, 1] >= floor
    span = np.degrees(profile.angle(along[standing]))
    return [
        Arch(station, config.width, draw(rng, config.lean_deg), (float(span.min()), float(span.max())))
        for station in map(float, sorted(stations))
        if part[0] < station < part[1] - config.width
    ]


def build_arch(config: ArchesConfig, arch: Arch, rng: np.random.Generator, profile: Profile) -> list[Mesh]:
    """Sweep inner flange, web and outer flange round the profile; lean turns about the crown."""
    along = np.linspace(0.0, profile.length, int(profile.length / ARCH_STEP) + 2)
    error = rough(rng, along, np.zeros(1), [Octave(wavelength=ERROR_LENGTH, rms=config.radial_error)])
    crown = profile.point(along)[:, 1].max()
    own = rng.spawn(1)[0]  # so that arches set aside keep the deviations they had
    aside = np.array([draw(own, config.aside), draw(own, config.aside)])
    half, thin, depth = arch.width / 2, config.flange, config.depth
    bars = (
        (half, 0.0, thin),
        (thin / 2, thin, depth - thin),
        (half, depth - thin, depth),
    )
    meshes = []
    for reach, inner, outer in bars:
        corners = []
        for ds, off in ((-reach, inner), (reach, inner), (reach, outer), (-reach, outer)):
            yz = profile.point(along, profile.arch_line + error + off) + aside
            s = arch.station + ds + np.tan(np.radians(arch.lean_deg)) * (yz[:, 1] - crown)
            corners.append(np.column_stack([s, yz]))
        meshes.append(sweep(np.stack(corners, axis=1)))
    return meshes
