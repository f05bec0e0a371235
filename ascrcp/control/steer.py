"""Move the nozzle on the planned surface by the stick: deflection -> Sample, every 20 ms (thesis 6.1.2).

The stick's direction chooses along or across the passes, its deflection the speed. Stand-off and tilt are
those of the plan. Where the surface ends the nozzle comes to rest before the edge, or slides along it
to where it goes on in the wanted direction, and the status says which.
"""

import math
from enum import Enum
from typing import Protocol

import numpy as np
from ruckig import ControlInterface, InputParameter, OutputParameter, Ruckig

from ascrcp.control.reference import Sample
from ascrcp.control.steer_config import SteerConfig
from ascrcp.control.steer_surface import ON_ROW, Slopes, Spot, SteerSurface
from ascrcp.core.clock import CYCLE_S
from ascrcp.core.geometry import Array

EDGE_M = 0.02
"""Nearer to the edge than this the nozzle stands at it [m]."""

SEARCH_M = 1.5
"""How far along a pass a way across is looked for [m]."""

SHORTER = 5
"""How often a cycle's way is shortened before the nozzle stands for that cycle."""

TOLERATED = 0.05
"""Share of a joint's rate by which a cycle may exceed it: what rounding of the poses makes of a way."""

PROBE_M = 0.02
"""Way over which the joints' rates are measured [m]."""


class SteerStatus(Enum):
    """What the operator is told while steering; texts are (English, Chinese)."""

    FREE = ("On the planned surface.", "在规划面上。")
    EDGE = ("Edge of what can be reached: the nozzle stops here.", "已到可达边界：喷头在此停止。")
    SLIDING = ("Sliding along the edge.", "沿边界滑动。")
    SLOW = ("Slower here: a joint is at its speed limit.", "此处减速：某关节已达速度上限。")
    DEADMAN = ("Hold the enable key on the stick.", "请按住摇杆使能键。")
    CENTRE = ("Centre the stick, then hold the enable key.", "请先回中摇杆，再按住使能键。")
    LOST = ("The joystick is lost.", "摇杆信号丢失。")
    NEAR = ("Something is too near: move the other way.", "距离障碍过近：请反向移动。")
    LIMIT = ("A joint is at its limit: move the other way.", "关节已达限位：请反向移动。")


class Kernel(Protocol):
    """Whatever turns deflections into samples: steering on the plan, free jog, single-joint jog."""

    status: SteerStatus

    @property
    def point(self) -> int:
        """Planned point nearest to the nozzle, -1 if none."""
        ...

    def rest(self) -> None:
        """Stand at once."""
        ...

    def rejoin(self, q: Array) -> None:
        """Take up the arm where it stands, as far as the kernel may choose its place."""
        ...

    def sample(self) -> Sample:
        """Return the reference as it is now."""
        ...

    def step(self, x: float, y: float, scale: float, z: float = 0.0) -> Sample:
        """Advance one cycle by deflections -1..1, slowed down by a scale 0..1."""
        ...


def shape_stick(x: float, y: float, config: SteerConfig) -> tuple[float, float]:
    """Take out the dead zone and turn directions near an axis onto it; nothing for what is not finite."""
    size = math.hypot(x, y)
    if not size > config.dead_zone or not size < float("inf"):
        return 0.0, 0.0
    share = (min(size, 1.0) - config.dead_zone) / (1.0 - config.dead_zone)
    angle = math.atan2(y, x)
    quarter = 0.5 * math.pi * round(angle / (0.5 * math.pi))
    if abs(angle - quarter) <= math.radians(config.snap_deg):
        angle = quarter
    return _snap(share * math.cos(angle)), _snap(share * math.sin(angle))


def _snap(deflection: float) -> float:
    """Drop what rounding leaves of a cosine of 90 degrees."""
    return deflection if abs(deflection) > 1e-9 else 0.0


class Smooth:
    """Speeds that follow what is wanted within acceleration and jerk (ruckig, velocity control)."""

    def __init__(self, dofs: int, acceleration: float, jerk: float) -> None:
        self._otg = Ruckig(dofs, CYCLE_S)
        self._input = InputParameter(dofs)
        self._input.control_interface = ControlInterface.Velocity
        self._input.max_acceleration = [acceleration] * dofs
        self._input.max_jerk = [jerk] * dofs
        self._output = OutputParameter(dofs)
        self._dofs = dofs
        self.rest()

    def rest(self) -> None:
        """Stand at once."""
        self._input.current_position = [0.0] * self._dofs
        self._input.current_velocity = [0.0] * self._dofs
        self._input.current_acceleration = [0.0] * self._dofs

    def halt(self, axis: int) -> None:
        """Stand at once on one axis."""
        for name in ("current_velocity", "current_acceleration"):
            values = list(getattr(self._input, name))
            values[axis] = 0.0
            setattr(self._input, name, values)

    def step(self, wanted: list[float]) -> list[float]:
        """Return the speeds of this cycle."""
        self._input.target_velocity = wanted
        self._input.target_acceleration = [0.0] * self._dofs
        self._otg.update(self._input, self._output)
        self._output.pass_to_input(self._input)
        self._input.current_position = [0.0] * self._dofs
        return [float(v) for v in self._output.new_velocity]

    def limit(self, speeds: list[float]) -> None:
        """Have these speeds now, and no acceleration: something else decided."""
        self._input.current_velocity = speeds
        self._input.current_acceleration = [0.0] * self._dofs

    @property
    def speed(self) -> list[float]:
        """Speeds now."""
        return [float(v) for v in self._input.current_velocity]


