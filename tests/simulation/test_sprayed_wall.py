"""The simulated spray: nothing is lost unaccounted, it lands where it aims, and a second scan sees it."""

import numpy as np
import pytest

from ascrcp.core.config import load
from ascrcp.core.flow import JointSequence
from ascrcp.core.geometry import apply_transform
from ascrcp.core.paths import CONFIG
from ascrcp.simulation.bare_wall import Bare, grow_heading, lay_bare
from ascrcp.simulation.deposition import DepositionConfig, Grown, Sprayer
from ascrcp.simulation.fresh import GrowthConfig
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.tunnel import TunnelConfig

PUMP = 20.0 / 3600.0
OVERLAY = {"bodies": [], "pockets": {"count": 1}, "arches": {"count": 1}, "length": {"rear": -3.0}}


@pytest.fixture(scope="module")
def heading() -> Heading:
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, OVERLAY)
    return build_heading(tunnel, np.random.default_rng(3))


@pytest.fixture(scope="module")
def bare(heading: Heading) -> Bare:
    return lay_bare(heading, 0.05, 0.15)


def config(**overlay: object) -> DepositionConfig:
    return load(CONFIG / "simulation" / "deposition.yaml", DepositionConfig, overlay)


def sprayer_of(bare: Bare, seed: int = 1, growth: dict[str, object] | None = None, **jet: object) -> Sprayer:
    """A jet with parameters of its own; what it lays stays up unless it is told otherwise."""
    holds = {"fall_wall_m": [9.0, 9.0], "fall_crown_m": [9.0, 9.0]} if growth is None else growth
    falls = load(CONFIG / "simulation" / "growth.yaml", GrowthConfig, holds)
    return Sprayer(bare, config(**jet), np.random.default_rng(seed), falls)


def aim(
    heading: Heading, station: float, phi_deg: float, seconds: float, flow: float = 1.0, tilt_deg: float = 0.0
) -> JointSequence:
    """Stand 1 m before a place of the wall and spray it squarely, or tilted along the tunnel."""
    T, phi, tilt = heading.truth.axis.T_base_tunnel, np.radians(phi_deg), np.radians(tilt_deg)
    outward = np.array([0.0, -np.cos(phi), np.sin(phi)])
    centre = np.array([station, 0.0, 0.0]) + 5.9 * outward
    outward = np.cos(tilt) * outward + np.sin(tilt) * np.array([1.0, 0.0, 0.0])
    place = apply_transform(T, (centre - outward)[None])
    t = np.array([0.0, seconds, seconds + 5.0])
    return JointSequence(
        t=t,
        q=np.zeros((3, 8)),
        position=np.tile(place, (3, 1)),
        direction=np.tile(T[:3, :3] @ outward, (3, 1)),
        point=np.full(3, -1),
        spraying=np.array([True, False, False]),
        flow=np.array([flow, 0.0, 0.0]),
    )


def test_the_bare_wall_is_the_rock_alone_and_knows_what_buries_it(heading: Heading, bare: Bare) -> None:
    """Against the same rock without its arch, and against the floor's height."""
    tunnel = load(CONFIG / "simulation" / "tunnel.yaml", TunnelConfig, {**OVERLAY, "arches": {"count": 0}})
    plain = lay_bare(build_heading(tunnel, np.random.default_rng(3)), 0.05, 0.15)
    np.testing.assert_allclose(bare.rock, plain.rock, atol=1e-6)
    assert not np.isfinite(plain.flange).any()
    beside = np.abs(bare.station[:, None] - heading.truth.arches[0].station) < 0.6
    assert np.isfinite(bare.flange).any() and not np.isfinite(bare.flange[~beside.ravel()]).any()
    T = heading.truth.axis.T_base_tunnel
    middle = T[:3, 3] + np.mean(heading.truth.unsprayed) * T[:3, 0]
    height = bare.profile.point(bare.along)[:, 1] - (heading.truth.floor_z - middle[2]) / T[2, 2]
    first, last = heading.truth.unsprayed
    # rock beside the arch, before the muck at the face
    wall = (bare.station > first + 0.1) & (bare.station < last - 1.6) & ~np.isfinite(bare.flange).any(axis=1)
    assert bare.buried[wall][:, (height > -0.2) & (height < -0.1)].mean() > 0.95
    assert not bare.buried[wall][:, height > 0.15].any()


