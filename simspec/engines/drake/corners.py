"""Small balls in the corners of shapes, so that faces have several points of contact.

Drake has one point of contact for each pair of geometries: a box on a floor stands on one of its corners, and turns about it.
Balls that touch the shape's surface from within give a point for each corner that is under the other's surface, at the same
depth as the corner itself but for ``RADIUS`` (√3 − 1) on an edge.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

RADIUS = 1e-4
"""Of the balls (m), where the shape is not smaller: how far points of contact are inside the edges."""
SHARE = 0.05
"""Of the shape's smallest size, at most."""
RIM = 8
"""Balls on each rim of a cylinder."""

Ball = tuple[tuple[float, float, float], float]


def corners(kind: str, size: Sequence[float]) -> list[Ball]:
    """Centre and radius of the balls of a shape, in its frame. A capsule has its own two ends."""
    if kind == "box":
        radius = min(RADIUS, SHARE * min(size))
        reach = [edge / 2.0 - radius for edge in size]
        return [
            ((x * reach[0], y * reach[1], z * reach[2]), radius) for x, y, z in itertools.product((-1.0, 1.0), repeat=3)
        ]
    if kind == "cylinder":
        radius = min(RADIUS, SHARE * min(size))
        out, up = size[0] - radius, size[1] / 2.0 - radius
        turns = [2.0 * math.pi * index / RIM for index in range(RIM)]
        return [((out * math.cos(a), out * math.sin(a), z), radius) for z in (-up, up) for a in turns]
    if kind == "capsule":
        return [((0.0, 0.0, z), size[0]) for z in (-size[1] / 2.0, size[1] / 2.0)]
    return []
