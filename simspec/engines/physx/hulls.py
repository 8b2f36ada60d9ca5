"""Which convex hulls PhysX holds: it makes a hull of the points anew, and leaves corners out without a word.

A corner stays where it reaches further beyond the hull of the others than ``OUT`` of the sum of the hull's extents along its
axes; more than ``MOST_FACES`` faces are made fewer. Measured with SAPIEN 3.0.3 in 24 sizes and proportions, where the share is
3.5e-4 in each, and in 1,500 random hulls of 5 to 140 points: none that these two rules let pass lost a corner, and 1 % of those
that they refuse would have kept all. Runs outside the engine's process, without PhysX.
"""

from __future__ import annotations

import functools

import numpy as np

from simspec.support.declarations import Refinement, not_here
from simspec.world.hull import FlatError, closed_triangles, hull, hull_of, vertices_of
from simspec.world.meeting import solid_shapes
from simspec.world.types import World

OUT = 3.6e-4
"""A little above the measured 3.5e-4."""
LEAST_OUT = 7e-7
"""m: the least that a corner must reach beyond the others, 7e-4 of PhysX's unit of length."""
MOST_FACES, MOST_CORNERS = 255, 255
"""Of one of PhysX's hulls. A surface of triangles alone has 255 faces with 129 corners."""
DIGITS = 6
"""After the point of a normal, and of a share of the extent: by which triangles are in one face."""
KEPT = 256
"""Hulls of which the answer is remembered."""


def hulls_held(world: World) -> Refinement | None:
    """Not a world with a hull of which PhysX would leave corners out."""
    for body in world.bodies:
        for shape in solid_shapes(body):
            if shape.kind == "mesh" and (why := left_out(shape.size)):
                return not_here(f"{why} ({shape.name!r}); `max_vertices` of the mesh reduces it")
    return None


@functools.lru_cache(maxsize=KEPT)
def left_out(size: tuple[float, ...]) -> str | None:
    """Why PhysX would not hold a hull (flat vertices, m) as it is; None where it does."""
    vertices = vertices_of(size)
    if len(vertices) > MOST_CORNERS:
        return f"PhysX holds hulls of up to {MOST_CORNERS} corners, and this has {len(vertices)}"
    if closed_triangles(len(vertices)) > MOST_FACES and (faces := _faces(size)) > MOST_FACES:
        return f"PhysX holds hulls of up to {MOST_FACES} faces, and this has {faces}"
    needed = max(LEAST_OUT, OUT * float(np.ptp(vertices, axis=0).sum()))
    near = [reach for number in range(len(vertices)) if (reach := _reach(vertices, number)) <= needed]
    if not near:
        return None
    return (
        f"PhysX leaves out corners that reach less than {needed:.2g} m beyond the hull of the others, and "
        f"{len(near)} of {len(vertices)} corners reach {min(near):.2g} m and more"
    )


def _faces(size: tuple[float, ...]) -> int:
    """The number of different planes of a hull's triangles."""
    held = hull_of(size)
    planes = np.column_stack([held.normals, held.offsets / np.ptp(held.vertices, axis=0).max()])
    return len(np.unique(np.round(planes, DIGITS), axis=0))


def _reach(vertices: np.ndarray, number: int) -> float:
    """How far (m) a corner is outside of the hull of the others; endlessly, where these make no solid."""
    try:
        others = hull(np.delete(vertices, number, axis=0))
    except FlatError:
        return float("inf")
    return float((others.normals @ vertices[number] - others.offsets).max())