def test_every_drop_is_accounted_for(heading: Heading, bare: Bare) -> None:
    sprayer = sprayer_of(bare, 1)
    station = heading.truth.arches[0].station - 0.12
    grown = sprayer.spray(aim(heading, station, 60.0, 6.0, 0.5), heading.truth.axis.T_base_tunnel, PUMP)
    assert grown.pumped == pytest.approx(6.0 * 0.5 * PUMP, rel=0.03)
    cell = (bare.station[1] - bare.station[0]) * (bare.along[1] - bare.along[0])
    radius = bare.profile.arcs[0].radius
    rock = (grown.rock * (1.0 + bare.rock / radius)).sum() * cell
    flange = (grown.flange * (1.0 + np.nan_to_num(bare.flange) / radius)).sum() * cell
    kept = rock + flange + grown.behind + grown.rebound + grown.missed
    assert kept == pytest.approx(grown.pumped, rel=0.02)
    assert flange > 0.02 * grown.pumped and 0.15 < grown.rebound / grown.pumped < 0.45


def test_the_layer_lies_where_the_nozzle_aims(heading: Heading, bare: Bare) -> None:
    station = heading.truth.unsprayed[0] + 0.5
    sprayer = sprayer_of(bare, aim_error_m=0.0, deviation_m=[0.1, 0.1])
    grown = sprayer.spray(aim(heading, station, 100.0, 3.0), heading.truth.axis.T_base_tunnel, PUMP)
    weight = grown.rock / grown.rock.sum()
    middle = (weight.sum(axis=1) * bare.station).sum()
    assert middle == pytest.approx(station, abs=0.03)
    phi = np.degrees(bare.profile.angle(bare.along))
    assert (weight.sum(axis=0) * phi).sum() == pytest.approx(100.0, abs=0.5)
    spread = np.sqrt((weight.sum(axis=1) * (bare.station - middle) ** 2).sum())
    assert spread == pytest.approx(0.10, abs=0.03)


def test_the_pump_lags_and_nothing_flows_before(heading: Heading, bare: Bare) -> None:
    slow = sprayer_of(bare, pump_lag_s=[3.0, 3.0])
    fast = sprayer_of(bare, pump_lag_s=[0.05, 0.05])
    T = heading.truth.axis.T_base_tunnel
    short = aim(heading, heading.truth.unsprayed[0] + 0.5, 100.0, 1.0)
    a, b = (s.spray(short, T, PUMP).pumped for s in (slow, fast))
    assert a < 0.85 * b


def spray(sprayer: Sprayer, heading: Heading, bare: Bare, **how: float) -> tuple[Grown, float]:
    """Spray a smooth part of the wall; return what it did and how wide the layer lies along the axis [m]."""
    before = sprayer.grown.rock.copy()
    where = {"station": heading.truth.unsprayed[0] + 0.45, "phi_deg": 60.0, "seconds": 3.0, **how}
    grown = sprayer.spray(aim(heading, **where), heading.truth.axis.T_base_tunnel, PUMP)
    weight = (grown.rock - before).sum(axis=1)
    middle = np.average(bare.station, weights=weight)
    return grown, float(np.sqrt(np.average((bare.station - middle) ** 2, weights=weight)))


def test_rebound_is_what_was_drawn_and_grows_with_the_angle(heading: Heading, bare: Bare) -> None:
    plain = {"rebound_wall": [0.1, 0.1], "rebound_crown": [0.4, 0.4]}

    def lost(angle: float, **how: float) -> float:
        grown, _ = spray(sprayer_of(bare, rebound_angle=[angle, angle], **plain), heading, bare, **how)
        return grown.rebound / grown.pumped

    assert lost(0.0, phi_deg=0.0) == pytest.approx(0.1, abs=0.01)
    assert lost(0.0, phi_deg=90.0) == pytest.approx(0.4, abs=0.01)
    oblique = lost(0.6, phi_deg=10.0, tilt_deg=40.0) - lost(0.0, phi_deg=10.0, tilt_deg=40.0)
    assert oblique == pytest.approx(0.6 * np.sin(np.radians(40.0)) ** 2, abs=0.08)
    assert lost(0.6, phi_deg=10.0) - lost(0.0, phi_deg=10.0) < 0.5 * oblique


