"""Play between the side of a joint that its sensor sees and the side that moves the arm.

The encoder of a slewing ring sits at its pinion. The ring follows half the play behind, on the side it was
last driven from: 0.03 deg, 6.5 mm at 12.5 m. So the pinion is sent half the play ahead, and passes
through the play at a speed of its own when the direction changes.
"""

from ascrcp.core.clock import CYCLE_S


class Play:
    """How far the sensor's side of a joint is to be ahead of the arm's.

    Attributes:
        offset: Distance now [rad or m].
        rate: Its speed in this cycle [rad/s or m/s].
    """

    def __init__(self, play: float, speed: float, rest_speed: float) -> None:
        """Prepare.

        Args:
            play: In all [rad or m].
            speed: At which it is passed through [rad/s or m/s].
            rest_speed: Speed of the reference below which a direction is not believed.
        """
        self._half = 0.5 * play
        self._step = speed * CYCLE_S
        self._rest_speed = rest_speed
        self._side = 0.0  # unknown until the joint has moved
        self.offset = self.rate = 0.0

    def update(self, speed: float) -> None:
        """Live through one cycle in which the reference moves at a speed [rad/s or m/s]."""
        if abs(speed) > self._rest_speed:
            self._side = self._half if speed > 0.0 else -self._half
        change = max(-self._step, min(self._step, self._side - self.offset))
        self.offset += change
        self.rate = change / CYCLE_S
