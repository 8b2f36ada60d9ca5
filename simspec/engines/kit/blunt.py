"""How exactly a detector of convex shapes finds the distance to curved sides; several engines have it.

The iteration for the distance of two convex shapes ends before it has reached the nearest point of a side that is curved, or
has many small faces. Measured (a ball of 1 cm, 150 points at each of 6 gaps for each of 168 cylinders, and hulls
of 8 to 800 vertices): the side of a cylinder of 2 to 30 mm length is felt up to 0.25 mm inside of where it is, 0.07 mm with
50 mm, 0.03 mm with 200 mm; with a radius up to 4 mm, or a length up to 1 mm, it is exact to 0.05 mm. Hulls whose shortest edge
is 1 cm and more are exact to 0.03 mm, others to 0.25 mm; boxes, capsules, flat ends of cylinders and hulls of up to six faces
to 0.01 mm.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Final

import numpy as np

from simspec.world.hull import hull_of
from simspec.world.types import Shape, World

BLUNT: Final = 2.5e-4
"""m by which the curved side of a short cylinder, and a face of a fine hull, are felt inside of where they are at most."""
SHORT: Final = (1e-3, 30e-3)
"""m between which a cylinder's length is, where its side is felt inside by more than a probe's tolerance (0.1 mm)."""
SLENDER: Final = 4e-3
"""m of a cylinder's radius, up to which its side is exact."""
FINE: Final = 0.01
"""m below which the shortest edge of a hull is, where its faces are felt inside."""
FEW_FACES: Final = 6
"""Up to so many plane faces hulls are exact, however small."""


def blunted(kind: str, world: World) -> Iterator[Shape]:
    """The colliding shapes of a kind whose sides or faces are felt inside of where they are."""
    for body in world.bodies:
        for shape in body.shapes:
            if shape.collision and shape.kind == kind == "cylinder":
                radius, length = shape.size
                if radius > SLENDER and SHORT[0] < length < SHORT[1]:
                    yield shape
            elif shape.collision and shape.kind == kind == "mesh" and _is_fine(shape.size):
                yield shape


@functools.lru_cache(maxsize=1024)
def _is_fine(size: tuple[float, ...]) -> bool:
    """Whether a hull (flat vertices, m) has an edge shorter than ``FINE`` and more than ``FEW_FACES`` plane faces."""
    solid = hull_of(size)
    if len(np.unique(np.round(solid.normals, 6), axis=0)) <= FEW_FACES:
        return False
    corners = solid.vertices[solid.triangles]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return bool(edges.min() < FINE)