def test_what_makes_the_jet_worse_can_be_made_worse(heading: Heading, bare: Bare) -> None:
    exact = {"aim_error_m": 0.0, "deviation_m": [0.1, 0.1], "pump_gain": [1.0, 1.0], "pack_m": 0.0}
    one, width = spray(sprayer_of(bare, **exact), heading, bare)
    more, _ = spray(sprayer_of(bare, **(exact | {"pump_gain": [1.3, 1.3]})), heading, bare)
    assert more.pumped == pytest.approx(1.3 * one.pumped)
    _, packed = spray(sprayer_of(bare, **(exact | {"pack_m": 0.12})), heading, bare)
    assert packed**2 - width**2 == pytest.approx(0.12**2, rel=0.2)
    _, wandering = spray(
        sprayer_of(bare, **(exact | {"aim_error_m": 0.25, "aim_wander_s": 0.3})), heading, bare, seconds=20.0
    )
    assert wandering > 1.2 * width
    _, cut = spray(sprayer_of(bare, **(exact | {"cut_sigma": 1.0})), heading, bare)
    assert cut < 0.8 * width


def test_the_jet_meets_the_wall_as_it_has_grown(heading: Heading, bare: Bare) -> None:
    """A wall that has come half a metre nearer catches a narrower jet."""
    sprayer = sprayer_of(bare, aim_error_m=0.0, pack_m=0.0)
    _, width = spray(sprayer, heading, bare, seconds=1.0)
    grown, _ = spray(sprayer, heading, bare, seconds=12.0)
    assert grown.rock.max() > 0.4
    _, narrow = spray(sprayer, heading, bare, seconds=1.0)
    assert narrow < 0.85 * width


def test_what_hangs_too_thick_falls(heading: Heading, bare: Bare) -> None:
    weak = {"fall_wall_m": [0.1, 0.1], "fall_crown_m": [0.1, 0.1], "set_s": [1e3, 1e3]}
    grown, _ = spray(sprayer_of(bare, growth=weak), heading, bare, seconds=8.0, phi_deg=90.0)
    whole, _ = spray(sprayer_of(bare), heading, bare, seconds=8.0, phi_deg=90.0)
    assert grown.fallen > 0.005 and whole.fallen == 0.0
    assert whole.rock.sum() > 1.2 * grown.rock.sum()


def test_same_seed_same_wall(heading: Heading, bare: Bare) -> None:
    one = aim(heading, heading.truth.unsprayed[0] + 0.6, 70.0, 2.0)
    T = heading.truth.axis.T_base_tunnel
    a, b = (sprayer_of(bare, 5).spray(one, T, PUMP) for _ in range(2))
    assert a.rock.tobytes() == b.rock.tobytes() and a.rebound == b.rebound


def test_a_second_look_finds_the_layer(heading: Heading, bare: Bare) -> None:
    layer = np.full(bare.rock.shape, 0.05)
    moved = grow_heading(heading, bare, layer, np.where(np.isfinite(bare.flange), 0.02, 0.0))
    again = lay_bare(moved, 0.05, 0.15)
    first = heading.truth.unsprayed[0]
    on = (bare.station[:, None] > first + 0.2) & (bare.station[:, None] < bare.face - 0.3)
    on = on & np.isnan(bare.flange) & np.isnan(again.flange)
    assert np.median((bare.rock - again.rock)[on]) == pytest.approx(0.05, abs=0.003)
    both = np.isfinite(bare.flange) & np.isfinite(again.flange)
    assert np.median((bare.flange - again.flange)[both]) == pytest.approx(0.02, abs=0.003)
