"""One generated heading to be sprayed: scanned, planned, driven, sprayed by the simulated jet and judged."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ascrcp.app import Simulation
from ascrcp.core.flow import Cloud, JointSequence, Scan, SprayPath
from ascrcp.core.geometry import Array, angle_between, apply_transform, inverse_transform
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.look import find_look_pose
from ascrcp.kinematics.obstacle import Obstacles
from ascrcp.kinematics.path import solve_path
from ascrcp.perception.parameter import load_parameters as load_perception
from ascrcp.perception.profile_line import curvature
from ascrcp.perception.project import project
from ascrcp.perception.recognise import recognise
from ascrcp.planning.parameter import Parameters, change
from ascrcp.planning.path import plan as plan_thesis
from ascrcp.planning.pump import fill_flow
from ascrcp.planning.spray_plan import SprayPlan, replan
from ascrcp.planning.target import ARCH_DEPTH_M, Target, find_target, mean_finish
from ascrcp.planning.timing import time_path
from ascrcp.planning.wall import fit_wall
from ascrcp.simulation.bare_wall import lay_bare, sample
from ascrcp.simulation.deposition import Grown, Sprayer
from ascrcp.simulation.heading import Heading, build_heading
from ascrcp.simulation.lidar_model import LidarModel

HIT_STEPS = 4  # to find where a jet meets the wall; the wall is nearly square to it
MET_M = 0.005  # cells that get less are beside the spray, not under it; placeholder
SCANS, JET = 1, 1000  # streams of chance beside the heading's own
PAN_STEP_DEG = 0.4  # coarser than the machine's sweep: a third of its points, for time


@dataclass(frozen=True)
class Finish:
    """How far patches are from the wanted surface [m], outward (too thin) positive, and their areas [m2]."""

    value: Array
    area: Array

    def within(self, tolerance: float) -> float:
        """Share of the area within a tolerance."""
        return float(self.area[np.abs(self.value) <= tolerance].sum() / self.area.sum())

    @property
    def deviation(self) -> float:
        """Standard deviation [m]."""
        mean = np.average(self.value, weights=self.area)
        return float(np.sqrt(np.average((self.value - mean) ** 2, weights=self.area)))


class Site:
    """One heading with its true wall, scanned and recognised."""

    def __init__(self, arm: Arm, seed: int, parameters: Parameters, simulation: Simulation) -> None:
        self.arm, self.seed, self.parameters, self.simulation = arm, seed, parameters, simulation
        tunnel = change(simulation.tunnel, bodies=[])
        self.heading = build_heading(tunnel, np.random.default_rng(seed))
        self.surface = recognise(self.scan(self.heading, 0), self.heading.truth.profile, load_perception())
        self.bare = lay_bare(self.heading, simulation.jet.cell_m, ARCH_DEPTH_M)
        self.truth = self._find_truth()

    def scan(self, heading: Heading, number: int, q: Array | None = None) -> Cloud:
        """Scan from the zero pose or another; every scan has noise of its own."""
        q = self.arm.zero_pose if q is None else q
        config = self.simulation.lidar
        lidar, rng = LidarModel(config, heading), np.random.default_rng([self.seed, SCANS + number])
        mount = self.arm.lidar(q)
        pan = np.radians(np.arange(-90.0, 90.0, PAN_STEP_DEG))
        ranges = np.array([lidar.measure(mount, angle, rng) for angle in pan], dtype=np.float32)
        return project(Scan(ranges, config.beam, pan, q), mount)

    def scan_again(self, heading: Heading, obstacles: Obstacles, number: int) -> NDArray[np.float32]:
        """Scan after spraying from the zero pose, and from further in if there is room.

        The job's poses besides are measured, its arm sags and its scans are thinned and registered.

        Args:
            heading: As it stands.
            obstacles: What the arm must not touch on its way.
            number: Of the further scan, from 0; each has noise of its own.
        """
        pose = find_look_pose(self.arm, obstacles, self.surface)
        clouds = [self.scan(heading, 2 * number + 1).points]
        if pose is not None:
            clouds.append(self.scan(heading, 2 * number + 2, pose).points)
        return np.concatenate(clouds)

    def sprayer(self) -> Sprayer:
        """Return a fresh wall with a jet drawn from the heading's seed."""
        rng = np.random.default_rng([self.seed, JET])
        return Sprayer(self.bare, self.simulation.jet, rng, self.simulation.growth)

    def spray(self, sprayer: Sprayer, sequence: JointSequence) -> Grown:
        """Spray a sequence onto what the sprayer has laid before."""
        pump = self.parameters.process.spray.pump_m3_s
        return sprayer.spray(sequence, self.heading.truth.axis.T_base_tunnel, pump)

    def _find_truth(self) -> Target:
        """Return present and wanted surface of the true wall: nothing of it is known to the planner."""
        true, none = self.heading.truth, self.surface.points[:0]
        surface = replace(
            self.surface,
            axis=true.axis,
            unsprayed=true.unsprayed,
            arches=true.arches,
            station=self.bare.station,
            along=self.bare.along,
            offset=self.bare.rock.astype(np.float32),
            filled=np.zeros(self.bare.rock.shape, dtype=bool),
            points=none,
            labels=self.surface.labels[:0],
        )
        path = self.parameters.path
        self.wall = replace(fit_wall(surface, path), floor_z=self._floor_z())
        return find_target(surface, self.wall, self.parameters.process, path.bridge_m)

    def find_poses(self, path: SprayPath) -> tuple[Array, Array]:
        """Measure planned nozzles against the true wall, smoothed as the planner smooths.

        Returns:
            Distance to the wall along the spray direction [m], and angle between that direction and the
            wall's normal tilted by theta2 [rad], both (n,).
        """
        profile = self.truth.profile
        T = inverse_transform(self.heading.truth.axis.T_base_tunnel)
        nozzle, direction = apply_transform(T, path.position), path.direction @ T[:3, :3].T
        reach = np.full(len(nozzle), self.parameters.path.stand_off_m)
        for _ in range(HIT_STEPS):
            hit = nozzle + reach[:, None] * direction
            along, offset = profile.locate(hit[:, 1:])
            short = self.wall.sample(self.wall.offset, hit[:, 0], along) - offset
            reach = reach + short / np.maximum((direction[:, 1:] * profile.normal(along)).sum(axis=1), 0.3)
        limit = np.radians(self.parameters.path.normal_limit_deg)
        normal = self.wall.normal(hit[:, 0], along, limit)
        tilt = np.sin(path.theta2)[:, None]
        wanted = np.column_stack([np.cos(path.theta2), tilt * normal])
        return reach, angle_between(direction, wanted)

    def judge(self, plan: SprayPlan, grown: Grown, seen_only: bool) -> Finish:
        """Average the true wall's distance from the wanted surface over patches that can be reached.

        Args:
            plan: Tells what it says it can cover.
            grown: What was laid.
            seen_only: Leave out what the first scan did not see.
        """
        truth, process = self.truth, self.parameters.process
        layer = np.where(truth.arch, self._on_truth(grown.flange), self._on_truth(grown.rock))
        mask = self.judged(plan, seen_only)
        finish = mean_finish(truth.offset - layer - truth.wanted, mask, truth, process.target.patch_m)
        ok = np.isfinite(finish)
        return Finish(finish[ok], truth.area[ok])

    def judged(self, plan: SprayPlan, seen_only: bool) -> NDArray[np.bool_]:
        """Mark what is judged: to be sprayed, reachable, not beneath flanges, not in the corners."""
        truth, corner = self.truth, self.parameters.process.target.corner_m
        first, last = self.heading.truth.unsprayed
        face = np.interp(truth.along, self.bare.along, np.nan_to_num(self.bare.face, posinf=1e3))
        row = truth.station[:, None]
        mask = (
            truth.inside & ~truth.beneath & (row > first + corner) & (row < np.minimum(last, face) - corner)
        )
        mask &= ~self._is_buried(corner)
        station, along = (x.ravel() for x in np.meshgrid(truth.station, truth.along, indexing="ij"))
        reach = plan.target.sample(plan.exposed.astype(float), station, along) > 0.5
        mask &= reach.reshape(mask.shape)
        return mask & (self._is_seen(station, along).reshape(mask.shape) | truth.arch) if seen_only else mask

    def wanted(self, plan: SprayPlan, grown: Grown) -> float:
        """Concrete wanted wherever the plan sprays, corners too [m3].

        Beneath flanges it is what fills the rock up to the wanted surface: no jet gets to all of it.
        """
        truth = self.truth
        station, along = (x.ravel() for x in np.meshgrid(truth.station, truth.along, indexing="ij"))
        met = plan.target.sample((plan.growth > MET_M).astype(float), station, along) > 0.5
        beneath = self._on_truth(np.isfinite(self.bare.flange).astype(float))
        beside = truth.volume(truth.thickness) * np.where(truth.arch, 1.0, 1.0 - beneath)
        return float(beside[met.reshape(truth.arch.shape) & truth.inside].sum()) + self.filled_beneath(grown)

    def filled_beneath(self, grown: Grown) -> float:
        """Concrete on the rock beneath flanges that lies before the wanted surface [m3]."""
        bare, target = self.bare, self.parameters.process.target
        room = np.maximum(bare.rock - target.line_m, target.cover_rock_m)
        layer = np.where(np.isfinite(bare.flange), np.minimum(grown.rock, room), 0.0)
        cell = (bare.station[1] - bare.station[0]) * (bare.along[1] - bare.along[0])
        bend = curvature(bare.profile, bare.along)
        return float((layer * (1.0 + bend * (bare.rock - layer / 2.0))).sum() * cell)

    def _on_truth(self, grid: Array) -> Array:
        """Read a grid of the bare wall at the cells of the truth, shape of the truth's."""
        truth, bare = self.truth, self.bare
        row = (truth.station - bare.station[0]) / (bare.station[1] - bare.station[0])
        column = (truth.along - bare.along[0]) / (bare.along[1] - bare.along[0])
        place = (x.ravel() for x in np.meshgrid(row, column, indexing="ij"))
        return sample(grid, *place).reshape(truth.offset.shape)

    def _floor_z(self) -> float:
        """Height of the true floor in the section plane [m]."""
        T = self.heading.truth.axis.T_base_tunnel
        middle = T[:3, 3] + np.mean(self.heading.truth.unsprayed) * T[:3, 0]
        return float((self.heading.truth.floor_z - middle[2]) / T[2, 2])

    def _is_buried(self, corner: float) -> NDArray[np.bool_]:
        """Mark cells of the truth before which floor or muck stand, or nearer than a corner [m] to them."""
        bare, truth = self.bare, self.truth
        step = (bare.station[1] - bare.station[0], bare.along[1] - bare.along[0])
        near = distance_transform_edt(~bare.buried, sampling=step) <= corner
        row = np.clip(np.rint((truth.station - bare.station[0]) / step[0]), 0, len(bare.station) - 1)
        column = np.clip(np.rint((truth.along - bare.along[0]) / step[1]), 0, len(bare.along) - 1)
        return np.asarray(near[np.ix_(row.astype(np.int64), column.astype(np.int64))])

    def _is_seen(self, station: Array, along: Array) -> NDArray[np.bool_]:
        s = self.surface
        row = np.rint((station - s.station[0]) / (s.station[1] - s.station[0])).astype(np.int64)
        column = np.rint((along - s.along[0]) / (s.along[1] - s.along[0])).astype(np.int64)
        row, column = np.clip(row, 0, len(s.station) - 1), np.clip(column, 0, len(s.along) - 1)
        return np.asarray(~s.filled[row, column] & np.isfinite(s.offset[row, column]))


