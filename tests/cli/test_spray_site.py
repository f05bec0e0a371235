"""The judge of `bench planning`: what was laid by hand is judged as what it is."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from ascrcp.app import load_simulation
from ascrcp.cli import bench_planning
from ascrcp.cli.spray_site import Site, drive
from ascrcp.kinematics.arm import load_arm
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.planning.parameter import change, load_parameters
from ascrcp.planning.spray_plan import SprayPlan, plan_spray
from ascrcp.simulation.deposition import Grown

PARAMETERS = load_parameters()
SMALL = {
    "tunnel": {
        "length": {"rear": -3.0, "unsprayed_length": [1.6, 1.7]},
        "arches": {"count": 1, "first": [0.7, 0.8]},
        "pockets": {"count": 1, "angle_deg": [40.0, 140.0]},
        "bumps": {"count": 0},
    }
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    overlay = tmp_path_factory.mktemp("rig") / "small.yaml"
    overlay.write_text(yaml.safe_dump(SMALL))
    return Site(load_arm("kc"), 12, PARAMETERS, load_simulation(overlay))


@pytest.fixture(scope="module")
def plan(site: Site) -> SprayPlan:
    return plan_spray(site.surface, PARAMETERS.path, PARAMETERS.process)


def laid(site: Site, short_m: float) -> Grown:
    """The wall brought to the wanted surface but for a lack [m], arches too."""
    truth, bare = site.truth, site.bare
    S, A = (x.ravel() for x in np.meshgrid(bare.station, bare.along, indexing="ij"))
    wanted = truth.sample(np.where(truth.arch, 0.0, truth.wanted), S, A).reshape(bare.rock.shape)
    rock = np.maximum(bare.rock - wanted - short_m, 0.0)
    cover = PARAMETERS.process.target.cover_arch_m
    flange = np.where(np.isfinite(bare.flange), cover - short_m, 0.0)
    return Grown(rock, flange)


@pytest.mark.parametrize("short_mm", [0.0, 15.0, 25.0])
def test_a_lack_is_judged_as_what_it_is(site: Site, plan: SprayPlan, short_mm: float) -> None:
    finish = site.judge(plan, laid(site, short_mm / 1e3), True)
    assert finish.area.sum() > 0.6 * site.truth.area[site.truth.inside].sum()
    assert 1e3 * np.average(finish.value, weights=finish.area) == pytest.approx(short_mm, abs=2.0)
    assert finish.deviation < 0.006
    share = finish.within(0.02)
    assert share < 0.2 if short_mm > 20.0 else share > 0.95


def test_one_thin_patch_is_found_and_its_size(site: Site, plan: SprayPlan) -> None:
    grown, bare = laid(site, 0.0), site.bare
    middle = float(np.mean(site.heading.truth.unsprayed)) + 0.35
    near = (np.abs(bare.station[:, None] - middle) < 0.2) & (np.abs(bare.along - 14.0) < 0.2)
    thin = replace(grown, rock=grown.rock - 0.05 * near)
    even, found = (site.judge(plan, one, True) for one in (grown, thin))
    assert found.value.max() == pytest.approx(0.05, abs=0.01) and even.value.max() < 0.03
    assert found.area[found.value > 0.04].sum() < 0.1


def test_what_fills_rock_beneath_flanges_counts_to_the_line_and_no_further(
    site: Site, plan: SprayPlan
) -> None:
    none = Grown(np.zeros(site.bare.rock.shape), np.zeros(site.bare.rock.shape))
    full, over, more = laid(site, 0.0), laid(site, -0.5), laid(site, -1.0)
    assert site.filled_beneath(none) == 0.0
    assert site.filled_beneath(over) == pytest.approx(site.filled_beneath(more))
    assert site.filled_beneath(full) == pytest.approx(site.filled_beneath(over), rel=0.2)
    beside = site.wanted(plan, none)
    assert site.wanted(plan, full) == pytest.approx(beside + site.filled_beneath(full))
    assert 0.5 < beside / site.truth.volume(site.truth.thickness)[site.truth.inside].sum() < 1.0


def test_a_bent_model_believes_another_rebound(site: Site, plan: SprayPlan) -> None:
    obstacles = Obstacles.from_surface(site.surface, site.arm)
    driven, sequence, _ = drive(site, plan, obstacles)

    def bent(rebound: float) -> float:
        process = PARAMETERS.process
        other = change(process, rebound=change(process.rebound, wall=rebound, crown=rebound))
        made = bench_planning.bend_growth(site, driven, sequence, other)
        return float(made.sum())

    assert bent(0.1) > 1.3 * bent(0.4)
