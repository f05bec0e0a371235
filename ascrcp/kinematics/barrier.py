"""Push a chain of joint vectors away from what it would come near: the clearance part of smoothing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ascrcp.core.geometry import Array
from ascrcp.kinematics.arm import Arm
from ascrcp.kinematics.capsule import Body, make_body
from ascrcp.kinematics.clearance import ROUGH_SPREAD
from ascrcp.kinematics.kernel_call import as_rows, by_halves, kernel
from ascrcp.kinematics.obstacle import Obstacles


@dataclass(frozen=True)
class Sight:
    """How near every link of every joint vector is.

    Attributes:
        distance: From each capsule's surface to the surroundings [m], rough beyond what pushes, (n, c).
        centre: The sample of its axis that is nearest, base frame [m], shape (n, c, 3).
    """

    distance: Array
    centre: Array

    def pick(self, rows: NDArray[np.int64]) -> "Sight":
        """Return what some of the joint vectors see."""
        return Sight(self.distance[rows], self.centre[rows])

    def put(self, rows: NDArray[np.int64], other: "Sight") -> None:
        """Replace what some of the joint vectors see, in place."""
        self.distance[rows], self.centre[rows] = other.distance, other.centre


@dataclass(frozen=True)
class Barrier:
    """A soft wall: the squared depth of every link below a distance, times a weight.

    Attributes:
        arm: The arm.
        body: Its capsules, sparsely sampled.
        obstacles: The surroundings.
        soft: Distance below which it pushes [m].
        weight: Cost of a squared metre.
    """

    arm: Arm
    body: Body
    obstacles: Obstacles
    soft: float
    weight: float

    def look(self, q: Array) -> Sight:
        """Measure every link at joint vectors (n, joints)."""
        scene, find = self.obstacles.around(self.body), kernel("clearance").find_links
        found = by_halves(lambda rows: find(scene, rows, self.soft), as_rows(q))
        return Sight(*found[:2])

    def cost(self, sight: Sight, emphasis: Array) -> Array:
        """Cost of each joint vector; emphasis (n, c) multiplies the weight; shape (n,)."""
        depth = np.maximum(self.soft - sight.distance, 0.0)
        return np.asarray((self.weight * emphasis * depth**2).sum(axis=1))

    def terms(self, q: Array, sight: Sight, emphasis: Array) -> tuple[Array, Array]:
        """Linearise the cost: half its second derivative (n, joints, joints) and gradient (n, joints)."""
        scene, find = self.obstacles.around(self.body), kernel("clearance").find_push
        found: tuple[Array, Array] = by_halves(
            lambda *rows: find(scene, *rows, self.soft),
            *(as_rows(q), sight.distance, sight.centre, self.weight * emphasis),
        )
        return found


def make_barrier(arm: Arm, obstacles: Obstacles) -> Barrier:
    """Take the weights of a machine; its clearance model made the obstacles, so it has one."""
    model = arm.description.clearance
    assert model is not None
    return Barrier(arm, make_body(arm, ROUGH_SPREAD), obstacles, model.soft, model.weight)


def no_emphasis(barrier: Barrier, n: int) -> Array:
    """Emphasis one for every link of n joint vectors."""
    return np.ones((n, len(barrier.body.names)))
