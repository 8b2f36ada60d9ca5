"""Small shapes within a shape, so that faces and edges have several points of contact.

Drake has one point of contact for each pair of geometries: a box on a floor stands on one of its corners, and turns about it.
What is put in touches the shape's surface from within, and gives a point of its own where it is under the other's: balls in
the corners of boxes and along the rims of cylinders, a thin disc at each end of a cylinder, which lies on both, and the two
round ends of a capsule, which are its own. Balls in the corners of the hull of a mesh are so small that they need not be within.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

RADIUS = 1e-4
"""Of the balls (m), where the shape is not smaller: how far points of contact are inside the edges."""
SHARE = 0.05
"""Of the shape's smallest size, at most."""
RIM = 8
"""Balls on each rim of a cylinder."""
POINT = 1e-7
"""Radius of the balls in the corners of a hull (m), how far they stand out. Drake tells how deep a ball of that size is in a box,
a plane or a hull to 1e-9 of the depth, from 1e-9 m to 1 mm (measured)."""
MOST_CORNERS = 32
"""Balls in a hull. Where it has more corners, these are far from each other; where it tips over another, the hull's own point of
contact is there."""

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
        return [("sphere", (POINT,), (x, y, z)) for x, y, z in spread(np.array(size).reshape(-1, 3)).tolist()]
    return []


def spread(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """At most ``MOST_CORNERS`` of ``points`` (n, 3), in their order: the one that is furthest from the origin, and then again and
    again the one that is furthest from those that are taken."""
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