def drive(site: Site, plan: SprayPlan, obstacles: Obstacles) -> tuple[SprayPlan, JointSequence, int]:
    """Solve and time a plan as the job does; return it as driven, its rows, and the points reached."""
    p, arm = site.parameters, site.arm
    found = solve_path(arm, plan.path, arm.zero_pose, obstacles=obstacles)
    driven = replan(plan.layout, site.surface, found.path, found.solved, p.process)
    timed = time_path(arm, driven.path, found.q, found.break_before, p.timing, obstacles)
    return driven, fill_flow(timed.sequence, driven.path, p.process.spray), int(found.solved.sum())


def drive_thesis(site: Site, obstacles: Obstacles, volume: float) -> JointSequence:
    """Drive the thesis's path at one speed with one flow, that which pumps a given volume [m3]."""
    p, arm = site.parameters, site.arm
    path = plan_thesis(site.surface, p.path)
    found = solve_path(arm, path, arm.zero_pose, obstacles=obstacles)
    sequence = time_path(arm, found.path, found.q, found.break_before, p.timing, obstacles).sequence
    spraying = float(np.diff(sequence.t)[sequence.spraying[:-1]].sum())
    share = volume / (spraying * p.process.spray.pump_m3_s)
    # a constant speed that much slower lays the same: the flow cannot exceed the pump's largest
    stretch = max(1.0, share)
    flow = np.where(sequence.spraying, share / stretch, 0.0)
    return replace(sequence, t=sequence.t * stretch, flow=flow)
