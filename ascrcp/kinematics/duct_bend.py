"""Ducts with an S-bend for trials: parameters -> contours square to the axis (errata 3.3)."""

from typing import Annotated

import numpy as np
from msgspec import Meta

from ascrcp.core.config import Struct
from ascrcp.core.geometry import unit
from ascrcp.kinematics.duct import Duct

Metres = Annotated[float, Meta(ge=-100.0, le=100.0)]
Count = Annotated[int, Meta(ge=2, le=2000)]


class Bend(Struct):
    """An elliptic duct whose axis runs along z and steps aside by a quintic.

    Attributes:
        width, height: Axes of the ellipse along x and y [m].
        aside: How far the axis ends in x and y [m].
        bend: z where the step begins and ends [m].
        span: z of the first and the last contour [m].
        contours, points: Number of contours and of points in each.
    """

    width: Annotated[float, Meta(gt=0.0, le=100.0)]
    height: Annotated[float, Meta(gt=0.0, le=100.0)]
    aside: tuple[Metres, Metres]
    bend: tuple[Metres, Metres]
    span: tuple[Metres, Metres]
    contours: Count
    points: Annotated[int, Meta(ge=8, le=2000)]


def make_bend(name: str, bend: Bend) -> Duct:
    """Make the contours of a bend."""
    z = np.linspace(*bend.span, bend.contours)
    length = bend.bend[1] - bend.bend[0]
    t = np.clip((z - bend.bend[0]) / length, 0.0, 1.0)[:, None]
    aside = np.array(bend.aside)
    centre = np.column_stack([aside * (10 * t**3 - 15 * t**4 + 6 * t**5), z])
    slope = aside * (30 * t**2 - 60 * t**3 + 30 * t**4) / length
    axis = unit(np.column_stack([slope, np.ones(len(z))]))
    wide = unit(np.array([1.0, 0.0, 0.0]) - axis[:, :1] * axis)
    high = np.cross(axis, wide)
    angle = 2 * np.pi * np.arange(bend.points)[:, None] / bend.points
    along, across = bend.width / 2 * np.cos(angle), bend.height / 2 * np.sin(angle)
    return Duct.from_contours(name, centre[:, None] + along * wide[:, None] + across * high[:, None])


def draw_bend(bend: Bend, rng: np.random.Generator) -> tuple[Bend, float]:
    """Draw a bend and a stand-off [m] like those of errata 3.4: other offsets, length and stand-off."""
    aside = (float(rng.uniform(0.8, 1.2)), float(rng.uniform(0.3, 0.7)))
    length = float(rng.uniform(2.8, 3.3))
    drawn = Bend(
        width=bend.width,
        height=bend.height,
        aside=aside,
        bend=(bend.bend[1] - length, bend.bend[1]),
        span=bend.span,
        contours=bend.contours,
        points=bend.points,
    )
    return drawn, float(rng.uniform(0.20, 0.26))