def stopping_speed(distance: float, acceleration: float, jerk: float) -> float:
    """Return the speed from which one comes to rest within a distance [m], 0 for none.

    The way is v^2 / 2a and, until the deceleration has built up, v a / 2j.
    """
    if not distance > 0.0:
        return 0.0
    half = 0.5 * acceleration * acceleration / jerk
    return math.sqrt(half * half + 2.0 * acceleration * distance) - half


class Steering:
    """The nozzle on the surface, at rest or moving."""

    def __init__(self, surface: SteerSurface, config: SteerConfig, max_speed: Array) -> None:
        self._surface, self._config = surface, config
        self._max_rate = config.joint_share * np.asarray(max_speed)
        self._smooth = Smooth(2, config.acceleration_m_s2, config.jerk_m_s3)
        self.spot = Spot(0.0, 0.0)
        self.status = SteerStatus.FREE

    def begin(self, row: int, column: int) -> None:
        """Stand on a node."""
        self.spot = Spot(float(row), float(column))
        self._q, _ = self._surface.joints(self.spot)
        self.rest()

    def rejoin(self, q: Array) -> None:
        """Stay: the place is the plan's, and the arm comes back to it."""

    @property
    def point(self) -> int:
        """Planned point nearest to the nozzle, -1 if none."""
        return self._surface.nearest_point(self.spot)

    def rest(self) -> None:
        """Stand at once."""
        self._smooth.rest()
        self._speed = np.zeros_like(self._q)

    def sample(self) -> Sample:
        """Return the reference as it is now."""
        position, direction = self._surface.pose(self.spot)
        x, y, z = position.tolist()
        return Sample(
            q=tuple(self._q.tolist()),
            speed=tuple(self._speed.tolist()),
            position=(x, y, z),
            direction=tuple(direction.tolist()),
            spraying=False,
        )

    def step(self, x: float, y: float, scale: float, z: float = 0.0) -> Sample:
        """Advance one cycle.

        Args:
            x: Deflection along the pass, -1..1, positive to rising section angles.
            y: Deflection across the passes, positive to rising stations.
            scale: Pace 0..1, below 1 while the arm falls behind.
            z: Means nothing here: the stand-off is the plan's.
        """
        along, across = shape_stick(x, y, self._config)
        speed = self._config.speed_m_s * scale
        slopes = self._surface.slopes(self.spot)
        wanted = self._slide([speed * along, speed * across], slopes)
        wanted = self._within_rates(wanted, slopes)
        wanted = [self._before_edge(v, axis, slopes.of(axis, v)) for axis, v in enumerate(wanted)]
        moved = self._smooth.step(wanted)
        self._go(moved, slopes)
        return self.sample()

    def _go(self, speeds: list[float], slopes: Slopes) -> None:
        """Take one cycle's way; a part of it where a joint would have to be too fast."""
        start, before = self.spot, self._q
        for _ in range(SHORTER):
            for axis in (0, 1):
                self._advance(speeds[axis] * CYCLE_S, axis, slopes.of(axis, speeds[axis]))
            q, _ = self._surface.joints(self.spot)
            excess = float((np.abs(q - before) / (self._max_rate * CYCLE_S)).max())
            if not excess > 1.0 + TOLERATED:
                break
            speeds = [(1.0 - TOLERATED) * v / excess for v in speeds]
            self.spot = start
            self._smooth.limit(speeds)
        else:
            q = before
        self._q, self._speed = q, (q - before) / CYCLE_S

    def _advance(self, way: float, axis: int, slope: float) -> None:
        """Go a way [m] on one axis, no farther than the surface does."""
        if way == 0.0 or not slope > 0.0:
            return
        sign = 1 if way > 0.0 else -1
        free = self._free(axis, sign)
        step = min(abs(way) / slope, max(free, 0.0)) * sign
        if abs(way) / slope > free:
            self._smooth.halt(axis)
        spot = self.spot
        if axis == 0:
            self.spot = Spot(spot.row, spot.column + step)
            return
        row = spot.row + step  # the gap may be another beyond the next pass: land on it first
        edge = math.floor(spot.row) + 1 if sign > 0 else math.ceil(spot.row) - 1
        self.spot = Spot(_on_row(min(row, edge) if sign > 0 else max(row, edge)), spot.column)

    def _free(self, axis: int, sign: int) -> float:
        surface = self._surface
        return surface.free_along(self.spot, sign) if axis == 0 else surface.free_across(self.spot, sign)

    def _room(self, axis: int, speed: float, slopes: Slopes) -> float:
        """Return the way left before the edge on an axis, in the direction of a speed [m]."""
        return self._free(axis, 1 if speed > 0.0 else -1) * slopes.of(axis, speed)

    def _before_edge(self, speed: float, axis: int, slope: float) -> float:
        """Slow down so that the nozzle rests before the edge."""
        if speed == 0.0:
            return 0.0
        sign = 1 if speed > 0.0 else -1
        distance = max(0.0, self._free(axis, sign)) * slope - 0.25 * EDGE_M
        # the speed of this cycle is still travelled before a lower one takes effect
        distance -= abs(self._smooth.speed[axis]) * CYCLE_S
        most = stopping_speed(distance, 0.7 * self._config.acceleration_m_s2, self._config.jerk_m_s3)
        return sign * min(abs(speed), most)

    def _slide(self, wanted: list[float], slopes: Slopes) -> list[float]:
        """At an edge, go beside it to where the wanted direction goes on; say so."""
        self.status = SteerStatus.FREE
        for axis in (0, 1):
            speed = wanted[axis]
            if speed == 0.0:
                continue
            sign = 1 if speed > 0.0 else -1
            if self._room(axis, speed, slopes) > EDGE_M:
                continue
            self.status = SteerStatus.EDGE
            other = wanted[1 - axis]
            if other != 0.0 and self._room(1 - axis, other, slopes) > EDGE_M:
                self.status = SteerStatus.SLIDING
                return [0.0 if i == axis else v for i, v in enumerate(wanted)]
            side = self._way_round(sign) if axis == 0 else self._way_over(sign, slopes.along)
            if side:
                self.status = SteerStatus.SLIDING
                return [side * abs(speed) if i != axis else 0.0 for i in (0, 1)]
        return wanted

    def _way_round(self, sign: int) -> int:
        """Between two passes at an edge along them: which pass goes on, -1 lower, 1 upper, 0 neither."""
        spot = self.spot
        if abs(spot.row - round(spot.row)) <= ON_ROW:
            return 0
        low, high = self._surface.rows_beside(spot)
        best, side = math.inf, 0
        for row, towards in ((low, -1), (high, 1)):
            if self._surface.free_along(Spot(float(row), spot.column), sign) < 1.0:
                continue
            if abs(row - spot.row) < best:
                best, side = abs(row - spot.row), towards
        return side

    def _way_over(self, sign: int, slope: float) -> int:
        """On a pass with no way across: in which direction along it the nearest one lies, 0 for none."""
        spot, surface = self.spot, self._surface
        found = []
        for towards in (1, -1):
            reach = min(surface.free_along(spot, towards), SEARCH_M / max(slope, 1e-6))
            column = math.floor(spot.column) if towards < 0 else math.ceil(spot.column)
            while abs(column - spot.column) <= reach:
                if surface.free_across(Spot(spot.row, float(column)), sign) > 0.0:
                    found.append((abs(column - spot.column), towards))
                    break
                column += towards
        return min(found)[1] if found else 0

    def _within_rates(self, wanted: list[float], slopes: Slopes) -> list[float]:
        """Slow down so that no joint need exceed its rate, here and where the nozzle could still stop."""
        speed = math.hypot(*wanted)
        now = math.hypot(*self._smooth.speed)
        if speed == 0.0:
            return wanted
        unit = [v / speed for v in wanted]
        ahead = now * now / (2.0 * self._config.acceleration_m_s2) + PROBE_M
        most = min(self._fastest(unit, slopes, way) for way in (0.0, 0.5 * ahead, ahead))
        if most >= speed:
            return wanted
        if self.status is SteerStatus.FREE and most < 0.5 * speed:
            self.status = SteerStatus.SLOW
        return [v * most / speed for v in wanted]

    def _fastest(self, unit: list[float], slopes: Slopes, way: float) -> float:
        """Return the fastest nozzle speed the joints allow a way ahead [m/s], infinite off the surface."""
        a, b = (self._along(unit, slopes, w) for w in (way, way + PROBE_M))
        if not (self._surface.is_free(a) and self._surface.is_free(b)):
            return math.inf
        rate = np.abs(self._surface.mesh_joints(b) - self._surface.mesh_joints(a)) / PROBE_M
        return float((self._max_rate / np.maximum(rate, 1e-9)).min())

    def _along(self, unit: list[float], slopes: Slopes, way: float) -> Spot:
        column, row = self.spot.column, self.spot.row
        rows, columns = self._surface.plan.node.shape
        for axis in (0, 1):
            slope = slopes.of(axis, unit[axis])
            step = unit[axis] * way / slope if slope > 0.0 else 0.0
            column, row = (column + step, row) if axis == 0 else (column, row + step)
        return Spot(_on_row(min(max(row, 0.0), rows - 1.0)), min(max(column, 0.0), columns - 1.0))


def _on_row(row: float) -> float:
    """Let a place very near to a pass stand on it."""
    return float(round(row)) if abs(row - round(row)) <= ON_ROW else row
