"""Joints that cannot turn slowly (7, 8): motion in pieces, each ended where it will have been enough.

Such a motor breaks away only beyond a certain drive and then turns no slower than its creep speed. A
reference slower than that is followed in a saw tooth: the joint waits until it is half a tooth behind,
turns until it is half a tooth ahead. When to end a piece is foreseen: what the valve still lets
through after the drive is gone is the drive's, and is learned from every piece. At rest a remainder
smaller than the smallest piece is taken up by one piece back and one forward.
"""

import math
from dataclasses import dataclass

from ascrcp.control.characteristic import Characteristic
from ascrcp.control.config import JointConfig
from ascrcp.control.joint import Want
from ascrcp.core.clock import CYCLE_S

_STILL = 2
"""Cycles after the foreseen end of motion until the joint is believed to stand (placeholder)."""

_BEHIND = 2.0
"""Half teeth behind which a joint that turns more slowly than believed is driven harder (placeholder)."""

_NEAR = 5.0
"""Half teeth within which a piece at rest is measured out beforehand (placeholder)."""

_BACK = 0.75
"""Share of the shortest piece below which a remainder needs a piece back first (placeholder)."""

_TRIES = 8
"""Pieces at rest after which the zone left alone is widened by itself (placeholder)."""

_LEARN = 0.1
"""Share of what a piece contradicts the foresight by that is learned (placeholder)."""


class StickSlipControl:
    """Pieces of motion below the creep speed, proportional drive above it.

    Attributes:
        position: Where the joint is believed to be [rad or m].
        start_drive: Drive of a piece, [down, up]; raised while pieces move nothing, lowered
            again while they move more than foreseen.
        tail: Time a piece goes on after its drive is gone, less the time it began late [s], [down, up].
    """

    def __init__(self, config: JointConfig) -> None:
        si, own = config.si, config.stick_slip
        up, down = config.full_speed
        self._characteristic = Characteristic(up * si, down * si, *config.dead_band)
        self._own = own
        self._creep = own.creep * si
        self._band = own.band * si
        self._zone = own.zone * si
        self._resolution = config.resolution * si
        self._still = _STILL + math.ceil(own.stop_s / CYCLE_S)
        self.start_drive = [own.drive, own.drive]
        self.tail = [own.tail_s, own.tail_s]
        self.position = 0.0
        self.clear()

    def clear(self) -> None:
        """Forget the past, keep what was learned of the drive."""
        self._piece = _Piece()
        self._sign = 0
        self._idle = self._still
        self._tries = 0
        self._back = False

    def drive(self, want: Want) -> float:
        """Compute the drive of this cycle; see JointControl."""
        self.position = want.measured
        if not (abs(want.target) < math.inf and abs(want.ahead) < math.inf):
            return math.nan
        if not want.obeyed:
            self.clear()  # what the machine does not do teaches nothing
        elif self._sign == 0:
            self._rest(want)
        elif want.wait or self._is_enough(want):
            self._sign, self._idle = 0, 0
        return self._piece_drive(want)  # not ramped: half a ramp would be no motion at all

    def _left(self, want: Want, later: float) -> float:
        """Error the reference will have run up, if the joint stood, some time from now."""
        return want.target + 0.5 * (want.speed + want.ahead) * later - want.measured

    def _rest(self, want: Want) -> None:
        """Once the joint stands, learn from the last piece and decide whether another begins."""
        self._idle += 1
        if self._idle < self._still or want.wait:
            return
        if self._idle == self._still and self._piece.cycles:
            self._learn(want)
        error = self._left(want, self._own.start_s)
        is_still = want.speed == 0.0 and want.ahead == 0.0
        sign = 1 if error > 0.0 else -1
        self._tries = self._tries if is_still else 0
        zone = self._zone * (1 + self._tries // _TRIES)  # no endless search for what it cannot do
        if abs(error) <= (zone if is_still else self._half_tooth(sign)):
            return
        self._tries += 1
        least = self._length(sign, self._own.cycles)
        self._back = is_still and abs(error) < _BACK * least and not self._back
        if self._back:
            self._begin(want, -sign, self._own.cycles + 1)
        else:
            is_measured = is_still and abs(error) < _NEAR * self._half_tooth(sign)
            self._begin(want, sign, self._cycles_for(abs(error), sign) if is_measured else 0)

    def _begin(self, want: Want, sign: int, planned: int) -> None:
        self._sign = sign
        self._piece = _Piece(sign, want.measured, planned)

    def _length(self, sign: int, cycles: int) -> float:
        """How far a piece of so many cycles turns the joint [rad or m]."""
        return self._creep * max(0.0, cycles * CYCLE_S + self.tail[1 if sign > 0 else 0])

    def _cycles_for(self, error: float, sign: int) -> int:
        return max(self._own.cycles, round((error / self._creep - self.tail[1 if sign > 0 else 0]) / CYCLE_S))

    def _is_enough(self, want: Want) -> bool:
        """Whether the piece under way may end: what it will have turned then is as much as is needed."""
        piece = self._piece
        if piece.cycles < max(piece.planned, self._own.cycles):
            return False
        if piece.planned:
            return True
        if self._wanted(want) * self._sign > self._creep:
            return False
        turned = self._sign * (want.measured - piece.begun_at)
        to_come = self._length(self._sign, piece.cycles) - turned
        to_come = max(0.0, min(to_come, self._creep * self._own.stop_s))
        left = self._sign * self._left(want, self._own.stop_s) - to_come
        # half a cycle's way before half a tooth: one cycle more would bring it no nearer
        return left <= 0.5 * self._creep * CYCLE_S - self._half_tooth(self._sign)

    def _half_tooth(self, sign: int) -> float:
        """Half of what a piece is meant to turn: at least half the shortest piece."""
        return max(self._band, 0.5 * self._length(sign, self._own.cycles))

    def _wanted(self, want: Want) -> float:
        """Speed a gentle joint would be given [rad/s or m/s]."""
        return (want.ahead + self._own.kp * self._left(want, 0.0)) / want.gain

    def _piece_drive(self, want: Want) -> float:
        if self._sign == 0:
            return 0.0
        piece = self._piece
        piece.cycles += 1
        drive = self.start_drive[1 if self._sign > 0 else 0]
        speed = self._wanted(want) * self._sign
        is_behind = self._sign * self._left(want, 0.0) > _BEHIND * self._band
        if not piece.planned and (speed > self._creep or is_behind):
            piece.was_slow = False
            drive = max(drive, abs(self._characteristic.drive(self._sign * max(speed, self._creep))))
        return self._sign * drive

    def _learn(self, want: Want) -> None:
        """Compare what the last piece turned with what was foreseen."""
        piece, own, up = self._piece, self._own, 1 if self._piece.sign > 0 else 0
        if not piece.was_slow:
            return
        turned = piece.sign * (want.measured - piece.begun_at)
        foreseen = self._length(piece.sign, piece.cycles)
        if turned < max(0.5 * self._resolution, 0.5 * foreseen):
            self.start_drive[up] = min(own.drive_max, self.start_drive[up] + own.drive_step)
            return
        surprise = (turned - foreseen) / self._creep
        if surprise > 0.0:
            self.start_drive[up] = max(own.drive, self.start_drive[up] - own.drive_step)
        self.tail[up] = max(-own.tail_max_s, min(own.tail_max_s, self.tail[up] + _LEARN * surprise))


@dataclass(slots=True)
class _Piece:
    """One piece of motion: direction, where it began, cycles planned (0: until enough) and given."""

    sign: int = 0
    begun_at: float = 0.0
    planned: int = 0
    cycles: int = 0
    was_slow: bool = True
