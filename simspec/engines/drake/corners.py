"""Small shapes within a shape, so that faces and edges have several points of contact.

Drake has one point of contact for each pair of geometries: a box on a floor stands on one of its corners, and turns about it.
What is put in touches the shape's surface from within, and gives a point of its own where it is under the other's: balls in
the corners of boxes and along the rims of cylinders, a thin disc at each end of a cylinder, which lies on both, and the two
round ends of a capsule, which are its own. In each corner of the hull of a mesh there is a ball for every three faces that
meet there, which touches these.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simspec.world.hull import hull_of, vertices_of
from simspec.world.inset import inset

RADIUS = 1e-4
"""Of the balls (m), where the shape is not smaller: how far points of contact are inside the edges."""
SHARE = 0.05
"""Of the shape's smallest size, at most."""
RIM = 8
"""Balls on each rim of a cylinder."""
MOST_CORNERS = 48
"""Balls in a hull. Where more would fit, these are far from each other; where it tips over another corner, the hull's own point
of contact is there."""

ROUND_OFF = 1e-13
"""Share of the largest coordinate of a centre below which another is what a rotation left of 0."""

FACED = ("box", "plane")
"""Kinds of shapes that touch each other by hydroelastic contact, where that is asked for. Cylinders do not: their meshes are
prisms, on which they roll 10 % short of a circle's way with 64 edges and 12 % with 256, and 40 times slower (measured)."""
ANY_RESOLUTION = 1.0
"""Drake's resolution hint (m) of boxes and planes, whose meshes do not depend on it."""

Part = tuple[str, tuple[float, ...], tuple[float, float, float]]
"""The kind, size and centre, in the shape's frame and along its axes."""


def corners(kind: str, size: Sequence[float]) -> list[Part]:
    """What is put into a shape."""
    if kind == "box":
        radius = min(RADIUS, SHARE * min(size))
        x, y, z = (edge / 2.0 - radius for edge in size)
        signs = itertools.product((-1.0, 1.0), repeat=3)
        return [("sphere", (radius,), (a * x, b * y, c * z)) for a, b, c in signs]
    if kind == "cylinder":
        radius = min(RADIUS, SHARE * min(size))
        out, up = size[0] - radius, size[1] / 2.0 - radius
        turns = [2.0 * math.pi * index / RIM for index in range(RIM)]
        rims = [("sphere", (radius,), (out * math.cos(a), out * math.sin(a), z)) for z in (-up, up) for a in turns]
        return [*rims, *(("cylinder", (size[0], 2.0 * radius), (0.0, 0.0, z)) for z in (-up, up))]
    if kind == "capsule":
        return [("sphere", (size[0],), (0.0, 0.0, z)) for z in (-size[1] / 2.0, size[1] / 2.0)]
    if kind == "mesh":
        radius = min(RADIUS, SHARE * 2.0 * float(hull_of(size).offsets.min()))
        centres = spread(vertices_of(inset(tuple(size), radius)))
        return [("sphere", (radius,), (x, y, z)) for x, y, z in centres.tolist()]
    return []


def held_at(place: Sequence[float]) -> tuple[float, ...]:
    """A centre in its body's frame, without what round-off of the shape's pose left of coordinates that are 0."""
    least = ROUND_OFF * max(map(abs, place))
    return tuple(value if abs(value) > least else 0.0 for value in place)


def reach_of(place: Sequence[float]) -> float:
    """How far a shape is from its body's origin: the round-off of a centre in the body's frame is of this size, and the centre
    itself may be anything smaller."""
    return max(map(abs, place))


def spread(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most ``MOST_CORNERS`` of ``points`` (n, 3), in their order: the one that is furthest from the origin, and then again
    and again the one that is furthest from those that are taken."""
    if len(points) <= MOST_CORNERS:
        return points
    taken = [int(np.argmax(np.linalg.norm(points, axis=1)))]
    away = np.full(len(points), np.inf)
    while len(taken) < MOST_CORNERS:
        away = np.minimum(away, np.linalg.norm(points - points[taken[-1]], axis=1))
        taken.append(int(np.argmax(away)))
    chosen: NDArray[np.float64] = points[np.sort(np.array(taken))]
    return chosen


def hydroelastic(settings: Mapping[str, Any]) -> bool:
    """Whether faces touch by hydroelastic contact, not by what is put into shapes; the setting is left out where it is off."""
    return bool(settings.get("hydroelastic_faces", False))
